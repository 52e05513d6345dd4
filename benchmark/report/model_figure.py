"""A vision model as a drawing: its circles and patterns, with grasps and bore (Fig. 2 b), from two directions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

from vision.errors import InputError
from vision.model.grasp import GraspCoordinates
from vision.model.vision_model import CircleFeature, Pattern, VisionModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


ROLE_COLOURS = {"salient": "#1f6f8b", "supporting": "#c98f3c"}
ORDER = {"supporting": 2.0, "salient": 2.1}
GRASP_COLOURS = {"outside": "#7a4f9a", "inside": "#b0413e"}
PATTERN_COLOUR = "#4c956c"
BORE_COLOUR = "#e5e8eb"
FINGER_LENGTH = 0.12  # of the part's diameter
STYLE = {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "figure.dpi": 150}


def save_model_figure(model: VisionModel, path: Path) -> None:
    """Draw a model into a PNG.

    Raises:
        InputError: the file cannot be written.
    """
    with matplotlib.rc_context(STYLE):
        figure = draw_model(model)
    try:
        figure.savefig(path, format="png")
    except OSError as error:
        raise InputError(f"drawing {path}", got=error.strerror, expected="a writable path") from None
    finally:
        plt.close(figure)


def draw_model(model: VisionModel) -> Figure:
    """The model seen along its axis and across it, in millimetres."""
    figure, (front, side) = plt.subplots(1, 2, figsize=(11, 6), layout="constrained")
    for feature in model.features:
        _draw_circles(feature, front, (0, 1))
        _draw_circles(feature, side, (0, 2))
    for pattern in model.patterns:
        _draw_pattern(pattern, front, (0, 1))
        _draw_pattern(pattern, side, (0, 2))
    _draw_bore(model, front, side)
    for grasp in model.grasps:
        for axes, columns in ((front, (0, 1)), (side, (0, 2))):
            _draw_grasp(grasp, FINGER_LENGTH * model.diameter_m, axes, columns)
    front.set(title=f"{model.part} from the front", xlabel="x in mm", ylabel="y in mm", aspect="equal")
    side.set(title="from the side, front upwards", xlabel="x in mm", ylabel="z in mm", aspect="equal")
    _name_circles(model, side)
    handles = [plt.Line2D([], [], color=c, label=f"{role} feature") for role, c in ROLE_COLOURS.items()]
    handles.append(plt.Line2D([], [], color="grey", ls="--", label="seen from the back"))
    if model.patterns:
        handles.append(plt.Line2D([], [], color=PATTERN_COLOUR, ls="", marker=".", label="pattern"))
    kinds = {g.kind for g in model.grasps}
    handles += [plt.Line2D([], [], color=c, lw=3, label=f"grasp {k}") for k, c in GRASP_COLOURS.items() if k in kinds]
    if model.bore is not None:
        handles.append(Rectangle((0, 0), 1, 1, color=BORE_COLOUR, label="bore"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    return figure


def _draw_circles(feature: CircleFeature, axes: Axes, columns: tuple[int, int]) -> None:
    dashed = "-" if feature.circle.normal[2] > 0 else "--"
    for circle in feature.circles():
        outline = 1e3 * circle.sample(121)[:, columns]
        outline = np.vstack([outline, outline[:1]])
        axes.plot(*outline.T, color=ROLE_COLOURS[feature.role], ls=dashed, lw=1.2, zorder=ORDER[feature.role])


def _draw_pattern(pattern: Pattern, axes: Axes, columns: tuple[int, int]) -> None:
    dots = 1e3 * pattern.points[:, columns]
    axes.plot(*dots.T, ".", color=PATTERN_COLOUR, ms=2.5, zorder=ORDER["supporting"])


def _draw_bore(model: VisionModel, front: Axes, side: Axes) -> None:
    if model.bore is None:
        return
    entry, depth = model.bore.T_part_bore.as_matrix(), model.bore.depth_m
    ends = 1e3 * np.array([entry[:3, 3], entry[:3, 3] + depth * entry[:3, 2]])
    radius = 500 * model.bore.diameter_m
    front.add_patch(plt.Circle((ends[0, 0], ends[0, 1]), radius, color=BORE_COLOUR, zorder=0))
    low, high = sorted(ends[:, 2])
    side.add_patch(Rectangle((ends[0, 0] - radius, low), 2 * radius, high - low, color=BORE_COLOUR, zorder=0))


def _draw_grasp(grasp: GraspCoordinates, length_m: float, axes: Axes, columns: tuple[int, int]) -> None:
    """The two fingers as bars that end in the tips, and an arrow at each in the direction in which it moves."""
    T = grasp.T_part_tcp.as_matrix()
    opening, approach, tip = T[:3, 0], T[:3, 2], T[:3, 3]
    inwards = -1.0 if grasp.kind == "inside" else 1.0
    for side in (1.0, -1.0):
        contact = tip + side * grasp.width_m / 2 * opening
        finger = 1e3 * np.array([contact, contact - length_m * approach])[:, columns]
        axes.plot(*finger.T, color=GRASP_COLOURS[grasp.kind], lw=3, solid_capstyle="round", marker="o", ms=3)
        start, end = (1e3 * (contact + side * inwards * d * length_m * opening)[list(columns)] for d in (0.6, 0.05))
        arrow = {"arrowstyle": "->", "color": GRASP_COLOURS[grasp.kind]}
        axes.annotate("", xy=(end[0], end[1]), xytext=(start[0], start[1]), arrowprops=arrow)


def _name_circles(model: VisionModel, side: Axes) -> None:
    """Names of the salient circles beside the drawing, pushed apart where they would touch."""
    right = 1e3 * max(float(np.hypot(*f.circle.centre[:2])) + f.circle.radius_m for f in model.features)
    apart = 0.05 * 1e3 * model.diameter_m
    heights: list[float] = []
    for feature in sorted(model.salient, key=lambda f: (float(f.circle.centre[2]), f.circle.radius_m)):
        z = 1e3 * float(feature.circle.centre[2])
        heights.append(max(z, heights[-1] + apart) if heights else z)
        edge = (1e3 * feature.circle.radius_m, z)
        arrow = {"arrowstyle": "-", "color": "#9aa5b1", "lw": 0.6}
        side.annotate(
            feature.name, xy=edge, xytext=(1.1 * right, heights[-1]), fontsize=7, va="center", arrowprops=arrow
        )
