"""A share of outcomes, and how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.episodes.metrics import wilson_interval


@dataclass(frozen=True)
class Rate:
    """A success rate with its 95 % Wilson interval; None throughout for an empty sample."""

    n: int
    successes: int
    rate: float | None
    low: float | None
    high: float | None

    @classmethod
    def of(cls, outcomes: Sequence[bool]) -> Rate:
        """From the single outcomes."""
        n, successes = len(outcomes), sum(outcomes)
        if n == 0:
            return cls(0, 0, None, None, None)
        return cls(n, successes, successes / n, *wilson_interval(successes, n))
