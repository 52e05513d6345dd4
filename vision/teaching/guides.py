"""Guides for the person who marks a feature in one more view: epipolar curves, predicted ellipses, clicks' errors.

Pure geometry of the views and of the marks made so far; no image is looked at. The views' world frame is the frame of
the part, which stands on the teaching fixture with its axis along z. Lenses are free of distortion where ellipses
are concerned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse
from vision.geometry.ellipse_fit import fit_ellipse
from vision.teaching.snapping import ellipse_through
from vision.teaching.triangulation import triangulate_circle

Array = NDArray[np.float64]

CURVE_POINTS = 48
MOST_POINTS = 24  # of a view's marks; more make a prediction slow and no better
LARGEST_MISFIT_PX = 2.0  # of marks from an upright circle, before a tilted one is looked for
LEAST_OBLIQUITY = 0.03  # tangent of the angle between sight and axis below which one view tells nothing of height
_NEAREST, _FARTHEST = 0.2, 5.0  # of the distance from the camera to the part
_SEARCH_POINTS = 512


@dataclass(frozen=True, eq=False)
@frozen_arrays
class ClickErrors:
    """How far clicks are from the image of a circle.

    Attributes:
        px: (N,) distance in the image, negative inside.
        mm: (N,) the same on the part, at the distance of the circle's centre.
    """

    px: Array
    mm: Array

    @property
    def rms_px(self) -> float:
        """Root mean square in pixels."""
        return float(np.sqrt(np.mean(self.px**2)))

    @property
    def rms_mm(self) -> float:
        """Root mean square in millimetres."""
        return float(np.sqrt(np.mean(self.mm**2)))


def epipolar_curve(pixel: ArrayLike, view_from: View, view_to: View, *, within_m: float | None = None) -> Array:
    """Where a point seen in one view can be in another one.

    Args:
        pixel: (2,) of the point in ``view_from``.
        view_from: the view in which it was clicked.
        view_to: the view in which to look for it.
        within_m: how far from the world's origin the point can be, for instance half the part's size; None for
            anywhere in the picture.

    Returns:
        A polyline (N, 2) in pixels of ``view_to``, inside its picture; empty where the sight line does not cross it.
    """
    T = view_from.T_world_camera.as_matrix()
    eye, sight = T[:3, 3], T[:3, :3] @ view_from.camera.rays(np.asarray(pixel, dtype=float))[0]
    depths = _depths(eye, sight, within_m)
    if depths is None:
        return np.zeros((0, 2))
    # Even steps of inverse depth are about even steps in the picture.
    inverse = np.linspace(1 / depths[1], 1 / depths[0], _SEARCH_POINTS)
    shown = np.flatnonzero(_inside(_project(eye + sight / inverse[:, None], view_to), view_to))
    if len(shown) < 2:
        return np.zeros((0, 2))
    inverse = np.linspace(inverse[shown[0]], inverse[shown[-1]], CURVE_POINTS)
    curve = _project(eye + sight / inverse[:, None], view_to)
    return np.asarray(curve[_inside(curve, view_to)])


def predict_circle(
    views: Sequence[View], marks: Mapping[int, Array], *, coaxial: bool = True, height_m: float = 0.0
) -> Circle | None:
    """The best guess at a feature's circle, from the views in which it is marked.

    The sight lines cut the plane at height z in a circle whose centre moves with z. In one view it is on the part's
    axis at one height only; two or more views meet at one height in any case. That is quick enough to follow the
    pointer; marks that no upright circle fits are triangulated in full.

    Args:
        views: all views, with distortion-free lenses.
        marks: points (N, 2) on or near the contour, N >= 5, by number of the view.
        coaxial: the circle lies around the part's axis, as salient features do; otherwise it is only upright.
        height_m: where one view does not tell the circle's height, this one is assumed.

    Returns:
        The circle, its normal towards the cameras; None where there are no marks, or where they make no circle.
    """
    if not marks:
        return None
    try:
        thinned = {number: _thinned(points) for number, points in marks.items()}
        drawings = [_draw(views[number], points) for number, points in thinned.items()]
        circle = _upright_circle(drawings, coaxial, height_m)
        if len(marks) == 1 or _fits(circle, views, thinned):
            return circle
        return triangulate_circle(views, thinned, coaxial=coaxial).circle
    except InputError:  # too few points, points on a line, rays that do not meet: nothing to guide anybody with
        return None


def predict_ellipse(
    views: Sequence[View],
    marks: Mapping[int, Array],
    view_to: int,
    *,
    coaxial: bool = True,
    height_m: float = 0.0,
) -> Ellipse | None:
    """Where a feature that is marked in other views will appear in a view.

    Args:
        views: all views, with distortion-free lenses.
        marks: points (N, 2) by number of the view; those in ``view_to`` itself have no say.
        view_to: number of the view.
        coaxial: as in `predict_circle`.
        height_m: as in `predict_circle`.

    Returns:
        The ellipse; None where there is nothing to predict it from, or where the view shows the part's other face.
    """
    others = {number: points for number, points in marks.items() if number != view_to}
    circle = predict_circle(views, others, coaxial=coaxial, height_m=height_m)
    if circle is None or not faces(circle, views[view_to]):
        return None
    return project_circle(circle, views[view_to])


def faces(circle: Circle, view: View) -> bool:
    """Whether the side from which a circle is seen is turned towards a view's camera."""
    return bool(circle.normal @ (view.T_world_camera.translation - circle.centre) > 0)


