"""The 3D circle behind contours that a person marked in two or more views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.geometry.circle import Circle, circle_poses
from vision.geometry.ellipse import Ellipse
from vision.teaching.circle_fit import CircleFit, Sightings, fit_circle
from vision.teaching.snapping import ellipse_through

Array = NDArray[np.float64]

UPRIGHT_TOLERANCE_RAD = float(np.radians(8.0))
ON_AXIS_TOLERANCE = 0.1  # of the radius

_LOSS = ("soft_l1", 0.5)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class TriangulatedCircle:
    """A circle in the world and how well the views agree on it.

    Attributes:
        circle: the circle; its normal faces the cameras.
        residual_px: root mean square distance of the marked points from its image, by number of the view.
        centre_sigma_m: standard deviation of the centre, the largest over directions.
        normal_sigma_rad: standard deviation of the direction of the normal.
        radius_sigma_m: standard deviation of the radius.
        freedom: (D, 6) directions of (centre, two of the normal, radius) that the marks determined; the fixture's
            axis gave the others.
    """

    circle: Circle
    residual_px: Mapping[int, float]
    centre_sigma_m: float
    normal_sigma_rad: float
    radius_sigma_m: float
    freedom: Array = field(repr=False)

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
    sightings = Sightings.of(views, marks)
    start = _linear_circle(views, {v: ellipse_through(p) for v, p in marks.items()})
    free = fit_circle(sightings, start, np.eye(6), *_LOSS)
    if abs(free.circle.normal[2]) < np.cos(UPRIGHT_TOLERANCE_RAD):
        return _triangulated(free, sightings, np.eye(6))
    on_axis = coaxial and np.hypot(*free.circle.centre[:2]) < ON_AXIS_TOLERANCE * free.circle.radius_m
    centre = free.circle.centre * ([0.0, 0.0, 1.0] if on_axis else [1.0, 1.0, 1.0])
    upright = Circle(centre, np.array([0.0, 0.0, np.sign(free.circle.normal[2])]), free.circle.radius_m)
    freedom = np.eye(6)[[2, 5] if on_axis else [0, 1, 2, 5]]
    return _triangulated(fit_circle(sightings, upright, freedom, *_LOSS), sightings, freedom)


def _triangulated(fit: CircleFit, sightings: Sightings, freedom: Array) -> TriangulatedCircle:
    residual = sightings.residuals(fit.circle)
    radius = fit.circle.radius_m
    scale = np.array([radius] * 3 + [1.0, 1.0, radius])
    sigma = scale * np.sqrt(np.diag(fit.covariance)) * max(residual.values())
    return TriangulatedCircle(
        fit.circle, residual, float(sigma[:3].max()), float(np.hypot(sigma[3], sigma[4])), float(sigma[5]), freedom
    )


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
