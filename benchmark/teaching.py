"""A simulated person who teaches a part: sees its rims in the views and clicks near them.

Stands in for the human of Section 4 where a model is to be made without one. The person's eye is the ground truth of
the part's rims, the hand adds an error to every click; the vision system gets the clicks alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.world.parts import Part, Rim, get_part
from benchmark.world.sensor import SensorConfig, sensor_config
from benchmark.world.studio import Sitter, Studio
from vision.camera import View
from vision.circle_pose import Circle, project_circle
from vision.evidence import EdgeField
from vision.localizer import extract_features
from vision.teaching.lesson import Lesson, TaughtFeature, acquire, locate
from vision.vision_model import BoreCoordinates, GraspCoordinates, Role, VisionModel

Array = NDArray[np.float64]

SMALLEST_RADIUS_PX = 4.0
SMALLEST_FACING_COSINE = 0.35
FAINTEST_EDGE = 5.0  # grey levels per pixel of the smoothed picture; a step of 15 levels
CLOSEST_PX = 5.0
LARGEST_RESIDUAL_PX = 1.0


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
    operator, sensor = operator or Operator(), sensor or sensor_config("lab")
    part = get_part(name)
    with Studio(Sitter(part.visual_mesh, part.diameter_m, part.rgba)) as studio:
        views = studio.photograph(sensor, operator.seed)
        features = mark_features(part, views, studio, operator)
    found = [extract_features(view, ("region", "group")) for view in views]
    lesson = Lesson(part.name, part.diameter_m, features, part.symmetry.fold, grasps_of(part), bore_of(part))
    return acquire(lesson, views, found)


def grasps_of(part: Part) -> tuple[GraspCoordinates, ...]:
    """The grasps that the person places on the part."""
    return tuple(GraspCoordinates(g.name, g.T_part_tcp, g.width_m, g.kind, g.copies) for g in part.grasps)


def bore_of(part: Part) -> BoreCoordinates:
    """The bore that the person points out."""
    return BoreCoordinates(part.bore.T_part_bore, part.bore.diameter_m, part.bore.depth_m)


def mark_features(part: Part, views: Sequence[View], studio: Studio, operator: Operator) -> tuple[TaughtFeature, ...]:
    """Click the rims that a person can tell apart, in every view that shows them."""
    rng = np.random.default_rng(operator.seed)
    shown = {rim: _views_that_show(rim, views, studio) for rim in part.rims}
    edges = [EdgeField.from_gray(view.gray) for view in views]
    features = []
    for rim in _told_apart({rim: seen for rim, seen in shown.items() if len(seen) >= 2}, views, edges):
        numbers = list(shown[rim])[: operator.views]
        clicks = {number: _click(shown[rim][number], views[number], operator, rng) for number in numbers}
        role: Role = "supporting" if rim.offset_m else "salient"
        feature = _made_consistent(TaughtFeature(rim.name, role, clicks, rim.copies), views, edges)
        if feature is not None:
            features.append(feature)
    return tuple(features)


def _made_consistent(
    feature: TaughtFeature, views: Sequence[View], edges: Sequence[EdgeField]
) -> TaughtFeature | None:
    """Unmark the views that the system calls inconsistent, the worst first; give a feature up at less than two."""
    clicks = dict(feature.clicks)
    while len(clicks) >= 2:
        circle = locate(replace(feature, clicks=clicks), views, edges)
        wrong = circle.inconsistent(LARGEST_RESIDUAL_PX)
        if not wrong:
            return replace(feature, clicks=clicks)
        del clicks[max(wrong, key=lambda number: circle.residual_px[number])]
    return None


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


def _told_apart(shown: dict[Rim, dict[int, Array]], views: Sequence[View], edges: Sequence[EdgeField]) -> list[Rim]:
    """Of rims that nearly coincide in the pictures, such as the two of a chamfer, the one with the clearest edge."""
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
    chosen = points[:: max(len(points) // operator.clicks, 1)]
    return view.project(chosen) + rng.normal(scale=operator.click_sigma_px, size=(len(chosen), 2))
