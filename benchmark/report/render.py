"""A ``Table`` for people: on the terminal and as Markdown, from one description of the columns."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rich import box
from rich.console import Console, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from benchmark.metrics import BARELY_VISIBLE, ELLIPSOID_SHARE
from benchmark.report.margins import Margin
from benchmark.report.published import TITLES, PublishedErrors
from benchmark.report.tables import STAGES, AccuracyRow, Rate, Summary, Table

NOTHING = "–"
PROCESS_TITLES = {"region": "Region-match", "group": "Group-match"}
METHOD_TITLES = {"region": "previous (region growing)", "group": "edge grouping alone", "dual": "dual"}
STAGE_TITLES = {
    "extraction": "Fig. 10 (a)  Feature extraction success",
    "matching": "Fig. 10 (b)  Feature matching success",
}


@dataclass(frozen=True)
class Grid:
    """A titled table of strings.

    Attributes:
        title: stands above it.
        columns: the headings; a heading in ``quiet`` is secondary.
        rows: one string per column.
        sections: indices of rows that a rule follows.
        quiet: headings of the columns with other people's figures.
        note: stands below it.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    sections: frozenset[int] = frozenset()
    quiet: frozenset[str] = frozenset()
    note: str = ""


def grids(table: Table) -> list[Grid]:
    """The grids that are shown: Table 1, covariances, Fig. 10, the margin, picks, and what was counted apart."""
    shown = [_table1(table), *_joint(table), _coverage(table)]
    shown += [*(_fig10(table, stage) for stage in STAGES), *_margins(table)]
    if any(rate.n for rate in table.picks.values()):
        shown.append(_picks(table))
    return [*shown, _counts(table)]


def print_table(table: Table, console: Console) -> None:
    """Print everything on a terminal or into a file."""
    print_grids(grids(table), remarks([table]), console)


def as_markdown(table: Table) -> str:
    """Everything as GitHub-flavoured Markdown."""
    return grids_as_markdown(grids(table), remarks([table]))


def print_grids(shown: Sequence[Grid], lines: Sequence[str], console: Console) -> None:
    """Print grids, and below them lines that a reader should not miss."""
    for grid in shown:
        console.print(_rich(grid))
    for line in lines:
        console.print(Text(line, style="yellow"))


def grids_as_markdown(shown: Sequence[Grid], lines: Sequence[str]) -> str:
    """The same as ``print_grids`` for GitHub."""
    return "\n\n".join([*map(_markdown, shown), *lines]) + "\n"


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
            "Process",
            "n",
            "Translation (mm)",
            "published",
            "Rotation (°)",
            "published ",
            "Tilt (°)",
            "In-plane (°)",
        ),
        rows=rows,
        sections=last_of_each(parts),
        quiet=frozenset({"published", "published ", "Tilt (°)", "In-plane (°)"}),
        note=f"Pieces at least {BARELY_VISIBLE:.0%} visible. Rotation is the least over the part's symmetries;\n"
        "tilt is that of its axis, in-plane that about it (– for a part that looks the same at any angle).",
    )


def _joint(table: Table) -> list[Grid]:
    """The accuracy of the poses that the localizer stands by, which the paper does not give apart."""
    methods = [m for m in table.methods if m not in PROCESS_TITLES]
    rows = [table.find_accuracy(part, method, BARELY_VISIBLE) for part in table.parts for method in methods]
    cells = tuple(
        (
            part_title(row.part),
            METHOD_TITLES.get(row.method, row.method),
            str(row.n),
            *(
                plus_minus(row.errors[name], 3)
                for name in ("translation_mm", "rotation_deg", "tilt_deg", "inplane_deg")
            ),
        )
        for row in rows
    )
    if not cells:
        return []
    columns = ("Object", "Method", "n", "Translation (mm)", "Rotation (°)", "Tilt (°)", "In-plane (°)")
    return [
        Grid(
            title="Localization error of the final poses, both processes refined together",
            columns=columns,
            rows=cells,
        )
    ]


def _coverage(table: Table) -> Grid:
    """How far the covariances that come with the poses can be believed."""
    rows = []
    for part in table.parts:
        rates = [table.find_accuracy(part, method, BARELY_VISIBLE).coverage for method in table.methods]
        rows.append((part_title(part), str(max(rate.n for rate in rates)), *map(rate_text, rates)))
    return Grid(
        title=f"Inside the {ELLIPSOID_SHARE:.0%} ellipsoid: share of true poses that the covariance allows for",
        columns=("Object", "n", *(METHOD_TITLES.get(m, m) for m in table.methods)),
        rows=tuple(rows),
        note=f"Matched pieces at least {BARELY_VISIBLE:.0%} visible. In brackets: 95 % Wilson interval.",
    )


