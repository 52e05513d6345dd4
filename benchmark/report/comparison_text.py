"""How far two sweeps lie apart, as tables for people."""

from __future__ import annotations

from benchmark.report.comparison import NEAR_DEG, NEAR_MM, Apart, Comparison, Spread
from benchmark.report.grid import NOTHING, Grid, last_of_each, part_title

_COLUMNS = (
    "Object",
    "Localizer",
    "in both",
    "median (mm)",
    "largest (mm)",
    "median (°)",
    "largest (°)",
    "farther",
    "only in the first",
    "only in the second",
)


def comparison_grids(apart: Apart) -> list[Grid]:
    """The distances of the poses, and what the stamps of the two environments have not in common."""
    rows = tuple(map(_row, apart.comparisons))
    distances = Grid(
        f"How far the poses lie apart: {apart.episodes} episodes that both sweeps finished",
        _COLUMNS,
        rows,
        sections=last_of_each([row[0] for row in rows]),
        note=f"Of matched pieces. Farther: by more than {NEAR_MM:g} mm or {NEAR_DEG:g}°.",
    )
    stamps = tuple((name, a or NOTHING, b or NOTHING) for name, (a, b) in apart.stamps.items())
    environments = Grid("Where the environments differ", ("", "first", "second"), stamps)
    return [distances, *([environments] if stamps else [])]


def _row(comparison: Comparison) -> tuple[str, ...]:
    counts = (comparison.far, comparison.first_only, comparison.second_only)
    distances = (*_spread(comparison.position_mm), *_spread(comparison.rotation_deg))
    title = part_title(comparison.part)
    return (title, comparison.method, str(comparison.both), *distances, *map(str, counts))


def _spread(spread: Spread | None) -> tuple[str, str]:
    """Median and largest; below the last digit shown is what machines differ by where nothing is doubtful."""
    if spread is None:
        return NOTHING, NOTHING
    return f"{spread.median:.6f}", f"{spread.largest:.6f}"