def click_errors(circle: Circle, view: View, clicks: ArrayLike) -> ClickErrors | None:
    """How far each click (N, 2) is from the image of a circle; None where the circle is not before the camera."""
    ellipse = project_circle(circle, view)
    if ellipse is None:
        return None
    px = ellipse.distance(clicks)
    depth = circle.moved(view.T_world_camera.inv()).centre[2]
    return ClickErrors(px, 1e3 * px * depth / view.camera.fx)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Drawing:
    """What sight lines through an upright circle draw on a plane that is normal to z, at unit distance from the eye.

    Attributes:
        eye: (3,) position of the camera.
        ahead: +1 where the camera looks towards +z, -1 towards -z.
        centre: (2,) of the drawn circle, from the point below the eye.
        radius: of the drawn circle.
    """

    eye: Array
    ahead: float
    centre: Array
    radius: float


def _draw(view: View, points: Array) -> _Drawing:
    T = view.T_world_camera.as_matrix()
    rays = view.camera.rays(points) @ T[:3, :3].T
    if np.abs(rays[:, 2]).min() < 0.05 * np.linalg.norm(rays, axis=1).max():
        raise InputError("view", got="a part seen edge on", expected="one that shows its face")
    centre, radius = _circle_through(rays[:, :2] / np.abs(rays[:, 2:]))
    return _Drawing(T[:3, 3], float(np.sign(rays[0, 2])), centre, radius)


def _upright_circle(drawings: Sequence[_Drawing], coaxial: bool, height_m: float) -> Circle:
    """The circle with normal along z that drawings show: its centre solves linear equations, two for each view."""
    ahead = drawings[0].ahead
    if any(d.ahead != ahead for d in drawings):
        raise InputError("marked views", got="both faces of the part", expected="one of them")
    A = np.vstack([np.column_stack([np.eye(2), -ahead * d.centre]) for d in drawings])
    b = np.concatenate([d.eye[:2] - ahead * d.eye[2] * d.centre for d in drawings])
    if coaxial:
        tells_height = np.linalg.norm(A[:, 2]) > LEAST_OBLIQUITY
        z = float(A[:, 2] @ b / (A[:, 2] @ A[:, 2])) if tells_height else height_m
        centre = np.array([0.0, 0.0, z])
    elif np.linalg.svd(A, compute_uv=False)[-1] * np.sqrt(len(A)) > LEAST_OBLIQUITY and len(drawings) > 1:
        centre = np.linalg.lstsq(A, b, rcond=None)[0]
    else:
        centre = np.array([*(b - A[:, 2] * height_m).reshape(-1, 2).mean(axis=0), height_m])
    distances = [ahead * (centre[2] - d.eye[2]) for d in drawings]
    if min(distances) <= 0:
        raise InputError("marks", got="a circle behind the camera", expected="one before it")
    radius = np.mean([distance * d.radius for distance, d in zip(distances, drawings, strict=True)])
    return Circle(centre, np.array([0.0, 0.0, -ahead]), float(radius))


def _fits(circle: Circle, views: Sequence[View], marks: Mapping[int, Array]) -> bool:
    """Whether the marks of every view are near the circle's image."""
    for number, points in marks.items():
        errors = click_errors(circle, views[number], points)
        if errors is None or errors.rms_px > LARGEST_MISFIT_PX:
            return False
    return True


def _circle_through(points: Array) -> tuple[Array, float]:
    """Centre (2,) and radius of the circle nearest to points (N, 2), by linear least squares."""
    middle = points.mean(axis=0)
    offsets = points - middle
    A = np.column_stack([2 * offsets, np.ones(len(offsets))])
    solution = np.linalg.lstsq(A, (offsets**2).sum(axis=1), rcond=None)[0]
    return middle + solution[:2], float(np.sqrt(solution[2] + solution[:2] @ solution[:2]))


def _thinned(points: ArrayLike) -> Array:
    """At most `MOST_POINTS` points that stand for all: many are replaced by samples of the ellipse through them."""
    array = np.asarray(points, dtype=float)
    if len(array) <= MOST_POINTS:
        ellipse_through(array)  # refuses what makes no ellipse
        return array
    ellipse = fit_ellipse(array) or ellipse_through(array)
    return ellipse.sample(MOST_POINTS)


def _depths(eye: Array, sight: Array, within_m: float | None) -> tuple[float, float] | None:
    """Nearest and farthest depth, in lengths of ``sight``, to look at; None where the sight line passes too far."""
    across = float(sight @ sight)
    middle = float(-(eye @ sight) / across)
    if within_m is None:
        typical = float(np.linalg.norm(eye) / np.sqrt(across))
        return _NEAREST * typical, _FARTHEST * typical
    gap_squared = within_m**2 - float(eye @ eye - middle**2 * across)
    if gap_squared <= 0:
        return None
    half = float(np.sqrt(gap_squared / across))
    if middle + half <= 0:
        return None
    return max(middle - half, 1e-3 * half), middle + half


def _project(points: Array, view: View) -> Array:
    return view.project(points.copy())


def _inside(pixels: Array, view: View) -> NDArray[np.bool_]:
    """Which pixels (N, 2) are in the picture; those behind the camera are NaN and are not."""
    limits = np.array([view.camera.width_px, view.camera.height_px]) - 0.5
    return np.asarray(((pixels >= -0.5) & (pixels <= limits)).all(axis=1))
