"""A ``Table`` for people: on the terminal and as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console

from benchmark.episodes.metrics import BARELY_VISIBLE, ELLIPSOID_SHARE
from benchmark.report.extractors_text import margin_grids, recovered_grids
from benchmark.report.grid import (
    NOTHING,
    Grid,
    grids_as_markdown,
    last_of_each,
    median,
    part_title,
    plus_minus,
    print_grids,
    rate_text,
)
from benchmark.report.published import ROW_OF, PublishedErrors
from benchmark.report.rate import Rate
from benchmark.report.reliability import reliability_grid
from benchmark.report.tables import EXTRACTORS, OF_THE_PAPER, STAGES, AccuracyRow, Table
from benchmark.report.task_rows import task_grids

ROW_TITLES = {"region": "region-match", "group": "group-match"}
STAGE_TITLES = {
    "extraction": "Fig. 10 (a)  Feature extraction success",
    "matching": "Fig. 10 (b)  Feature matching success",
}


def grids(table: Table) -> list[Grid]:
    """The grids that are shown, first what the paper gives, last what was counted apart."""
    shown = [_table1(table), *_joint(table), coverage_grid(table), *(_fig10(table, stage) for stage in STAGES)]
    shown += [false_poses_grid(table), *([reliability_grid(table.reliability)] if table.reliability else [])]
    shown += [*margin_grids(table.margins), *recovered_grids(table.recovered)]
    if any(rate.n for rate in table.picks.values()):
        shown.append(_picks(table))
    return [*shown, *task_grids(table.tasks), _counts(table)]


def print_table(table: Table, console: Console) -> None:
    """Print everything on a terminal or into a file."""
    print_grids(grids(table), remarks([table]), console)


def as_markdown(table: Table) -> str:
    """Everything as GitHub-flavoured Markdown."""
    return grids_as_markdown(grids(table), remarks([table]))


def remarks(tables: Sequence[Table]) -> list[str]:
    """What a reader must know before believing tables: episodes that are missing or have failed."""
    lines = []
    recorded, planned = (sum(getattr(table, name) for table in tables) for name in ("recorded", "planned"))
    failed = {key: error for table in tables for key, error in table.failed.items()}
    if recorded < planned:
        lines.append(f"Incomplete: {recorded} of {planned} episodes are recorded.")
    if failed:
        lines.append(f"{len(failed)} episodes did not finish; their pieces are in no figure above:")
        lines += [f"  {key}: {error}" for key, error in failed.items()]
    return lines


def _table1(table: Table) -> Grid:
    rows = tuple(_accuracy_cells(row, table.table1, i) for i, row in enumerate(table.table1))
    parts = [row.part for row in table.table1]
    return Grid(
        title="Table 1  Localization error, mean ± standard deviation over matched pieces",
        columns=(
            "Object",
            "Method",
            "n",
            "Translation (mm)",
            "median",
            "published",
            "Rotation (°)",
            "median ",
            "published ",
            "published as",
        ),
        rows=rows,
        sections=last_of_each(parts),
        quiet=frozenset({"published", "published ", "published as"}),
        note=f"Pieces at least {BARELY_VISIBLE:.0%} visible. Rotation is the least over the part's symmetries.",
    )


def _joint(table: Table) -> list[Grid]:
    """The accuracy of the poses that the localizer stands by, which the paper does not give apart."""
    methods = [m for m in table.shown if m not in OF_THE_PAPER]
    rows = [table.find_accuracy(part, method, BARELY_VISIBLE) for part in table.parts for method in methods]
    cells = tuple(
        (
            part_title(row.part),
            row.method,
            str(row.n),
            *(
                text(row.errors[name], 3 if name.endswith("mm") else 2)
                for name in ("translation_mm", "tilt_deg", "inplane_deg")
                for text in (plus_minus, median)
            ),
        )
        for row in rows
    )
    if not cells:
        return []
    errors = ("Translation (mm)", "Tilt (°)", "Turn (°)")
    columns = ("Object", "Method", "n", *(name for error in errors for name in (error, "median")))
    return [
        Grid(
            title="Localization error of the other localizers",
            columns=columns,
            rows=cells,
            note="Tilt: error of the axis; turn: of the turn about it (– where a part looks the same at any angle).",
        )
    ]


def coverage_grid(table: Table) -> Grid:
    """How far the covariances that come with the poses can be believed."""
    rows = []
    for part in table.parts:
        rates = [table.find_accuracy(part, method, BARELY_VISIBLE).coverage for method in table.shown]
        rows.append((part_title(part), str(max(rate.n for rate in rates)), *map(rate_text, rates)))
    return Grid(
        title=f"Inside the {ELLIPSOID_SHARE:.0%} ellipsoid: share of true poses that the covariance allows for",
        columns=("Object", "n", *table.shown),
        rows=tuple(rows),
        note=f"Matched pieces at least {BARELY_VISIBLE:.0%} visible. In brackets: 95 % Wilson interval.",
    )


def _accuracy_cells(row: AccuracyRow, rows: Sequence[AccuracyRow], i: int) -> tuple[str, ...]:
    first = i == 0 or rows[i - 1].part != row.part
    return (
        part_title(row.part) if first else "",
        row.method,
        str(row.n),
        plus_minus(row.errors["translation_mm"], 2),
        median(row.errors["translation_mm"], 2),
        _published(row.published, "translation_mm"),
        plus_minus(row.errors["rotation_deg"], 2),
        median(row.errors["rotation_deg"], 2),
        _published(row.published, "rotation_deg"),
        ROW_TITLES[ROW_OF[row.method]] if row.published else NOTHING,
    )


def _fig10(table: Table, stage: str) -> Grid:
    levels = tuple(dict.fromkeys(row.min_visibility for row in table.success))
    cells = [(level, part) for level in levels for part in table.parts]
    rows = []
    methods = [m for m in table.shown if m not in EXTRACTORS] or list(table.shown)
    for i, (level, part) in enumerate(cells):
        bars = {method: table.find_success(part, method, stage, level) for method in methods}
        rates = [rate_text(bars[method].rate) for method in methods]
        first = i == 0 or cells[i - 1][0] != level
        label = f"≥ {level:.0%}" if first else ""
        published = table.find_success(part, "paper", stage, level).published
        n = str(max(bar.rate.n for bar in bars.values()))
        rows.append((label, part_title(part), n, *rates, NOTHING if published is None else f"{published:.0%}"))
    return Grid(
        title=STAGE_TITLES[stage],
        columns=("Visible", "Object", "n", *methods, "paper, published"),
        rows=tuple(rows),
        sections=last_of_each([str(level) for level, _ in cells]),
        quiet=frozenset({"paper, published"}),
        note=""
        if stage == STAGES[0]
        else "In brackets: 95 % Wilson interval. The paper's rates are over all its pieces.",
    )


def false_poses_grid(table: Table) -> Grid:
    """How many of the reported poses are of nothing."""
    rows = tuple(
        (part_title(part) if i == 0 else "", method, _false_poses(table.find_false_poses(part, method)))
        for part in table.parts
        for i, method in enumerate(table.shown)
    )
    return Grid(
        title="False poses: share of the reported poses that belong to no piece",
        columns=("Object", "Method", "False poses"),
        rows=rows,
        sections=last_of_each([part for part in table.parts for _ in table.shown]),
        note="Scenes of one part; all reported poses, of pieces however visible. In brackets: 95 % Wilson interval.",
    )


def _false_poses(share: Rate) -> str:
    if share.rate is None or share.low is None or share.high is None:
        return NOTHING
    return f"{share.successes} of {share.n}: {share.rate:.1%} ({share.low:.1%} to {share.high:.1%})"


def _picks(table: Table) -> Grid:
    rows = tuple((part_title(part), str(rate.n), rate_text(rate)) for part, rate in table.picks.items())
    return Grid("Picks of localised pieces", ("Object", "n", "Succeeded"), rows)


def _counts(table: Table) -> Grid:
    rows = [
        (
            part_title(count.part),
            str(count.pieces),
            str(count.barely_visible),
            str(count.out_of_bin),
            _tally(count.lost_at),
        )
        for count in table.counts
    ]
    heading = f"< {BARELY_VISIBLE:.0%} visible"
    columns = ("Object", "Pieces", heading, "Out of the bin", "Lost at")
    return Grid("Pieces, and those counted apart", columns, tuple(rows))


def _published(row: PublishedErrors | None, quantity: str) -> str:
    if row is None:
        return NOTHING
    return f"{getattr(row, f'{quantity}_mean'):.1f} ± {getattr(row, f'{quantity}_std'):.1f}"


def _tally(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count) or NOTHING
