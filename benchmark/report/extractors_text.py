"""What two extractors add to one, for people."""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.report.grid import NOTHING, Grid, last_of_each, part_title
from benchmark.report.margins import Margin
from benchmark.report.rate import Rate
from benchmark.report.recovered import Recovered


def margin_grids(margins: Sequence[Margin]) -> list[Grid]:
    """By how much both extractors are better; nothing where the two localizers did not both run."""
    levels = [f"≥ {margin.min_visibility:.0%}" for margin in margins]
    rows = tuple(
        (
            level if i == 0 or levels[i - 1] != level else "",
            part_title(margin.part),
            str(margin.n),
            str(margin.scenes),
            str(margin.method_only),
            str(margin.rival_only),
            *_margin_cells(margin),
        )
        for i, (level, margin) in enumerate(zip(levels, margins, strict=True))
    )
    if not any(margin.n for margin in margins):
        return []
    columns = (
        "Visible",
        "Object",
        "n",
        "Scenes",
        "only focal",
        "only focal-region",
        "focal − focal-region",
        "Excludes zero",
    )
    note = (
        "Of the same pieces, in percentage points. In brackets: Newcombe's 95 % interval for paired proportions,\n"
        "with as many pieces as they are worth, those of one scene being alike (design effect, Rao and Scott)."
    )
    return [
        Grid(
            "What both extractors together match more than region growing alone",
            columns,
            rows,
            sections=last_of_each(levels),
            note=note,
        )
    ]


def _margin_cells(margin: Margin) -> tuple[str, str]:
    """The margin in percentage points with its interval, and what the interval says about zero."""
    if margin.margin is None:
        return NOTHING, NOTHING
    if margin.low is None or margin.high is None:
        return f"{100 * margin.margin:+.1f}", NOTHING
    text = f"{100 * margin.margin:+.1f} ({100 * margin.low:+.1f} to {100 * margin.high:+.1f})"
    return text, "yes" if margin.excludes_zero else "no"


def recovered_grids(rows: Sequence[Recovered]) -> list[Grid]:
    """How often both extractors matched what one of them lost; nothing where they did not run."""
    if not any(rate.n for row in rows for rate in (*row.extraction.values(), *row.matching.values())):
        return []
    levels = [f"≥ {row.min_visibility:.0%}" for row in rows]
    labels = [
        (level if i == 0 or levels[i - 1] != level else "", part_title(row.part))
        for i, (level, row) in enumerate(zip(levels, rows, strict=True))
    ]
    note = "Focal matched so many of the pieces in the column. In brackets: 95 % Wilson interval of the share."
    return [
        Grid(
            "Salient ellipse extracted by both extractors or by one of them: pieces that focal matched",
            ("Visible", "Object", "by both", "region growing lost it", "edge grouping lost it"),
            tuple((*label, *map(_of, row.extraction.values())) for label, row in zip(labels, rows, strict=True)),
            sections=last_of_each(levels),
        ),
        Grid(
            "Pieces that one extractor alone did not match: those that focal matched",
            ("Visible", "Object", "region growing missed", "edge grouping missed", "both missed"),
            tuple((*label, *map(_of, row.matching.values())) for label, row in zip(labels, rows, strict=True)),
            sections=last_of_each(levels),
            note=note,
        ),
    ]


def _of(rate: Rate) -> str:
    """Counts and the interval of their share."""
    if rate.low is None or rate.high is None:
        return NOTHING
    return f"{rate.successes} of {rate.n} ({rate.low:.0%} to {rate.high:.0%})"
