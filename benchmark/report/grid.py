"""Titled tables of strings, for people: on the terminal and as Markdown, from one description of the columns."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from rich import box
from rich.console import Console, RenderableType
from rich.table import Table as RichTable
from rich.text import Text

from benchmark.episodes.metrics import Summary
from benchmark.report.published import TITLES
from benchmark.report.rate import Rate

NOTHING = "–"


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


def print_grids(shown: Sequence[Grid], lines: Sequence[str], console: Console) -> None:
    """Print grids, and below them lines that a reader should not miss."""
    for grid in shown:
        console.print(_rich(grid))
    for line in lines:
        console.print(Text(line, style="yellow"))


def grids_as_markdown(shown: Sequence[Grid], lines: Sequence[str]) -> str:
    """The same as ``print_grids`` for GitHub."""
    return "\n\n".join([*map(_markdown, shown), *lines]) + "\n"


def part_title(part: str) -> str:
    """The paper's name for a part, or its own."""
    return TITLES.get(part, part)


def plus_minus(summary: Summary, digits: int) -> str:
    """Mean and standard deviation as in the paper's Table 1."""
    if summary.mean is None:
        return NOTHING
    spread = NOTHING if summary.std is None else f"{summary.std:.{digits}f}"
    return f"{summary.mean:.{digits}f} ± {spread}"


def median(summary: Summary, digits: int) -> str:
    """The median, which single gross errors do not move."""
    return NOTHING if summary.median is None else f"{summary.median:.{digits}f}"


def rate_text(rate: Rate) -> str:
    """A rate with its interval in brackets."""
    if rate.rate is None or rate.low is None or rate.high is None:
        return NOTHING
    return f"{rate.rate:4.0%} ({rate.low:.0%} to {rate.high:.0%})"


def share_text(rate: Rate) -> str:
    """A share that is to be small, with what it is of: ``2.9% of 34``."""
    return NOTHING if rate.rate is None else f"{rate.rate:.1%} of {rate.n}"


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
