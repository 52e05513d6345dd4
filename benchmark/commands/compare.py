"""``focalpick compare``."""

from __future__ import annotations

from typing import Annotated

import tyro

from benchmark.commands.common import SweepDirectory, results_console
from vision.errors import InputError

MAY_DIFFER = 0.05
"""The share of the poses that may differ where two machines count as giving the same results. On an imitated other
processor 0.6 % of 495 poses did; sweeps of a few scenes scatter."""


def compare(
    first: SweepDirectory,
    second: SweepDirectory,
    may_differ: Annotated[float, tyro.conf.arg(metavar="SHARE")] = MAY_DIFFER,
) -> int:
    """Print how far the poses of two sweeps lie apart: exit code 0 when they agree, 1 when too many differ.

    For the same episodes played twice: on two machines, or by two versions. A pose differs when it is farther from
    that of the other sweep than a fixed limit, which the table states, or when only one sweep matched the piece.

    Example: focalpick compare results/here results/there

    Args:
        first: what focalpick sweep wrote with --out.
        second: what it wrote with the same options elsewhere.
        may_differ: share of the poses that may differ, from 0 to 1.
    """
    from benchmark.records.store import read_records
    from benchmark.report.comparison import compare as measure
    from benchmark.report.comparison_text import comparison_grids
    from benchmark.report.grid import print_grids

    if not 0 <= may_differ <= 1:
        raise InputError("--may-differ", got=may_differ, expected="a share from 0 to 1")
    apart = measure(read_records(first), read_records(second))
    print_grids(comparison_grids(apart), [], results_console())
    if apart.matched == 0:
        print("neither sweep matched a piece: nothing to compare")
        return 1
    agree = apart.different <= may_differ * apart.matched
    verdict = "the sweeps agree" if agree else "too many"
    print(f"{apart.different} of {apart.matched} poses differ; {may_differ:.1%} may: {verdict}")
    return 0 if agree else 1
