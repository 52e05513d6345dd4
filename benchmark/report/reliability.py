"""Are poses as often right as they say? A reliability diagram, as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from benchmark.report.grid import NOTHING, Grid, last_of_each, rate_text
from benchmark.report.rate import Rate

EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class ReliabilityRow:
    """Poses whose probability lies between two values.

    Attributes:
        low: the least one, included.
        high: the largest one, left out unless it is 1.
        said: mean probability; None where there is no such pose.
        right: how many of them are right.
    """

    low: float
    high: float
    said: float | None
    right: Rate


def reliability(probabilities: Sequence[float], is_right: Sequence[bool]) -> tuple[ReliabilityRow, ...]:
    """One row for each step of the probability."""
    rows = []
    for low, high in pairwise(EDGES):
        mine = [i for i, p in enumerate(probabilities) if low <= p < high or p == high == 1.0]
        said = sum(probabilities[i] for i in mine) / len(mine) if mine else None
        rows.append(ReliabilityRow(low, high, said, Rate.of([is_right[i] for i in mine])))
    return tuple(rows)


def reliability_grid(found: Mapping[str, Sequence[ReliabilityRow]]) -> Grid:
    """The rows of each of several localizers or parts; those without a pose are left out."""
    shown = [(name, row) for name, rows in found.items() for row in rows if row.right.n]
    names = [name for name, _ in shown]
    cells = tuple(
        (
            name if i == 0 or names[i - 1] != name else "",
            f"{row.low:.0%} to {row.high:.0%}",
            str(row.right.n),
            NOTHING if row.said is None else f"{row.said:.1%}",
            rate_text(row.right),
        )
        for i, (name, row) in enumerate(shown)
    )
    return Grid(
        title="Reliability: of the poses that say so, how many are right",
        columns=("", "Probability", "n", "said on average", "right"),
        rows=cells,
        sections=last_of_each(names),
        note="All reported poses, of pieces however visible. In brackets: 95 % Wilson interval.",
    )
