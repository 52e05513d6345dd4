"""``focalpick check``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from benchmark.commands.common import SweepDirectory
from vision.errors import InputError


def check(
    directory: SweepDirectory,
    thresholds: Annotated[Path, tyro.conf.arg(metavar="FILE.toml")],
) -> int:
    """Hold a sweep against thresholds: exit code 0 when all are met, 1 when one is missed.

    A success rate is judged by the lower bound of its 95 % interval, an error by its mean. What was not measured
    misses its threshold, and so does a sweep with missing or failed episodes, unless the file allows them.

    Example: focalpick check results/smoke --thresholds benchmark/thresholds/smoke.toml

    Args:
        directory: what focalpick sweep wrote with --out.
        thresholds: with sections such as [focal.hub] and [picks.hub]; examples in benchmark/thresholds.
    """
    from benchmark.records.store import read_config, read_records
    from benchmark.report.gate import check as judge
    from benchmark.report.gate import read_thresholds
    from benchmark.report.tables import build_table

    wanted = read_thresholds(thresholds)
    config = read_config(directory)
    if config.variants:
        raise InputError(f"sweep in {directory}", got="a study", expected="a sweep that varies nothing")
    table = build_table(config, read_records(directory), (wanted.min_visibility,))
    verdicts = judge(table, wanted)
    for verdict in verdicts:
        print(f"{'ok    ' if verdict.passed else 'MISSED'}  {verdict}")
    missed = sum(not verdict.passed for verdict in verdicts)
    print(f"{missed} of {len(verdicts)} thresholds missed" if missed else f"all {len(verdicts)} thresholds met")
    return 1 if missed else 0
