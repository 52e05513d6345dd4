"""Least squares for a circle in space over edge points in several views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.geometry.circle import Circle, circle_conics, plane_axes

Array = NDArray[np.float64]

_CONVERGED = 1e-11  # so far below a micrometre that the fit ends at the same place on every machine


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Sightings:
    """Edge points of one circle, of all views, one after the other.

    Attributes:
        views: numbers of the views that have points.
        of_view: (N,) position in ``views`` that each point belongs to.
        points: (N, 3) homogeneous pixels.
        weights: (N,) how much each point counts.
        poses: (V, 4, 4) T_camera_world of the views.
        intrinsics: (V, 3, 3) their calibration matrices.
    """

    views: tuple[int, ...]
    of_view: NDArray[np.intp]
    points: Array
    weights: Array
    poses: Array
    intrinsics: Array

    @classmethod
    def of(
        cls, views: Sequence[View], marks: Mapping[int, Array], weights: Mapping[int, Array] | None = None
    ) -> Sightings:
        """Collect marks (N, 2) by number of the view; without weights every view counts the same."""
        numbers = tuple(marks)
        if weights is None:
            weights = {v: np.full(len(marks[v]), 36.0 / len(marks[v])) for v in numbers}
        pixels = np.concatenate([marks[v] for v in numbers])
        return cls(
            numbers,
            np.repeat(np.arange(len(numbers)), [len(marks[v]) for v in numbers]),
            np.column_stack([pixels, np.ones(len(pixels))]),
            np.concatenate([weights[v] for v in numbers]),
            np.stack([views[v].T_world_camera.inv().as_matrix() for v in numbers]),
            np.stack([views[v].camera.matrix for v in numbers]),
        )

    def distances(self, circle: Circle) -> Array:
        """First-order distances (N,) of the points from the image of the circle, in pixels."""
        rotations = self.poses[:, :3, :3]
        centres = rotations @ circle.centre + self.poses[:, :3, 3]
        conics = circle_conics(
            centres, rotations @ circle.normal, np.full(len(centres), circle.radius_m), self.intrinsics
        )
        gradient = np.einsum("nij,nj->ni", conics[self.of_view], self.points)
        value = np.einsum("ij,ij->i", gradient, self.points)
        return np.asarray(value / (2 * np.maximum(np.hypot(gradient[:, 0], gradient[:, 1]), 1e-12)))

    def residuals(self, circle: Circle) -> dict[int, float]:
        """Root mean square distance in pixels, by number of the view."""
        squares = self.distances(circle) ** 2
        counts = np.bincount(self.of_view)
        means = np.bincount(self.of_view, squares) / counts
        return {v: float(np.sqrt(mean)) for v, mean in zip(self.views, means, strict=True)}


@dataclass(frozen=True, eq=False)
@frozen_arrays
class CircleFit:
    """A fitted circle.

    Attributes:
        circle: the circle.
        covariance: (6, 6) of (centre, two of the normal, radius) for points of variance 1; lengths over the radius.
    """

    circle: Circle
    covariance: Array


def fit_circle(sightings: Sightings, start: Circle, freedom: Array, loss: str, loss_px: float) -> CircleFit:
    """Fit a circle from a start.

    Args:
        sightings: the edge points.
        start: where to begin.
        freedom: (D, 6) directions of (centre, two of the normal, radius) along which the circle may move.
        loss: of ``scipy.optimize.least_squares``.
        loss_px: the distance at which a point begins to count less.
    """
    u, v = plane_axes(start.normal)
    scale = np.array([start.radius_m] * 3 + [1.0, 1.0, start.radius_m])
    root_weights = np.sqrt(sightings.weights)

    def circle_of(x: Array) -> Circle:
        step = (x @ freedom) * scale
        normal = start.normal + step[3] * u + step[4] * v
        return Circle(start.centre + step[:3], normal, float(abs(start.radius_m + step[5])))

    solution = least_squares(
        lambda x: root_weights * sightings.distances(circle_of(x)),
        np.zeros(len(freedom)),
        jac="2-point",
        loss=loss,
        f_scale=loss_px,
        x_scale=0.01,
        xtol=_CONVERGED,
        ftol=None,
        gtol=None,
        max_nfev=50,
    )
    covariance = freedom.T @ np.linalg.pinv(solution.jac.T @ solution.jac) @ freedom
    return CircleFit(circle_of(solution.x), covariance)
