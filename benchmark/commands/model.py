"""``focalpick model``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from benchmark.commands.common import OptionalPath, named_model, print_line, results_console
from vision import kernel_cache


def show(
    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE|PART")], out: OptionalPath = None
) -> int:
    """Print a vision model for people, and draw it.

    Its circles with role and extractor, its patterns, the attributes of regions, grasps, bore and thresholds.

    Example: focalpick model show hub --out hub.png

    Args:
        file: a model file, or the name of a part whose model is shipped.
        out: PNG in which to draw the model from the front and from the side.
    """
    kernel_cache.require()
    from benchmark.report.model_text import print_model

    model = named_model(file)
    print_model(model, results_console())
    if out is not None:
        from benchmark.report.model_figure import save_model_figure  # matplotlib is slow to import

        save_model_figure(model, out)
        print_line(f"Drawn: {out}")
    return 0
