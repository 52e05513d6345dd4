"""Fig. 10 with intervals, and the distributions behind Table 1, as PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE
from benchmark.records.episode_record import EpisodeRecord
from benchmark.report.published import TITLES
from benchmark.report.tables import EXTRACTORS, STAGES, Table
from vision.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"previous": "#9aa5b1", "paper": "#c98f3c", "focal": "#1f6f8b"}
OTHER_COLOURS = ("#7a4f9a", "#4f9a5d", "#b0413e")
PUBLISHED = "#d1495b"
STYLE = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e5e8eb",
    "axes.axisbelow": True,
    "figure.dpi": 150,
}


def save_figures(table: Table, records: Sequence[EpisodeRecord], directory: Path) -> list[Path]:
    """Draw ``fig10.png`` and ``errors.png`` into a directory, and ``reliability.png`` where poses have a probability.

    Args:
        table: of the sweep.
        records: of the sweep, for the single errors.
        directory: made where it does not exist.

    Returns:
        The paths of the files.

    Raises:
        InputError: the directory cannot be written.
    """
    with matplotlib.rc_context(STYLE):
        figures = {"fig10.png": draw_fig10(table), "errors.png": draw_errors(table, records)}
        if table.reliability:
            figures["reliability.png"] = draw_reliability(table)
        return write_figures(figures, directory)


def write_figures(figures: dict[str, Figure], directory: Path) -> list[Path]:
    """Write figures under their file names, and close them.

    Raises:
        InputError: the directory cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            figure.savefig(directory / name)
    except OSError as error:
        raise InputError(f"figures in {directory}", got=error.strerror, expected="a writable directory") from None
    finally:
        for figure in figures.values():
            plt.close(figure)
    return [directory / name for name in figures]


