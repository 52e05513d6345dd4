"""The 3D circle behind contours that a person marked in two or more views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vision.camera import View
from vision.circle_pose import Circle, circle_conics, circle_poses, plane_axes
from vision.ellipse import Ellipse
from vision.errors import InputError
from vision.teaching.snapping import ellipse_through

Array = NDArray[np.float64]

UPRIGHT_TOLERANCE_RAD = float(np.radians(8.0))
ON_AXIS_TOLERANCE = 0.1  # of the radius


@dataclass(frozen=True, eq=False)
class TriangulatedCircle:
    """A circle in the world and how well the views agree on it.

    Attributes:
        circle: the circle; its normal faces the cameras.
        residual_px: root mean square distance of the marked points from its image, by number of the view.
        centre_sigma_m: standard deviation of the centre, the largest over directions.
        normal_sigma_rad: standard deviation of the direction of the normal.
        radius_sigma_m: standard deviation of the radius.
    """

    circle: Circle
    residual_px: Mapping[int, float]
    centre_sigma_m: float
    normal_sigma_rad: float
    radius_sigma_m: float

    def inconsistent(self, limit_px: float = 2.0) -> list[int]:
        """Views whose marks disagree with the others ('verify its inputs with consistency constraints')."""
        typical = float(np.median(list(self.residual_px.values())))
        return [v for v, r in self.residual_px.items() if r > max(limit_px, 3 * typical)]


def triangulate_circle(
    views: Sequence[View], marks: Mapping[int, Array], *, coaxial: bool = False
) -> TriangulatedCircle:
    """Stereo triangulation of a circle (Section 4), then least squares over all marks.

    A circle that comes out nearly upright, its normal along z within 8 degrees, is taken as upright: so are the
    rims and holes of turned parts, whose axis the teaching fixture knows.

    Args:
        views: with distortion-free lenses.
        marks: edge points (N, 2), N >= 5, by number of the view; at least two views.
        coaxial: an upright circle also has its centre on the z axis.

    Raises:
        InputError: for fewer than two views, or rays that do not meet in front of the cameras.
    """
    if len(marks) < 2:
        raise InputError("marked views", got=len(marks), expected="at least two", do="Mark the feature once more.")
    free = _fit(views, marks, _linear_circle(views, {v: ellipse_through(p) for v, p in marks.items()}), np.eye(6))
    if abs(free.circle.normal[2]) < np.cos(UPRIGHT_TOLERANCE_RAD):
        return free
    on_axis = coaxial and np.hypot(*free.circle.centre[:2]) < ON_AXIS_TOLERANCE * free.circle.radius_m
    centre = free.circle.centre * ([0.0, 0.0, 1.0] if on_axis else [1.0, 1.0, 1.0])
    upright = Circle(centre, np.array([0.0, 0.0, np.sign(free.circle.normal[2])]), free.circle.radius_m)
    return _fit(views, marks, upright, np.eye(6)[[2, 5] if on_axis else [0, 1, 2, 5]])


def _fit(views: Sequence[View], marks: Mapping[int, Array], start: Circle, directions: Array) -> TriangulatedCircle:
    """Least squares from a start, along some directions (D, 6) of (centre, two of the normal, radius)."""
    u, v = plane_axes(start.normal)
    scale = np.array([start.radius_m] * 3 + [1.0, 1.0, start.radius_m])

    def circle_of(x: Array) -> Circle:
        step = (x @ directions) * scale
        normal = start.normal + step[3] * u + step[4] * v
        return Circle(start.centre + step[:3], normal, float(abs(start.radius_m + step[5])))

    def residuals(x: Array) -> Array:
        circle = circle_of(x)
        return np.concatenate([_distance(circle, views[v], p) / np.sqrt(len(p)) * 6 for v, p in marks.items()])

    solution = least_squares(residuals, np.zeros(len(directions)), loss="soft_l1", f_scale=0.5, x_scale=0.01)
    circle = circle_of(solution.x)
    residual = {v: float(np.sqrt(np.mean(_distance(circle, views[v], p) ** 2))) for v, p in marks.items()}
    covariance = directions.T @ np.linalg.pinv(solution.jac.T @ solution.jac) @ directions
    sigma = scale * np.sqrt(np.diag(covariance)) * max(residual.values())
    return TriangulatedCircle(
        circle, residual, float(sigma[:3].max()), float(np.hypot(sigma[3], sigma[4])), float(sigma[5])
    )


def _distance(circle: Circle, view: View, points: Array) -> Array:
    """First-order distances (N,) of pixels from the image of the circle."""
    in_camera = circle.moved(view.T_world_camera.inv())
    conic = circle_conics(in_camera.centre, in_camera.normal, np.array(in_camera.radius_m), view.camera.matrix)
    homogeneous = np.column_stack([points, np.ones(len(points))])
    gradient = homogeneous @ conic
    value = np.einsum("ij,ij->i", gradient, homogeneous)
    return np.asarray(value / (2 * np.maximum(np.hypot(gradient[:, 0], gradient[:, 1]), 1e-12)))


def _linear_circle(views: Sequence[View], ellipses: Mapping[int, Ellipse]) -> Circle:
    """Centre from the rays through the ellipses' centres, radius from their size, normal where the views agree."""
    centre = _meeting_point([views[v] for v in ellipses], [e.centre for e in ellipses.values()])
    radii, candidates = [], []
    for v, ellipse in ellipses.items():
        view = views[v]
        depth = view.T_world_camera.inv().apply(centre)[2]
        if depth <= 0:
            raise InputError("marks", got="rays that meet behind a camera", expected="the same feature in every view")
        radii.append(ellipse.semi_axes[0] * depth / view.camera.fx)
        candidates.append(
            [c.moved(view.T_world_camera).normal for c in circle_poses(ellipse, view.camera, radii[-1])]
        )
    choices = [np.array(choice) for choice in product(*candidates)]
    agreement = [float(np.linalg.norm(normals.sum(axis=0))) for normals in choices]
    normal = choices[int(np.argmax(agreement))].sum(axis=0)
    return Circle(centre, normal, float(np.median(radii)))


def _meeting_point(views: Sequence[View], pixels: Sequence[Array]) -> Array:
    """The point (3,) nearest to the rays through one pixel of each view."""
    A, b = np.zeros((3, 3)), np.zeros(3)
    for view, pixel in zip(views, pixels, strict=True):
        T = view.T_world_camera.as_matrix()
        ray = T[:3, :3] @ view.camera.rays(pixel)[0]
        ray /= np.linalg.norm(ray)
        across = np.eye(3) - np.outer(ray, ray)
        A += across
        b += across @ T[:3, 3]
    if np.linalg.cond(A) > 1e8:
        raise InputError("views", got="parallel rays", expected="views from different directions")
    return np.asarray(np.linalg.solve(A, b))
