"""What the tuning scripts share: their options, their seeds in words, and how they print."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2

from benchmark.commands.common import prepare_process, results_console
from benchmark.report.grid import Grid, grids_as_markdown, print_grids
from vision.errors import FocalpickError


@dataclass(frozen=True)
class Report:
    """What a script found.

    Attributes:
        grids: the tables.
        lines: what else a reader should know: the seeds, and what was left out.
    """

    grids: tuple[Grid, ...]
    lines: tuple[str, ...]


@dataclass(frozen=True)
class Size:
    """How much to run.

    Attributes:
        number: pictures of each kind, or scenes of each part.
        quick: only a few kinds or one part, to see that it runs; the figures mean nothing then.
    """

    number: int
    quick: bool = False


def run(description: str, number: int, measure: Callable[[Size], Report], arguments: Sequence[str] | None) -> None:
    """Run a script from the command line.

    Args:
        description: what it does.
        number: pictures of each kind, or scenes of each part, in a full run.
        measure: makes the report.
        arguments: of the command line; None for the process's own.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--number", type=_positive, default=number, help="pictures of each kind, or scenes of a part")
    parser.add_argument("--quick", action="store_true", help="one of a few, only to see that it runs")
    parser.add_argument("--format", default="text", choices=("text", "md"), help="md for Markdown")
    chosen = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    try:
        prepare_process()
        report = measure(Size(1, quick=True) if chosen.quick else Size(chosen.number))
    except FocalpickError as error:
        parser.exit(2, f"{error}\n")
    if chosen.format == "md":
        print(grids_as_markdown(report.grids, report.lines), end="")
    else:
        print_grids(report.grids, report.lines, results_console())


def seeds_in_words(what: str, seeds: dict[str, range]) -> str:
    """For example: Scenes: tuning 30000 to 30019, validation 40000 to 40019."""
    uses = [f"{use} {numbers[0]} to {numbers[-1]}" for use, numbers in seeds.items()]
    return f"{what}: {', '.join(uses)} (benchmark/seeds.py)."


def _positive(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"got {text}; expected a whole number, at least 1")
    return number
