"""A simulated person who teaches a part: sees its rims in the views and clicks near them.

Stands in for the human of Section 4 where a model is to be made without one. The person's eye is the ground truth of
the part's rims, the hand adds an error to every click. Everything it does is an event of a teaching session, as on
the teaching page, and the vision system gets these events and the views alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.world.part import Part, Rim
from benchmark.world.parts import get_part
from benchmark.world.sensor import SensorConfig, sensor_config
from benchmark.world.studio import Sitter, Studio
from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.features import Extractor
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.model.vision_model import VisionModel
from vision.teaching import events as ev
from vision.teaching.lesson import locate
from vision.teaching.session import Session, build_model

Array = NDArray[np.float64]

SMALLEST_RADIUS_PX = 4.0
SMALLEST_FACING_COSINE = 0.35
FAINTEST_EDGE = 5.0  # grey levels per pixel of the smoothed picture; a step of 15 levels
CLOSEST_PX = 5.0
LARGEST_RESIDUAL_PX = 1.0
SECONDS_PER_EVENT = 1.5
STRATEGIES: dict[str, dict[str, Extractor]] = {
    "hub": {"outline": "region", "salient": "group", "supporting": "region"},
    "cover1": {"salient": "region", "supporting": "group"},
    "cover2": {"salient": "group", "supporting": "region"},
}
"""The paper's strategies (Section 7): which extractor is to look for a part's salient and supporting features.

The hub has both for its salient ones: region growing for the outlines, edge grouping for bores and hollows.
"""


@dataclass(frozen=True)
class Operator:
    """How a person clicks.

    Attributes:
        click_sigma_px: standard deviation of a click across and along the contour.
        clicks: number of clicks per contour.
        views: in how many views the person marks a feature, at most; None for all that show it.
        seed: of the hand.
    """

    click_sigma_px: float = 1.0
    clicks: int = 12
    views: int | None = None
    seed: int = 0


def teach(name: str, operator: Operator | None = None, sensor: SensorConfig | None = None) -> VisionModel:
    """Teach a part of the benchmark.

    Args:
        name: of the part.
        operator: who teaches.
        sensor: the camera's imperfections; the paper taught in the laboratory.

    Raises:
        InputError: for an unknown part.
        ResourceError: when the machine cannot draw.
    """
    session, views = record(name, operator, sensor)
    return build_model(session, views)


def record(
    part: str | Part, operator: Operator | None = None, sensor: SensorConfig | None = None
) -> tuple[Session, list[View]]:
    """Have a part taught, and keep everything that was done; errors as of `teach`.

    Args:
        part: its name, or any part whose rims are known.
        operator: who teaches.
        sensor: the camera's imperfections.

    Returns:
        The session, and the grey views that it was recorded on.
    """
    operator, sensor = operator or Operator(), sensor or sensor_config("lab")
    part = get_part(part) if isinstance(part, str) else part
    with Studio(Sitter(part.visual_mesh, part.diameter_m, part.rgba)) as studio:
        views = [replace(view, image=view.gray) for view in studio.photograph(sensor, operator.seed)]
        person = _Person(part, views, studio, operator)
        person.teach()
    return person.session, views


class _Person:
    """Sits at the teaching page."""

    def __init__(self, part: Part, views: Sequence[View], studio: Studio, operator: Operator) -> None:
        self.session = Session.start(views)
        self._part, self._views, self._studio, self._operator = part, views, studio, operator
        self._edges = [EdgeField.from_gray(view.gray) for view in views]
        self._rng = np.random.default_rng(operator.seed)

    def teach(self) -> None:
        """Describe the part, mark what can be told apart, place the grasps, point out the bore."""
        part = self._part
        self._do(ev.DescribePart(part.name, part.diameter_m, part.symmetry.fold))
        shown = {rim: _views_that_show(rim, self._views, self._studio) for rim in part.rims}
        shown = {rim: seen for rim, seen in shown.items() if len(seen) >= 2}
        for rim in _clearest(shown, self._views, self._edges):
            self._mark(rim, shown[rim])
            self._choose_extractor(rim)
            self._make_consistent(rim.name)
        for grasp in part.grasps:
            pose = ev.matrix_of(grasp.T_part_tcp)
            self._do(ev.PlaceGrasp(grasp.name, grasp.name, pose, grasp.width_m, grasp.kind, grasp.copies))
        if part.bore is not None:
            bore = part.bore
            self._do(ev.SetBore(ev.matrix_of(bore.T_part_bore), bore.diameter_m, bore.depth_m))

    def _do(self, event: ev.Event) -> None:
        time_s = SECONDS_PER_EVENT * (len(self.session.events) + 1)
        self.session = self.session.do(replace(event, time_s=time_s))

    def _mark(self, rim: Rim, seen: dict[int, Array]) -> None:
        """Click along the rim in the views that show it."""
        self._do(ev.AddFeature(rim.name, rim.name, "supporting" if rim.offset_m else "salient"))
        if rim.copies > 1:
            self._do(ev.SetCopies(rim.name, rim.copies))
        for number in list(seen)[: self._operator.views]:
            for x, y in _click(seen[number], self._views[number], self._operator, self._rng):
                self._do(ev.AddPoint(rim.name, number, float(x), float(y)))

    def _choose_extractor(self, rim: Rim) -> None:
        """Follow the paper's strategy, or what the system proposes where the paper has none."""
        strategy = STRATEGIES.get(self._part.name, {})
        role = "supporting" if rim.offset_m else "outline" if rim.name.startswith("outline") else "salient"
        extractor = strategy.get(role, strategy.get("salient"))
        if extractor is not None:
            self._do(ev.SetExtractor(rim.name, extractor))

    def _make_consistent(self, feature_id: str) -> None:
        """Unmark the views that the system calls inconsistent, the worst first; give up at less than two."""
        while len(self.session.document.feature(feature_id).contours) >= 2:
            try:
                circle = locate(self.session.document.feature(feature_id).taught(), self._views, self._edges)
            except InputError:  # the page says that these marks make no circle
                break
            wrong = circle.inconsistent(LARGEST_RESIDUAL_PX)
            if not wrong:
                return
            worst = max(wrong, key=lambda number: circle.residual_px[number])
            self._do(ev.ClearMarks(feature_id, worst))
        self._do(ev.RemoveFeature(feature_id))