def _accuracy_cells(row: AccuracyRow, rows: Sequence[AccuracyRow], i: int) -> tuple[str, ...]:
    first = i == 0 or rows[i - 1].part != row.part
    return (
        part_title(row.part) if first else "",
        PROCESS_TITLES.get(row.method, row.method),
        str(row.n),
        plus_minus(row.errors["translation_mm"], 2),
        _published(row.published, "translation_mm"),
        plus_minus(row.errors["rotation_deg"], 2),
        _published(row.published, "rotation_deg"),
        plus_minus(row.errors["tilt_deg"], 2),
        plus_minus(row.errors["inplane_deg"], 2),
    )


def _fig10(table: Table, stage: str) -> Grid:
    levels = tuple(dict.fromkeys(row.min_visibility for row in table.success))
    cells = [(level, part) for level in levels for part in table.parts]
    rows = []
    methods = [m for m in table.methods if m != "group"]
    for i, (level, part) in enumerate(cells):
        bars = {method: table.find_success(part, method, stage, level) for method in methods}
        rates = [rate_text(bars[method].rate) for method in methods]
        first = i == 0 or cells[i - 1][0] != level
        label = f"≥ {level:.0%}" if first else ""
        published = bars["dual"].published
        n = str(max(bar.rate.n for bar in bars.values()))
        rows.append((label, part_title(part), n, *rates, NOTHING if published is None else f"{published:.0%}"))
    return Grid(
        title=STAGE_TITLES[stage],
        columns=("Visible", "Object", "n", *(METHOD_TITLES.get(m, m) for m in methods), "dual, published"),
        rows=tuple(rows),
        sections=last_of_each([str(level) for level, _ in cells]),
        quiet=frozenset({"dual, published"}),
        note=""
        if stage == STAGES[0]
        else "In brackets: 95 % Wilson interval. The paper's rates are over all its pieces.",
    )


def _margins(table: Table) -> list[Grid]:
    """The paper's claim in figures; nothing where the two localizers did not both run."""
    levels = [f"≥ {margin.min_visibility:.0%}" for margin in table.margins]
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
        for i, (level, margin) in enumerate(zip(levels, table.margins, strict=True))
    )
    if not any(margin.n for margin in table.margins):
        return []
    columns = ("Visible", "Object", "n", "Scenes", "only dual", "only previous", "dual − previous", "Excludes zero")
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
            _tally(count.false_positives),
        )
        for count in table.counts
    ]
    heading = f"< {BARELY_VISIBLE:.0%} visible"
    columns = ("Object", "Pieces", heading, "Out of the bin", "Lost at", "False positives")
    return Grid("Pieces, and those counted apart", columns, tuple(rows))


def part_title(part: str) -> str:
    """The paper's name for a part, or its own."""
    return TITLES.get(part, part)


def plus_minus(summary: Summary, digits: int) -> str:
    """Mean and standard deviation as in the paper's Table 1."""
    if summary.mean is None:
        return NOTHING
    spread = NOTHING if summary.std is None else f"{summary.std:.{digits}f}"
    return f"{summary.mean:.{digits}f} ± {spread}"


def _published(row: PublishedErrors | None, quantity: str) -> str:
    if row is None:
        return NOTHING
    return f"{getattr(row, f'{quantity}_mean'):.1f} ± {getattr(row, f'{quantity}_std'):.1f}"


def rate_text(rate: Rate) -> str:
    """A rate with its interval in brackets."""
    if rate.rate is None or rate.low is None or rate.high is None:
        return NOTHING
    return f"{rate.rate:4.0%} ({rate.low:.0%} to {rate.high:.0%})"


def _tally(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count) or NOTHING


def last_of_each(labels: Sequence[str]) -> frozenset[int]:
    """Indices at which a run of equal labels ends, but not the last of all."""
    return frozenset(i for i, (a, b) in enumerate(itertools.pairwise(labels)) if a != b)


def _rich(grid: Grid) -> RenderableType:
    rich = RichTable(
        title=Text(grid.title, style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        caption=Text(grid.note, style="dim") if grid.note else None,
        caption_justify="left",
        header_style="bold",
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    for i, column in enumerate(grid.columns):
        words = all(not row[i][:1].isdigit() and row[i] != NOTHING for row in grid.rows)
        style = "dim" if column in grid.quiet else ""
        justify: Literal["left", "right"] = "left" if words else "right"
        rich.add_column(column.strip(), justify=justify, style=style, header_style=style or "bold", no_wrap=words)
    for i, row in enumerate(grid.rows):
        rich.add_row(*row, end_section=i in grid.sections)
    return rich


def _markdown(grid: Grid) -> str:
    rows = [tuple(column.strip() for column in grid.columns), ("---",) * len(grid.columns), *grid.rows]
    lines = [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in rows]
    return "\n".join([f"**{grid.title}**", "", *lines, *(["", grid.note] if grid.note else [])])
