"""What follows from a feature's marks: fitted ellipses, the circle behind them, and which click does not belong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse
from vision.teaching.circle_refinement import refine_circle
from vision.teaching.document import MarkedFeature, Point
from vision.teaching.guides import ClickErrors, click_errors, faces
from vision.teaching.snapping import MINIMUM_CLICKS, ellipse_through, snap_to_edge
from vision.teaching.triangulation import TriangulatedCircle, triangulate_circle

Array = NDArray[np.float64]

LARGEST_RESIDUAL_PX = 1.0
"""Views whose marks are further from the common circle than this are called inconsistent."""

STRAY_PX = 6.0  # a click this far from the ellipse through the others does not belong to it
OFF_AXIS = 0.04  # of the radius; less is taken as on the axis, or the model takes it
UPRIGHT_COSINE = 0.99
MOST_CLICKS = 40  # more are no clicks, and need no suspicion


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Mark:
    """The marks of a feature in one view.

    Attributes:
        points: (N, 2) as the person set them.
        ellipse: the fitted one, snapped to the edge where there is one; None below five points, or of no ellipse.
        edge_points: (M, 2) the points on the edge that it was fitted to.
        residual_px: root mean square distance of these points from it.
        suspects: numbers of the points that do not belong to the others.
        problem: why there is no ellipse, or "".
    """

    points: Array
    ellipse: Ellipse | None = None
    edge_points: Array | None = None
    residual_px: float = 0.0
    suspects: tuple[int, ...] = ()
    problem: str = ""

    @property
    def snapped(self) -> bool:
        """Whether an edge was found along the points."""
        return self.edge_points is not None and len(self.edge_points) != len(self.points)


@dataclass(frozen=True, eq=False)
class Finding:
    """A feature and what follows from its marks.

    Attributes:
        feature: as it stands in the document.
        marks: by number of the view.
        solution: the triangulated circle; None below two views.
        refined: whether it is the very circle that the model will have, see ``Inspector.refine``.
        errors: distance of the edge points from its image, by number of the view.
        inconsistent: views whose marks disagree with the others.
        message: one sentence that says what is wrong, or "".
    """

    feature: MarkedFeature
    marks: Mapping[int, Mark] = field(default_factory=dict)
    solution: TriangulatedCircle | None = None
    refined: bool = False
    errors: Mapping[int, ClickErrors] = field(default_factory=dict)
    inconsistent: tuple[int, ...] = ()
    message: str = ""

    @property
    def circle(self) -> Circle | None:
        """The circle in the part's frame."""
        return self.solution.circle if self.solution else None

    @property
    def trouble(self) -> bool:
        """Whether something about the marks does not fit."""
        return bool(self.message)


class Inspector:
    """Works findings out; what it has seen before it does not work out again."""

    def __init__(self, views: Sequence[View]) -> None:
        """Prepare the edges of all views, distortion-free ones."""
        self.views = views
        self.edges = [EdgeField.from_gray(view.gray) for view in views]
        self._marks: dict[tuple[int, tuple[Point, ...]], Mark] = {}
        self._findings: dict[str, Finding] = {}
        _warm_up()

    def find(self, feature: MarkedFeature) -> Finding:
        """What follows from a feature's marks."""
        known = self._findings.get(feature.feature_id)
        if known and known.feature == feature:
            return known
        if known and (known.feature.marks, known.feature.role) == (feature.marks, feature.role):
            finding = replace(known, feature=feature)
        else:
            finding = self._work_out(feature)
        self._findings[feature.feature_id] = finding
        return finding

    def refine(self, features: Sequence[MarkedFeature]) -> bool:
        """Take the last step towards the circle of one feature that has not had it; says whether there was one.

        It is too slow for the answer to a click, so it waits until the person pauses.
        """
        for finding in map(self.find, features):
            solution = finding.solution
            if solution is None or finding.refined:
                continue
            agreeing = sorted(set(finding.errors) - set(finding.inconsistent))
            circle = refine_circle(solution.circle, solution.freedom, agreeing, self.views, self.edges)
            refined = replace(finding, solution=replace(solution, circle=circle), refined=True)
            errors = self._errors(circle, finding.marks)
            self._findings[finding.feature.feature_id] = replace(refined, errors=errors)
            return True
        return False

    def _errors(self, circle: Circle, marks: Mapping[int, Mark]) -> dict[int, ClickErrors]:
        points = {v: m.edge_points for v, m in marks.items() if m.edge_points is not None}
        errors = {v: click_errors(circle, self.views[v], p) for v, p in points.items()}
        return {v: e for v, e in errors.items() if e is not None}

    def mark(self, number: int, points: Sequence[Point]) -> Mark:
        """What follows from points in one view."""
        key = (number, tuple(points))
        if key not in self._marks:
            if len(self._marks) > 2000:
                self._marks.clear()
            self._marks[key] = _fit(np.array(points), self.edges[number])
        return self._marks[key]

    def _work_out(self, feature: MarkedFeature) -> Finding:
        marks = {v: self.mark(v, points) for v, points in sorted(feature.marks.items())}
        usable = {v: m.edge_points for v, m in marks.items() if m.ellipse is not None and m.edge_points is not None}
        finding = Finding(feature, marks)
        if len(usable) >= 2:
            try:
                solution = triangulate_circle(self.views, usable, coaxial=feature.role == "salient")
            except InputError as error:
                return replace(finding, message=f"These marks make no circle: {error.got}.")
            errors = self._errors(solution.circle, marks)
            wrong = _inconsistent(solution)
            finding = replace(finding, solution=solution, errors=errors, inconsistent=wrong)
        return replace(finding, message=self._complaint(finding, usable))

    def _complaint(self, finding: Finding, usable: Mapping[int, Array]) -> str:
        """What does not fit, in words, the plainest thing first."""
        for v, mark in finding.marks.items():
            if mark.suspects:
                clicks = ", ".join(str(i + 1) for i in mark.suspects)
                return (
                    f"Click {clicks} in {self._name(v)} is not on the ellipse of the others. Drag it, or delete it."
                )
            if mark.problem:
                return f"The points in {self._name(v)} make no ellipse: {mark.problem}."
        if not finding.inconsistent:
            return _off_the_axis(finding)
        if len(usable) == 2:
            first, second = (self._name(v) for v in usable)
            return f"{first} and {second} disagree. Mark a third view to see which of them is wrong."
        worst = max(finding.inconsistent, key=lambda v: finding.errors[v].rms_px)
        return self._accuse(finding, usable, worst)

    def _accuse(self, finding: Finding, usable: Mapping[int, Array], view: int) -> str:
        """Name the view, and its click that is furthest from what the other views say."""
        others = {v: points for v, points in usable.items() if v != view}
        try:
            circle = triangulate_circle(self.views, others, coaxial=finding.feature.role == "salient").circle
        except InputError:
            return f"{self._name(view)} disagrees with the other views. Look at its marks again."
        clicks = finding.marks[view].points
        errors = click_errors(circle, self.views[view], clicks)
        if errors is None or len(clicks) > MOST_CLICKS:
            return f"{self._name(view)} disagrees with the other views. Look at its marks again."
        furthest = int(np.argmax(np.abs(errors.px)))
        return (
            f"{self._name(view)} disagrees with the other views: its click {furthest + 1} is "
            f"{abs(errors.px[furthest]):.1f} px off their circle. Move it, or clear this view."
        )

    def _name(self, view: int) -> str:
        return self.views[view].name

    def shown_in(self, finding: Finding) -> dict[int, Ellipse]:
        """The image of the circle in every view that faces it."""
        circle = finding.circle
        if circle is None:
            return {}
        images = {v: project_circle(circle, view) for v, view in enumerate(self.views) if faces(circle, view)}
        return {v: image for v, image in images.items() if image is not None}