def draw_fig10(table: Table) -> Figure:
    """The paper's Fig. 10 over pieces at least half visible: bars with Wilson intervals and the published rates."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), sharey=True, layout="constrained")
    for ax, stage, letter in zip(axes, STAGES, "ab", strict=True):
        _draw_rates(ax, table, stage)
        ax.set_title(f"({letter}) Feature {stage} success", loc="left", fontweight="bold")
    axes[0].set_ylabel(f"of pieces at least {HALF_VISIBLE:.0%} visible")
    axes[0].yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure


def draw_reliability(table: Table) -> Figure:
    """How often poses are right against the probability with which they say so; on the diagonal where it is true."""
    figure, ax = plt.subplots(figsize=(5, 4.6), layout="constrained")
    ax.plot([0, 1], [0, 1], color="#9aa5b1", linewidth=1)
    for i, (method, rows) in enumerate(table.reliability.items()):
        shown = [row for row in rows if row.right.n]
        said, right = ([getattr(row, name) for row in shown] for name in ("said", "right"))
        rates, low, high = (np.array([getattr(rate, name) for rate in right]) for name in ("rate", "low", "high"))
        colour = _colour(method, i)
        ax.errorbar(said, rates, np.clip([rates - low, high - rates], 0, None), fmt="o", color=colour, label=method)
    ax.set(xlabel="probability that the pose says", ylabel="right", xlim=(0, 1.02), ylim=(0, 1.02))
    ax.legend(frameon=False, loc="upper left")
    return figure


def _draw_rates(ax: Axes, table: Table, stage: str) -> None:
    methods = [method for method in table.shown if method not in EXTRACTORS] or list(table.shown)
    width = 0.8 / len(methods)
    positions = np.arange(len(table.parts))
    for i, method in enumerate(methods):
        x = positions + (i - (len(methods) - 1) / 2) * width
        rates = [table.find_success(part, method, stage, HALF_VISIBLE).rate for part in table.parts]
        ax.bar(x, [rate.rate or 0.0 for rate in rates], width * 0.92, color=_colour(method, i), label=method)
        for xi, rate in zip(x, rates, strict=True):
            if rate.rate is not None and rate.low is not None and rate.high is not None:
                reach = [[rate.rate - rate.low], [rate.high - rate.rate]]
                ax.errorbar(xi, rate.rate, reach, color="#222222", linewidth=1.2, capsize=3)
    if "paper" in methods:
        at = positions + (methods.index("paper") - (len(methods) - 1) / 2) * width
        _draw_published(ax, table, stage, at, width)
    counts = [
        {table.find_success(part, method, stage, HALF_VISIBLE).rate.n for method in methods} for part in table.parts
    ]
    labels = [
        f"{TITLES.get(p, p)}\nn = {' / '.join(map(str, sorted(n)))}" for p, n in zip(table.parts, counts, strict=True)
    ]
    ax.set_xticks(positions, labels)
    ax.tick_params(axis="x", length=0)
    ax.set_ylim(0, 1.03)


def _draw_published(ax: Axes, table: Table, stage: str, centres: NDArray[np.floating], width: float) -> None:
    label = "paper, published (all pieces)"
    for x, part in zip(centres, table.parts, strict=True):
        published = table.find_success(part, "paper", stage, HALF_VISIBLE).published
        if published is not None:
            ax.hlines(published, x - width * 0.55, x + width * 0.55, color=PUBLISHED, linewidth=2.2, label=label)
            label = "_nolegend_"  # once is enough


def draw_errors(table: Table, records: Sequence[EpisodeRecord]) -> Figure:
    """Every matched piece's translation and tilt error by part and localizer; bars mark the median and quartiles."""
    methods = [method for method in table.shown if method not in EXTRACTORS] or list(table.shown)
    order = [(part, method) for part in table.parts for method in methods]
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.6), layout="constrained")
    titles = {"translation_mm": "Translation error (mm)", "tilt_deg": "Tilt error (°)"}
    for ax, (quantity, title) in zip(axes, titles.items(), strict=True):
        for i, (part, method) in enumerate(order):
            _draw_cloud(ax, i, _matched_errors(records, part, method, quantity), _colour(method, i))
        labels = [f"{TITLES.get(part, part)}\n{method}" for part, method in order]
        ax.set_xticks(range(len(order)), labels, rotation=30, ha="right", rotation_mode="anchor", fontsize=8)
        ax.set_xlim(-0.6, len(order) - 0.4)
        ax.set_ylim(bottom=0)
        ax.set_title(title, loc="left", fontweight="bold")
    return figure


def _draw_cloud(ax: Axes, position: int, values: Sequence[float], colour: str) -> None:
    if not values:
        ax.text(position, 0, "n=0", ha="center", va="bottom", color="#555555", fontsize=8)
        return
    ordered = np.sort(values)
    # Neighbouring values get different offsets: a golden-ratio sequence spreads them without randomness.
    spread = (np.arange(len(ordered)) * 0.6180339887 % 1 - 0.5) * 0.6
    ax.scatter(position + spread, ordered, s=9, color=colour, alpha=0.55, linewidths=0)
    low, median, high = np.quantile(ordered, [0.25, 0.5, 0.75])
    ax.vlines(position, low, high, color="#222222", linewidth=1.4)
    ax.hlines(median, position - 0.3, position + 0.3, color="#222222", linewidth=2)


def _matched_errors(records: Sequence[EpisodeRecord], part: str, method: str, quantity: str) -> list[float]:
    """Errors of the pieces that Table 1 is made of."""
    pieces = [p for record in records if record.error is None for p in record.pieces]
    counted = [p for p in pieces if p.part == part and p.in_bin and p.visibility >= BARELY_VISIBLE]
    results = [p.results[method] for p in counted if method in p.results]
    values = [getattr(r.errors, quantity) for r in results if r.matched and r.errors is not None]
    return [value for value in values if value is not None]


def _colour(method: str, i: int) -> str:
    return COLOURS.get(method, OTHER_COLOURS[i % len(OTHER_COLOURS)])
