"""``focalpick table``."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from benchmark.commands.common import OptionalPath, SweepDirectory, print_line, results_console

if TYPE_CHECKING:
    from rich.console import Console

    from benchmark.config import SweepConfig
    from benchmark.records.episode_record import EpisodeRecord


def table(
    directory: SweepDirectory,
    format: Literal["text", "md", "json"] = "text",
    figures: OptionalPath = None,
) -> int:
    """Print the results of a sweep beside the figures that the paper published.

    Table 1 has the errors of the poses that were found: for each part, once from region growing and once from edge
    grouping. Fig. 10 has the share of pieces whose circle was found in the images (extraction) and whose pose was
    found (matching), for region growing alone, as in the paper's predecessor, and for both together, and a table says
    by how much both together are better. The interval beside a rate is its 95 % confidence interval. Of a study (the
    presets calibration and teaching) it prints the curves instead. Works on an unfinished sweep too.

    Example: focalpick table results/table1 --format md

    Args:
        directory: what focalpick sweep wrote with --out.
        format: text for the terminal, md for Markdown, json for programs.
        figures: directory in which to draw fig10.png and errors.png, or calibration.png or teaching.png.
    """
    from benchmark.records.store import read_config, read_records

    config, records = read_config(directory), read_records(directory)
    shown = _study(config, records, directory) if config.variants else _table(config, records)
    if format == "json":
        print(json.dumps(shown.values(), indent=2, allow_nan=False))
    elif format == "md":
        print(shown.markdown(), end="")
    else:
        shown.show(results_console())
    if figures is not None:
        for path in shown.draw(figures):
            print_line(f"Drawn: {path}")
    return 0


@dataclass(frozen=True)
class _Shown:
    """The ways to show a sweep's results; each imports what it needs when it is asked for."""

    values: Callable[[], dict[str, object]]
    markdown: Callable[[], str]
    show: Callable[[Console], None]
    draw: Callable[[Path], list[Path]]


def _table(config: SweepConfig, records: list[EpisodeRecord]) -> _Shown:
    from benchmark.report import table_text
    from benchmark.report.ladder import is_ladder
    from benchmark.report.tables import build_table, to_dict

    if is_ladder(config):
        return _ladder(config, records)
    result = build_table(config, records)

    def draw(directory: Path) -> list[Path]:
        from benchmark.report.figures import save_figures  # matplotlib is slow to import

        return save_figures(result, records, directory)

    return _Shown(
        partial(to_dict, result),
        partial(table_text.as_markdown, result),
        partial(table_text.print_table, result),
        draw,
    )


def _ladder(config: SweepConfig, records: list[EpisodeRecord]) -> _Shown:
    from benchmark.report.figures import save_figures
    from benchmark.report.grid import grids_as_markdown, print_grids
    from benchmark.report.ladder import build_ladder, ladder_grid, ladder_to_dict
    from benchmark.report.table_text import remarks
    from benchmark.report.tables import build_table

    table, rows = build_table(config, records), build_ladder(config, records)
    shown, lines = [ladder_grid(rows)], remarks([table])
    return _Shown(
        lambda: {"ladder": ladder_to_dict(rows), "config_hash": config.config_hash},
        lambda: grids_as_markdown(shown, lines),
        lambda console: print_grids(shown, lines, console),
        lambda directory: save_figures(table, records, directory),
    )


def _study(config: SweepConfig, records: list[EpisodeRecord], directory: Path) -> _Shown:
    from benchmark.report import study_text
    from benchmark.report.circle_errors import read_taught
    from benchmark.report.study import build_study, study_to_dict

    taught = read_taught(config, directory)
    study = build_study(config, records, taught.refused, taught.errors(config))

    def draw(directory: Path) -> list[Path]:
        from benchmark.report.study_figures import save_study_figures  # matplotlib is slow to import

        return save_study_figures(study, directory)

    return _Shown(
        partial(study_to_dict, study),
        partial(study_text.study_as_markdown, study),
        partial(study_text.print_study, study),
        draw,
    )
