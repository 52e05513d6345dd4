"""``focalpick sweep``."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.commands.common import (
    Millimetres,
    Name,
    OptionalPath,
    PartNames,
    PresetName,
    PresetNumber,
    PresetPieces,
    Seconds,
    check_localizer,
    fewest_and_most,
    prepare_process,
    print_line,
    split_parts,
)
from benchmark.interrupts import ended_in_order
from vision.errors import InputError

if TYPE_CHECKING:
    from benchmark.commands.progress import SweepProgress
    from benchmark.config import SweepConfig
    from benchmark.records.episode_record import EpisodeRecord

EXIT_FAILED_EPISODES = 1


def sweep(
    preset: Name = "table1",
    parts: PartNames = None,
    scenes: PresetNumber = None,
    pieces: PresetPieces = None,
    sensor: PresetName = None,
    localizer: PresetName = None,
    views: PresetNumber = None,
    task: PresetName = None,
    workers: PresetNumber = None,
    seed: PresetNumber = None,
    models: OptionalPath = None,
    out: OptionalPath = None,
    episode_limit: Seconds = 600,
    clearance_mm: Millimetres = None,
) -> int:
    """Run many episodes and record each one in a directory.

    An episode drops a few equal parts into a bin, photographs them with the camera on the robot's wrist from two or
    three viewpoints, finds their poses in the images, and lets the robot pick one. A sweep that was stopped or killed
    goes on where it stopped when the same command is given again, as long as the mesh, model and localizer files are
    the same. The results do not depend on the number of workers.
    The exit code is 1 when an episode did not finish.

    Example: focalpick sweep --parts hub,cover2 --scenes 5 --out results/mine

    Args:
        preset: table1 (35 scenes of each part, the paper's experiment) or smoke (2 of each); ladder (from the paper's
            predecessor to our localizer, one idea at a time, on the same pictures); heap (8 to 12 pieces in
            the same bin); shopfloor (10 scenes with the sensor of that name); calibration (every scene again for
            hand-eye errors from 0 to 2 mm) or teaching (again with models taught by clicks that err by 0 to 5 pixels
            in 2 to 5 views). Each has its own seeds.
        parts: hub (brake hub, 240 mm), cover1, cover2 (alternator covers, 30 and 65 mm), or mesh files of your own
            (pulley.obj in metres, pulley.stl:mm); with commas; + mixes.
        scenes: number of scenes of each part.
        pieces: pieces dropped into each scene; 4-6, as in the paper, draws each scene's number from its seed.
        sensor: what the camera adds: ideal (nothing), lab (noise, blur, changing light), shopfloor (more, and dirt).
        localizer: finds the poses: focal, focal-region, focal-group, paper, previous, oracle, or module:name.
        views: number of viewpoints, 2 or 3.
        task: pick one piece, clear the bin, insert a peg into a bore, or none to stop when the poses are found.
        workers: processes that run side by side, one for each core in the presets.
        seed: any whole number; the same seed gives the same results on the same machine.
        models: directory of taught models, each named after its part: pulley.json for pulley.obj. They come before
            the shipped ones.
        out: directory for the records; results/PRESET when left out.
        episode_limit: after so long an episode is stopped, recorded as failed, and tried again when the sweep is
            resumed; 0 for no limit.
        clearance_mm: between peg and bore, on the diameter, for --task insert; 0.5 when left out.
    """
    from rich.console import Console

    from benchmark.commands.progress import SweepProgress, timing_table
    from benchmark.config import preset as make_config

    if not 0 <= episode_limit < math.inf:
        raise InputError("episode-limit", got=episode_limit, expected="a number of seconds, or 0 for no limit")
    fewest, most = (None, None) if pieces is None else fewest_and_most(pieces)
    config = make_config(
        preset,
        parts=split_parts(parts),
        scenes=scenes,
        pieces=fewest,
        most_pieces=most,
        sensor=sensor,
        localizer=localizer,
        # A preset compares its own localizer with others; with another one there is nothing to compare.
        compared=None if localizer is None else (),
        views=views,
        task=task,
        workers=workers,
        seed=seed,
        models=None if models is None else str(models),
        clearance_mm=clearance_mm,
    )
    out = out or Path("results") / preset
    prepare_process()
    for name in (config.localizer, *config.compared):
        check_localizer(name, config.part_names, config.models)
    import benchmark.episodes.episode  # noqa: F401  # loads the simulator, while Ctrl-C still ends that at once

    with ended_in_order(), SweepProgress(config.workers) as progress:
        records = _run(config, out, progress, episode_limit or None)
    Console(stderr=True).print(timing_table(records))
    for record in records:
        if record.error is not None:
            print_line(f"episode {record.key} did not finish: {record.error}")
    failed = sum(record.error is not None for record in records)
    told = f", of which {failed} did not finish" if failed else ""
    print_line(f"{len(records)} episodes are recorded in {out}{told}. Next: focalpick table {out}")
    return EXIT_FAILED_EPISODES if failed else 0


def _run(config: SweepConfig, out: Path, progress: SweepProgress, limit_s: float | None) -> list[EpisodeRecord]:
    """All records of the sweep; what a study varies in the teaching is taught first."""
    from benchmark.episodes.sweep import run_sweep

    if not any(variant.is_taught for variant in config.variants):
        return run_sweep(config, out, on_progress=progress, episode_limit_s=limit_s, tell=progress.tell)
    from benchmark.episodes.episode import run_episode
    from benchmark.study.taught_models import refusals, teach_variants

    def prepare() -> None:
        teach_variants(config, out, progress.taught)
        for lesson, reason in refusals(out).items():
            print_line(f"{lesson} could not be taught: {reason}")

    run_taught = functools.partial(run_episode, study=out.resolve())
    return run_sweep(config, out, run_taught, on_progress=progress, prepare=prepare, episode_limit_s=limit_s)
