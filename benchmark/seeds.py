"""Which random numbers are for what: no two uses share a seed, so nothing is reported on what it was fitted to."""

from __future__ import annotations

SCENES: dict[str, range] = {
    "reported": range(0, 10_000),
    "earlier": range(10_000, 30_000),
    "tuning": range(30_000, 40_000),
    "validation": range(40_000, 50_000),
    "timing": range(60_000, 70_000),
}
"""Seeds of sweeps, from which each scene has its own (``benchmark.config.episode_seed``).

"earlier" are those on which values in the code were chosen before ``benchmark/tuning`` was there; tests use them too.
"""

PICTURES: dict[str, range] = {
    "earlier": range(0, 100_000),
    "tuning": range(100_000, 500_000),
    "validation": range(500_000, 1_000_000),
    "reported": range(1_000_000, 2_000_000),
}
"""Seeds of the pictures of ``benchmark.detector.drawings``: the first one of the split plus the picture's number."""
