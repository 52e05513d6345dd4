"""``focalpick table``."""

from __future__ import annotations

import json
from typing import Literal

from benchmark.commands.common import OptionalPath, SweepDirectory, print_line, results_console


def table(
    directory: SweepDirectory,
    format: Literal["text", "md", "json"] = "text",
    figures: OptionalPath = None,
) -> int:
    """Print the results of a sweep beside the figures that the paper published.

    Table 1 has the errors of the poses that were found: for each part, once from region growing and once from edge
    grouping. Fig. 10 has the share of pieces whose circle was found in the images (extraction) and whose pose was
    found (matching), for region growing alone, as in the paper's predecessor, and for both together. The interval
    beside a rate is its 95 % confidence interval. Works on an unfinished sweep too.

    Example: focalpick table results/table1 --format md

    Args:
        directory: what focalpick sweep wrote with --out.
        format: text for the terminal, md for Markdown, json for programs.
        figures: directory in which to draw fig10.png and errors.png.
    """
    from benchmark.report.tables import build_table, to_dict
    from benchmark.store import read_config, read_records

    config, records = read_config(directory), read_records(directory)
    result = build_table(config, records)
    if format == "json":
        print(json.dumps(to_dict(result), indent=2, allow_nan=False))
    elif format == "md":
        from benchmark.report.render import as_markdown

        print(as_markdown(result), end="")
    else:
        from benchmark.report.render import print_table

        print_table(result, results_console())
    if figures is not None:
        from benchmark.report.figures import save_figures

        for path in save_figures(result, records, figures):
            print_line(f"Drawn: {path}")
    return 0