def _inconsistent(solution: TriangulatedCircle) -> tuple[int, ...]:
    """Views that disagree; of two, one is as likely to be wrong as the other."""
    residual_px = solution.residual_px
    if len(residual_px) == 2:
        return tuple(residual_px) if max(residual_px.values()) > LARGEST_RESIDUAL_PX else ()
    return tuple(solution.inconsistent(LARGEST_RESIDUAL_PX))


def _off_the_axis(finding: Finding) -> str:
    """What a salient circle lacks that is not around the axis; the model would refuse it."""
    circle = finding.circle
    if circle is None or finding.feature.role != "salient":
        return ""
    off_m = float(np.hypot(*circle.centre[:2]))
    if off_m <= OFF_AXIS * circle.radius_m and abs(circle.normal[2]) > UPRIGHT_COSINE:
        return ""
    return (
        f"This circle is {1e3 * off_m:.1f} mm off the axis, or tilted, and salient ones are around it. "
        "Make it supporting, or look at its marks again."
    )


def _warm_up() -> None:
    """Fit a drawn disc: the first fit loads what the others use, and nobody's first click should wait for that."""
    disc = cv2.circle(np.zeros((120, 120), np.uint8), (60, 60), 40, 200, -1)
    _fit(Ellipse.from_geometric(60, 60, 40, 40, 0.0).sample(8), EdgeField.from_gray(np.asarray(disc, np.uint8)))


def _fit(points: Array, edges: EdgeField) -> Mark:
    if len(points) < MINIMUM_CLICKS:
        return Mark(points)
    try:
        ellipse, edge_points = snap_to_edge(points, edges)
    except InputError as error:
        return Mark(points, problem=str(error.got))
    residual = float(np.sqrt(np.mean(ellipse.distance(edge_points) ** 2)))
    return Mark(points, ellipse, edge_points, residual, _strays(points, ellipse))


def _strays(points: Array, ellipse: Ellipse) -> tuple[int, ...]:
    """Points that are far from the ellipse through the others, where the others agree among themselves."""
    if not MINIMUM_CLICKS < len(points) <= MOST_CLICKS:
        return ()
    if np.abs(ellipse.distance(points)).max() < 0.5 * STRAY_PX:
        return ()
    worst: tuple[float, int] = (STRAY_PX, -1)
    for i in range(len(points)):
        rest = np.delete(points, i, axis=0)
        try:
            without = ellipse_through(rest)
        except InputError:
            continue
        agreement = float(np.sqrt(np.mean(without.distance(rest) ** 2)))
        off = float(np.abs(without.distance(points[i : i + 1])[0]))
        if off > max(worst[0], 4 * agreement):
            worst = (off, i)
    return (worst[1],) if worst[1] >= 0 else ()
