"""The curves of a study as PNG files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

from benchmark.episodes.metrics import Summary, summarise
from benchmark.report.figures import STYLE, write_figures
from benchmark.report.grid import part_title
from benchmark.report.study import CurvePoint, Study

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PART_COLOURS = ("#1f6f8b", "#c98f3c", "#7a4f9a", "#4f9a5d", "#b0413e")
VIEW_COLOURS = {2: "#b8d4de", 3: "#7fb1c2", 4: "#3f88a2", 5: "#123f50"}
MATCHED = "Matched, ≥ half visible"
ERRORS = {"translation_mm": "Translation error (mm)", "rotation_deg": "Rotation error (°)"}
TAUGHT_ERRORS = {"translation_mm": "Translation error (mm)", "tilt_deg": "Tilt error (°)"}


def save_study_figures(study: Study, directory: Path) -> list[Path]:
    """Draw ``calibration.png`` or ``teaching.png`` into a directory.

    Args:
        study: the study.
        directory: made where it does not exist.

    Returns:
        The paths of the files.

    Raises:
        InputError: the directory cannot be written.
    """
    with matplotlib.rc_context(STYLE):
        if study.is_calibration:
            return write_figures({"calibration.png": draw_calibration(study)}, directory)
        return write_figures({"teaching.png": draw_teaching(study)}, directory)


def draw_calibration(study: Study) -> Figure:
    """Success and errors against the hand-eye error, a colour for each part; dashed: what the paper published."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.2), layout="constrained")
    published = {limit.part: limit.published for limit in study.calibration_limits if limit.method == study.method}
    for i, part in enumerate(study.parts):
        curve = sorted(study.curve(part, study.method), key=_hand_eye)
        x = [_hand_eye(point) + 0.012 * (i - (len(study.parts) - 1) / 2) for point in curve]
        line = _Line(x, curve, PART_COLOURS[i % len(PART_COLOURS)], part_title(part))
        _draw_rates(axes[0], line)
        for ax, quantity in zip(axes[1:], ERRORS, strict=True):
            _draw_errors(ax, line, quantity)
            if part in published:
                limit = getattr(published[part], f"{quantity}_mean")
                ax.axhline(limit, color=line.colour, linestyle="--", linewidth=1.1)
    for ax, title in zip(axes, (MATCHED, *ERRORS.values()), strict=True):
        ax.set_title(title, loc="left", fontweight="bold")
        ax.set_xlabel("hand-eye error (mm), with 0.2° per mm")
        ax.set_ylim(bottom=0)
    _as_share(axes[0])
    axes[0].plot([], [], color="#555555", linestyle="--", linewidth=1.1, label="published")
    _legend(figure, axes[0])
    return figure


def draw_teaching(study: Study) -> Figure:
    """Success and errors against the click error, a column for each part and a shade for each number of views."""
    size = (4.2 * len(study.parts) + 0.6, 11)
    figure, axes = plt.subplots(4, len(study.parts), figsize=size, sharex=True, layout="constrained", squeeze=False)
    for column, part in zip(axes.T, study.parts, strict=True):
        curve = study.curve(part, study.method)
        for i, views in enumerate(sorted({point.variant.taught_views or 0 for point in curve})):
            points = sorted((point for point in curve if point.variant.taught_views == views), key=_click)
            x = [_click(point) + 0.07 * (i - 1.5) for point in points]
            line = _Line(x, points, VIEW_COLOURS.get(views, PART_COLOURS[0]), f"{views} views")
            _draw_rates(column[0], line)
            for ax, quantity in zip(column[1:-1], TAUGHT_ERRORS, strict=True):
                _draw_errors(ax, line, quantity)
            circles = [study.circles.get((point.variant, part)) for point in points]
            _draw_summaries(column[-1], line, [summarise([]) if c is None else c.centre_mm for c in circles])
        for ax in column[1:]:
            ax.set_ylim(bottom=0)
        _as_share(column[0])
        column[0].set_title(part_title(part), loc="left", fontweight="bold")
        column[-1].set_xlabel("error of a click (px)")
    for ax, label in zip(axes[:, 0], (MATCHED, *TAUGHT_ERRORS.values(), "Taught circles' centres (mm)"), strict=True):
        ax.set_ylabel(label)
    _legend(figure, axes[0, 0])
    return figure


@dataclass(frozen=True)
class _Line:
    """A curve as it is drawn: lines side by side stand a little apart, so that their bars can be told."""

    x: Sequence[float]
    points: Sequence[CurvePoint]
    colour: str
    label: str

    def draw(self, ax: Axes, values: Sequence[tuple[float | None, float | None, float | None]]) -> None:
        """Draw (low, value, high) of each point; what is None is left out."""
        shown = [(x, *value) for x, value in zip(self.x, values, strict=True) if value[1] is not None]
        x, low, value, high = np.array(shown, dtype=float).reshape(-1, 4).T
        ax.plot(x, value, color=self.colour, marker="o", markersize=4, label=self.label)
        ax.vlines(x, low, high, color=self.colour, linewidth=1, alpha=0.6)


def _draw_rates(ax: Axes, line: _Line) -> None:
    """Matching success with Wilson intervals."""
    rates = [point.half_visible for point in line.points]
    line.draw(ax, [(rate.low, rate.rate, rate.high) for rate in rates])


def _draw_errors(ax: Axes, line: _Line, quantity: str) -> None:
    """The error of the matched pieces."""
    _draw_summaries(ax, line, [point.errors[quantity] for point in line.points])


def _draw_summaries(ax: Axes, line: _Line, summaries: Sequence[Summary]) -> None:
    """The means, with a line of one standard deviation to either side."""
    spreads = [(s.mean, s.std or 0.0) if s.mean is not None else (0.0, 0.0) for s in summaries]
    bars = [(max(mean - spread, 0.0), mean + spread) for mean, spread in spreads]
    line.draw(ax, [(low, s.mean, high) for s, (low, high) in zip(summaries, bars, strict=True)])


def _as_share(ax: Axes) -> None:
    ax.set_ylim(0, 1.03)
    ax.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1.0))


def _legend(figure: Figure, ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=max(len(handles), 1), frameon=False)


def _hand_eye(point: CurvePoint) -> float:
    return point.variant.hand_eye_mm or 0.0


def _click(point: CurvePoint) -> float:
    return point.variant.click_sigma_px or 0.0
