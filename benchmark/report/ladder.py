"""The ladder: what every idea adds to the localizer before it, on the same pictures."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from benchmark.config import LADDER, SweepConfig
from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE, Summary
from benchmark.records.episode_record import EpisodeRecord, vision_stage
from benchmark.report.grid import NOTHING, Grid, last_of_each, median, part_title, plus_minus
from benchmark.report.margins import Margin, paired_margin
from benchmark.report.rate import Rate
from benchmark.report.tables import Table, build_table

OURS = "focal"
ONE_EXTRACTOR = ("focal-region", "focal-group")
"""They are held to ``OURS``, not to the row above them."""
_NOTE = f"""Matched, of pieces at least {HALF_VISIBLE:.0%} and {BARELY_VISIBLE:.0%} visible, in percent; against:
margin of the latter over the row above, of the last two over {OURS}, with Newcombe's 95 % interval for paired
proportions; errors of the matched pieces, mean ± standard deviation; false: percentage of the
reported poses that belong to no piece; ms: a view, median, on the machine that ran the sweep."""


@dataclass(frozen=True)
class LadderRow:
    """One localizer on the pieces of one part.

    Attributes:
        part: name of the pieces' type.
        method: the localizer.
        idea: what it adds to ``above``.
        above: the localizer that it is held to; None for the first.
        half_visible: matched, of pieces at least half visible.
        visible: matched, of pieces at least 10 % visible.
        translation_mm: errors of those that were matched.
        rotation_deg: the same.
        false_poses: share of the reported poses that belong to no piece.
        view_ms: median time for a view in milliseconds, on the machine that ran the sweep; None where there is none.
        margin: in matching over ``above``, of the same pieces at least 10 % visible; None for the first.
    """

    part: str
    method: str
    idea: str
    above: str | None
    half_visible: Rate
    visible: Rate
    translation_mm: Summary
    rotation_deg: Summary
    false_poses: Rate
    view_ms: float | None
    margin: Margin | None


def is_ladder(config: SweepConfig) -> bool:
    """Whether a sweep ran all localizers of the ladder."""
    return set(LADDER) <= {config.localizer, *config.compared}


def build_ladder(config: SweepConfig, records: Sequence[EpisodeRecord]) -> list[LadderRow]:
    """The rows of every part, from the predecessor upwards.

    Args:
        config: of the sweep.
        records: its records so far, in any order.
    """
    table = build_table(config, records)
    finished = [record for record in records if record.error is None]
    names = list(LADDER)
    rows = []
    for part in table.parts:
        for i, name in enumerate(names):
            above = OURS if name in ONE_EXTRACTOR else names[i - 1] if i else None
            rows.append(_row(table, finished, config, part, name, above))
    return rows


def _row(
    table: Table, records: Sequence[EpisodeRecord], config: SweepConfig, part: str, name: str, above: str | None
) -> LadderRow:
    errors = table.find_accuracy(part, name, BARELY_VISIBLE).errors
    stage = "vision" if name == config.localizer else vision_stage(name)
    times = [r.timings_s[stage] for r in records if r.parts == (part,) and stage in r.timings_s]
    return LadderRow(
        part=part,
        method=name,
        idea=LADDER[name],
        above=above,
        half_visible=table.find_success(part, name, "matching", HALF_VISIBLE).rate,
        visible=table.find_success(part, name, "matching", BARELY_VISIBLE).rate,
        translation_mm=errors["translation_mm"],
        rotation_deg=errors["rotation_deg"],
        false_poses=table.find_false_poses(part, name),
        view_ms=1000 * statistics.median(times) / config.views if times else None,
        margin=None if above is None else paired_margin(records, part, (name, above), BARELY_VISIBLE),
    )


def ladder_to_dict(rows: Sequence[LadderRow]) -> list[dict[str, object]]:
    """The rows as plain values for JSON."""
    return [asdict(row) for row in rows]


def ladder_grid(rows: Sequence[LadderRow]) -> Grid:
    """The ladder for people."""
    return Grid(
        title="The ladder: what every idea adds, on the same pictures",
        columns=(
            "Object",
            "Localizer",
            f"≥ {HALF_VISIBLE:.0%}",
            f"≥ {BARELY_VISIBLE:.0%}",
            "against",
            "mm",
            "median",
            "°",
            "median ",
            "False",
            "ms",
        ),
        rows=tuple(_cells(row, i == 0 or rows[i - 1].part != row.part) for i, row in enumerate(rows)),
        sections=last_of_each([row.part for row in rows]),
        note="\n".join([_NOTE, *(f"{name}: {idea}" for name, idea in LADDER.items())]),
    )


def _cells(row: LadderRow, first: bool) -> tuple[str, ...]:
    return (
        part_title(row.part) if first else "",
        row.method,
        _percent(row.half_visible),
        _percent(row.visible),
        _margin(row.margin),
        plus_minus(row.translation_mm, 2),
        median(row.translation_mm, 2),
        plus_minus(row.rotation_deg, 2),
        median(row.rotation_deg, 2),
        _percent(row.false_poses),
        NOTHING if row.view_ms is None else f"{row.view_ms:.0f}",
    )


def _percent(rate: Rate) -> str:
    return NOTHING if rate.rate is None else f"{100 * rate.rate:.1f}"


def _margin(margin: Margin | None) -> str:
    if margin is None or margin.margin is None:
        return NOTHING
    if margin.low is None or margin.high is None:
        return f"{100 * margin.margin:+.1f}"
    return f"{100 * margin.margin:+.1f} ({100 * margin.low:+.1f}, {100 * margin.high:+.1f})"
