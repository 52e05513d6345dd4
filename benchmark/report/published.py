"""The figures of Motai's paper that the benchmark is set beside (Section 7: Table 1 and the text to Fig. 10)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PublishedErrors:
    """A row of the paper's Table 1: mean and standard deviation."""

    translation_mm_mean: float
    translation_mm_std: float
    rotation_deg_mean: float
    rotation_deg_std: float


TABLE_1: dict[tuple[str, str], PublishedErrors] = {
    ("hub", "region"): PublishedErrors(3.4, 1.9, 11.3, 5.7),
    ("hub", "group"): PublishedErrors(3.5, 2.0, 12.0, 5.1),
    ("cover1", "region"): PublishedErrors(1.4, 0.5, 4.3, 1.6),
    ("cover1", "group"): PublishedErrors(1.1, 0.4, 4.0, 1.0),
    ("cover2", "group"): PublishedErrors(1.9, 0.7, 4.4, 1.8),
    ("cover2", "region"): PublishedErrors(2.2, 1.1, 5.1, 2.2),
}
"""By (part, extractor), in the order of the paper's rows."""
ROW_OF = {"previous": "region", "paper": "group", "focal-region": "region", "focal-group": "group"}
"""Beside which of a part's two rows a localizer stands: the predecessor has region growing alone, and edge grouping
is what the paper's system adds to it."""


FIGURE_10: dict[tuple[str, str, str], float] = {
    ("hub", "paper", "extraction"): 0.81,
    ("cover1", "paper", "extraction"): 0.91,
    ("cover2", "paper", "extraction"): 0.89,
    ("hub", "paper", "matching"): 0.77,
    ("cover1", "paper", "matching"): 0.87,
    ("cover2", "paper", "matching"): 0.85,
}
"""Success rates by (part, method, stage), over 140 pieces. The previous method's are bars without a number."""

PARTS = ("hub", "cover1", "cover2")
"""The paper's parts in its order."""

TITLES = {"hub": "Hub", "cover1": "Alternator Cover 1", "cover2": "Alternator Cover 2"}
"""The paper's names for them."""


def paper_order(parts: tuple[str, ...]) -> tuple[str, ...]:
    """Part names with the paper's parts first, in its order."""
    return tuple(p for p in PARTS if p in parts) + tuple(p for p in parts if p not in PARTS)
