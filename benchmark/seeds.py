"""Which random numbers are for what: no two uses share a seed, so nothing is reported on what it was fitted to."""

from __future__ import annotations

SCENES: dict[str, range] = {
    "examples": range(0, 10_000),
    "earlier": range(10_000, 30_000),
    "tuning": range(30_000, 40_000),
    "validation": range(40_000, 50_000),
    "timing": range(60_000, 70_000),
    "smoke": range(70_000, 80_000),
    "table1": range(100_000, 110_000),
    "heap": range(110_000, 120_000),
    "shopfloor": range(120_000, 130_000),
    "calibration": range(130_000, 140_000),
    "teaching": range(140_000, 150_000),
    "ladder": range(150_000, 160_000),
}
"""Seeds of sweeps, from which each scene has its own (``benchmark.config.episode_seed``).

A preset of ``focalpick sweep`` has the range of its name and takes the first seed of it; the others are there for
whoever wants fresh scenes. "examples" are those of the documents' commands and of users' own trials; seed 0 once
served all presets. "earlier" are those on which values in the code were chosen before ``benchmark/tuning`` was there;
tests use them too.
"""

PICTURES: dict[str, range] = {
    "earlier": range(0, 100_000),
    "tuning": range(100_000, 500_000),
    "validation": range(500_000, 1_000_000),
    "reported": range(1_000_000, 2_000_000),
}
"""Seeds of the pictures of ``benchmark.detector.drawings``: the first one of the split plus the picture's number."""