def _circle(rim: Rim) -> Circle:
    return Circle(np.array([rim.offset_m, 0.0, rim.z_m]), np.array([0.0, 0.0, float(rim.side)]), rim.radius_m)


def _views_that_show(rim: Rim, views: Sequence[View], studio: Studio) -> dict[int, Array]:
    """Points (N, 3) of the rim that the eye can see, by view, for the views that show most of it."""
    circle = _circle(rim)
    shown: dict[int, Array] = {}
    for number, view in enumerate(views):
        towards = view.T_world_camera.translation - circle.centre
        distance = float(np.linalg.norm(towards))
        radius_px = rim.radius_m * view.camera.fx / distance
        if circle.normal @ towards / distance < SMALLEST_FACING_COSINE or radius_px < SMALLEST_RADIUS_PX:
            continue
        points = circle.sample(72)
        clear = studio.sees(view, points + 1e-3 * rim.radius_m * circle.normal)
        if clear.mean() > 0.6:
            shown[number] = points[clear]
    return shown


def _clearest(shown: dict[Rim, dict[int, Array]], views: Sequence[View], edges: Sequence[EdgeField]) -> list[Rim]:
    """Keeps the rim with the clearest edge of those that nearly coincide in the pictures, such as a chamfer's two."""
    strength = {rim: _edge_strength(rim, shown[rim], views, edges) for rim in shown}
    kept: list[Rim] = []
    for rim in sorted(shown, key=lambda r: -strength[r]):
        if strength[rim] >= FAINTEST_EDGE and all(_apart_px(rim, other, shown, views) > CLOSEST_PX for other in kept):
            kept.append(rim)
    return [rim for rim in shown if rim in kept]


def _edge_strength(rim: Rim, seen: dict[int, Array], views: Sequence[View], edges: Sequence[EdgeField]) -> float:
    """Median contrast across the rim in grey levels per pixel, over the views."""
    slopes = []
    for number, points in seen.items():
        ellipse = project_circle(_circle(rim), views[number])
        if ellipse is not None:
            pixels = views[number].project(points)
            slopes.append(np.median(np.abs(edges[number].slope(pixels, ellipse.normals(pixels)))))
    return float(np.mean(slopes)) if slopes else 0.0


def _apart_px(a: Rim, b: Rim, shown: dict[Rim, dict[int, Array]], views: Sequence[View]) -> float:
    """Mean distance of the images of two rims over the views that show both; infinite where none does."""
    both = [number for number in shown[a] if number in shown[b]]
    distances = []
    for number in both:
        ellipse = project_circle(_circle(b), views[number])
        if ellipse is not None:
            distances.append(np.median(np.abs(ellipse.distance(views[number].project(shown[a][number])))))
    return float(np.mean(distances)) if distances else np.inf


def _click(points: Array, view: View, operator: Operator, rng: np.random.Generator) -> Array:
    """Clicks (N, 2) near points of a rim, to a hundredth of a pixel."""
    chosen = points[:: max(len(points) // operator.clicks, 1)]
    return np.round(view.project(chosen) + rng.normal(scale=operator.click_sigma_px, size=(len(chosen), 2)), 2)
