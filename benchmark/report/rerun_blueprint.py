"""How the rerun viewer arranges a recorded episode: the cell on the left, the images on the right, texts below."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from benchmark.report.rerun_scene import TIME
from benchmark.world.scene import CellConfig
from vision.drawing.explain import PANELS

VIEWS, LOCALIZED = "world/views", "world/localized"
OUTCOME, ERRORS, EVENTS, CHARTS = "outcome", "errors", "events", "charts"

LAYERS = {
    "Regions (Fig. 7)": ("regions",),
    "Fragments (Fig. 8 a)": ("fragments",),
    "Extracted ellipses (Figs. 11 a, b, 12 a)": ("ellipses/region", "ellipses/group"),
    "Superimposed models (Figs. 11 c, 12 b)": ("models",),
}
"""What is drawn over a picture: title, and the entities below the picture's own."""

_FAR_DISTANCE_M, _FAR_TARGET = 1.9, (0.41, -0.2, 0.87)
_EYE_OFFSET = (2.15, 1.5, 1.0)
_BACKGROUND = (52, 56, 62)


def view_entity(index: int) -> str:
    """The entity path of a viewpoint: a pinhole camera, with its picture and the drawings below."""
    return f"{VIEWS}/{index + 1}"


def stage_entity(index: int, panel: str) -> str:
    """The entity path of a panel of a viewpoint, one of :data:`vision.drawing.explain.PANELS`."""
    return f"{view_entity(index)}/explain/{panel}"


def episode_blueprint(cell: CellConfig, views: int) -> rrb.Blueprint:
    """The arrangement for an episode with so many views."""
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(_cell_view(cell, views), _images(views), column_shares=[1, 1]),
            rrb.Horizontal(
                rrb.TextDocumentView(origin=OUTCOME, name="Outcome"),
                rrb.TextDocumentView(origin=ERRORS, name="Errors"),
                rrb.Tabs(
                    rrb.BarChartView(origin=f"{CHARTS}/translation_mm", name="Translation error, mm, by piece"),
                    rrb.BarChartView(origin=f"{CHARTS}/tilt_deg", name="Tilt error, degrees, by piece"),
                    rrb.TextLogView(origin=EVENTS, name="Events"),
                    active_tab=0,
                ),
                column_shares=[2, 3, 2],
            ),
            row_shares=[5, 2],
        ),
        # Following shows the end, when everything is there; from there people go back in time.
        rrb.TimePanel(state="collapsed", timeline=TIME, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _cell_view(cell: CellConfig, views: int) -> rrb.Spatial3DView:
    # The larger the camera's distance, the more of the arm is of interest; a small bin is looked at from nearby.
    far = min(cell.camera_distance_m / _FAR_DISTANCE_M, 1.0)
    near_target = np.add(cell.bin_centre_m, (0.0, 0.0, 0.45 * cell.camera_distance_m))
    target = near_target + far**2 * (_FAR_TARGET - near_target)
    eye = target + (0.15 + 0.85 * far) * np.array(_EYE_OFFSET)
    # Of the drawings, the superimposed models alone stay readable on the small pictures in space.
    hidden = [
        f"- /{view_entity(index)}/{layer}/**"
        for index in range(views)
        for layer in ("regions", "fragments", "ellipses", "explain")
    ]
    return rrb.Spatial3DView(
        origin="world",
        contents=["+ /world/**", *hidden],
        name="Cell",
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0, 0, 1)),
    )


def _images(views: int) -> rrb.Tabs:
    tabs = [rrb.Grid(*_layers(index), grid_columns=2, name=f"View {index + 1}") for index in range(views)]
    tabs += [rrb.Grid(*_stages(index), grid_columns=3, name=f"Stages {index + 1}") for index in range(views)]
    return rrb.Tabs(*tabs, active_tab=0, name="Images")


def _stages(index: int) -> list[rrb.Spatial2DView]:
    return [rrb.Spatial2DView(origin=stage_entity(index, panel), name=panel) for panel in PANELS]


def _layers(index: int) -> list[rrb.Spatial2DView]:
    origin = view_entity(index)
    return [
        rrb.Spatial2DView(
            origin=origin,
            contents=[f"+ /{origin}", f"+ /{origin}/image", *(f"+ /{origin}/{layer}/**" for layer in layers)],
            name=title,
        )
        for title, layers in LAYERS.items()
    ]
