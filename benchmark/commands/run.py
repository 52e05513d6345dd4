"""``focalpick run``."""

from __future__ import annotations

from pathlib import Path

from benchmark.commands.common import (
    Millimetres,
    Name,
    Number,
    OptionalPath,
    Pieces,
    check_localizer,
    fewest_and_most,
    prepare_process,
    print_line,
    results_console,
    split_parts,
)


def run(
    part: Name = "hub",
    seed: Number = 0,
    scene: Number = 0,
    pieces: Pieces = "4-6",
    sensor: Name = "lab",
    localizer: Name = "focal",
    views: Number = 3,
    task: Name = "pick",
    models: OptionalPath = None,
    rrd: OptionalPath = None,
    clearance_mm: Millimetres = None,
) -> int:
    """Run one episode and print what became of each piece.

    With the seed and scene number of a sweep, it is the very episode of that sweep. With --rrd it is also recorded
    for the rerun viewer: the robot, the images with what was found in them, and the estimated poses.

    Example: focalpick run --part hub --seed 7 --rrd hub.rrd && focalpick view hub.rrd

    Args:
        part: hub, cover1, cover2, or a mesh file of your own (pulley.obj in metres, pulley.stl:mm); + mixes.
        seed: of the sweep that the episode belongs to, or any whole number.
        scene: number of the scene within the sweep, from 0.
        pieces: pieces dropped into the bin; 4-6, as in the paper, draws the number from the seed.
        sensor: what the camera adds to the image: ideal, lab or shopfloor.
        localizer: finds the poses: focal, focal-region, focal-group, paper, previous, oracle, or module:name.
        views: number of viewpoints, 2 or 3.
        task: pick one piece, clear the bin, insert a peg into a bore, or none to stop when the poses are found.
        models: directory of taught models, each named after its part: pulley.json for pulley.obj. They come before
            the shipped ones.
        rrd: file for the rerun recording.
        clearance_mm: between peg and bore, on the diameter, for --task insert; 0.5 when left out.
    """
    from benchmark.commands.outcome import outcome_table, pick_lines
    from benchmark.config import PRESETS, SweepConfig

    kinds = split_parts(part) or PRESETS["table1"].parts
    fewest, most = fewest_and_most(pieces)
    sweep = SweepConfig(
        kinds,
        scene + 1,
        fewest,
        sensor,
        localizer,
        views,
        seed,
        task,  # type: ignore[arg-type]
        models=None if models is None else str(models),
        most_pieces=most,
        clearance_mm=clearance_mm,
    )
    config = sweep.episode(kinds[0], scene)
    if rrd is not None:
        _check_writable(rrd)
    prepare_process()
    check_localizer(config.localizer, config.parts, config.models)
    if rrd is not None:
        from benchmark.report.rerun_log import record_episode

        record = record_episode(config, rrd)
    else:
        from benchmark.episodes.episode import run_episode

        record = run_episode(config)
    console = results_console()
    console.print(outcome_table(record))
    for line in pick_lines(record):
        console.print(line, highlight=False)
    if rrd is not None:
        print_line(f"Recorded in {rrd}. Next: focalpick view {rrd}")
    return 0


def _check_writable(path: Path) -> None:
    """Fail before the episode and not after it.

    Raises:
        InputError: the file cannot be written.
    """
    from vision.errors import InputError

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        existed = path.exists()
        path.open("ab").close()
        if not existed:
            path.unlink()
    except OSError as error:
        do = "Choose another --rrd."
        raise InputError(
            f"recording {path}", got=error.strerror, expected="a file that can be written", do=do
        ) from None
