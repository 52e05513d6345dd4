"""How much the constants of confirmation matter, one at a time: ``python -m benchmark.tuning.confirmation``.

Each setting of ``ConfirmationParameters`` (``vision/matching/parameters.py``) is made smaller and larger while the
others stay, and the localizer ``focal`` looks at the tuning scenes again: with the sensor of the laboratory, and with
that of the shop floor, where edges are worse. Nothing is fitted: the table tells which values have to be right and
which have not. A setting that changes nothing here may still be needed in scenes of another kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from benchmark.commands.common import print_line
from benchmark.episodes.evaluation import assign_estimates
from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE
from benchmark.report.grid import NOTHING, Grid
from benchmark.seeds import SCENES
from benchmark.tuning.options import Report, Size, run, seeds_in_words
from benchmark.tuning.scenes import KnownScene, known_scenes
from vision.matching.parameters import CONFIRMATION, ConfirmationParameters, MatchingParameters

NUMBER = 10  # scenes of each part and sensor
SENSORS = ("lab", "shopfloor")
FACTORS = (0.7, 1.4)


@dataclass(frozen=True)
class Outcome:
    """What the localizer made of all scenes with some settings.

    Attributes:
        found: number of the scene and of the piece, for every matched piece that is not almost hidden.
        half: those of them that are at least half visible.
        turned: those of them whose turn about the axis is known.
        false_poses: number of poses that belong to no piece.
    """

    found: frozenset[tuple[int, int]]
    half: frozenset[tuple[int, int]]
    turned: frozenset[tuple[int, int]]
    false_poses: int


def outcome(scenes: Sequence[KnownScene], settings: ConfirmationParameters) -> Outcome:
    """Look at all scenes with these settings."""
    found, half, turned, false_poses = set(), set(), set(), 0
    for number, scene in enumerate(scenes):
        estimates = scene.localize(MatchingParameters(confirmation=settings)).estimates
        assignment = assign_estimates(estimates, scene.pieces)
        false_poses += len(assignment.false_positives)
        owner = {j: estimates[i] for i, j in assignment.pairs}
        found |= {(number, j) for j in owner if j in scene.visible(BARELY_VISIBLE)}
        half |= {(number, j) for j in owner if j in scene.visible(HALF_VISIBLE)}
        turned |= {(number, j) for j in owner if j in scene.visible(BARELY_VISIBLE) and owner[j].inplane_known}
    return Outcome(frozenset(found), frozenset(half), frozenset(turned), false_poses)


def changed(name: str, factor: float) -> ConfirmationParameters:
    """The usual settings but for one, which is multiplied; a whole number stays one."""
    value = getattr(CONFIRMATION, name)
    return replace(
        CONFIRMATION, **{name: max(round(factor * value), 1) if isinstance(value, int) else factor * value}
    )


def measure(size: Size) -> Report:
    """Try all settings on so many scenes of each part and sensor."""
    scenes = known_scenes("tuning", size, SENSORS)
    usual = outcome(scenes, CONFIRMATION)
    rows = [_row("all", "1", NOTHING, usual, usual)]
    for field in fields(CONFIRMATION):
        print_line(f"trying {field.name}")
        for factor in FACTORS:
            settings = changed(field.name, factor)
            value = f"{getattr(settings, field.name):.3g}"
            rows.append(_row(field.name, f"{factor:g}", value, outcome(scenes, settings), usual))
    half, all_ = (sum(len(scene.visible(least)) for scene in scenes) for least in (HALF_VISIBLE, BARELY_VISIBLE))
    lines = (
        f"{all_} pieces at least 10 % visible, {half} of them at least 50 %.",
        seeds_in_words(f"Scenes, {' and '.join(SENSORS)}", {"tuning": SCENES["tuning"][: size.number]}),
    )
    grid = Grid(
        "Confirmation with one setting changed",
        ("Setting", "times", "value", "found, ≥ 50%", "found, ≥ 10%", "gained, lost", "turn known", "false poses"),
        tuple(rows),
        sections=frozenset(range(0, len(rows) - 1, len(FACTORS))),
        note="Gained and lost: pieces at least 10 % visible, against the settings in the code (first row).",
    )
    return Report((grid,), lines)


def _row(name: str, factor: str, value: str, now: Outcome, usual: Outcome) -> tuple[str, ...]:
    gained, lost = len(now.found - usual.found), len(usual.found - now.found)
    moved = f"+{gained} −{lost}" if gained or lost else NOTHING
    counts = (len(now.half), len(now.found), moved, len(now.turned), now.false_poses)
    return (name, factor, value, *map(str, counts))


def main(arguments: Sequence[str] | None = None) -> None:
    """Try all settings and print, from the command line."""
    run("See how much each constant of confirmation matters.", NUMBER, measure, arguments)


if __name__ == "__main__":
    main()
