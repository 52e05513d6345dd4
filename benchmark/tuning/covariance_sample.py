"""Errors of poses beside the parts of their covariance: what each of the edges' shared errors adds to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from benchmark.episodes.evaluation import assign_estimates
from benchmark.episodes.metrics import BARELY_VISIBLE, error_vector
from benchmark.tuning.scenes import KnownScene
from benchmark.world.parts import get_part
from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.matching.parameters import MatchingParameters
from vision.pose.edge_errors import EdgeErrors

Array = NDArray[np.float64]

NAMES = tuple(field.name for field in fields(EdgeErrors))
NO_ERRORS = EdgeErrors(**dict.fromkeys(NAMES, 0.0))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class CovarianceSample:
    """Errors of N matched poses, in coordinates of which the last does not count where the turn about z is unknown.

    Such a coordinate has the error 0 and the variance 1, whatever the sigmas are.

    Attributes:
        scene: (N,) number of the scene.
        error: (N, 6) metres and radians.
        noise: (N, 6, 6) covariance from the noise of single edges.
        unit: (N, K, 6, 6) what each of the shared errors adds when its sigma is one pixel.
        components: (N,) number of coordinates that count.
    """

    scene: NDArray[np.intp]
    error: Array
    noise: Array
    unit: Array
    components: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.error)

    def take(self, index: NDArray[np.generic]) -> CovarianceSample:
        """Those with these numbers, or where a mask is True."""
        return CovarianceSample(*(getattr(self, field.name)[index] for field in fields(self)))

    def covariance(self, sigmas: Array) -> Array:
        """(N, 6, 6) with these sigmas (K,) in pixels."""
        return np.asarray(self.noise + np.einsum("k,nkij->nij", sigmas**2, self.unit))

    def squared(self, sigmas: Array) -> Array:
        """(N,) squared errors in units of the covariance: chi-square distributed where it is right."""
        return np.asarray(np.einsum("ni,ni->n", self.error, self._solved(sigmas)))

    def losses(self, sigmas: Array) -> Array:
        """(N,) negative log likelihood of the errors, but for a constant."""
        _, log_determinant = np.linalg.slogdet(self.covariance(sigmas))
        return np.asarray(0.5 * (self.squared(sigmas) + log_determinant))

    def slope(self, sigmas: Array) -> Array:
        """(K,) derivative of the mean loss by the squared sigmas."""
        inverse, solved = np.linalg.inv(self.covariance(sigmas)), self._solved(sigmas)
        spread = np.einsum("nij,nkji->k", inverse, self.unit)
        pull = np.einsum("ni,nkij,nj->k", solved, self.unit, solved)
        return np.asarray(0.5 * (spread - pull) / len(self))

    def _solved(self, sigmas: Array) -> Array:
        return np.asarray(np.linalg.solve(self.covariance(sigmas), self.error[..., None])[..., 0])


def covariance_sample(scenes: Sequence[KnownScene]) -> CovarianceSample:
    """Errors of the matched pieces that are not almost hidden.

    Raises:
        InputError: there is none.
    """
    found = [(number, *row) for number, scene in enumerate(scenes) for row in _of_scene(scene)]
    if not found:
        raise InputError("scenes", got="no piece that is matched", expected="at least one", do="Take more scenes.")
    return CovarianceSample(*(np.array(column) for column in zip(*found, strict=True)))


def _of_scene(scene: KnownScene) -> list[tuple[Array, Array, Array, int]]:
    """A covariance is linear in the squared sigmas, which move no pose: one at a time shows what each adds."""
    alone = [replace(NO_ERRORS, **{name: 1.0}) for name in NAMES]
    without, *with_one = [
        scene.localize(MatchingParameters(edge_errors=errors)).estimates for errors in (NO_ERRORS, *alone)
    ]
    rows, visible = [], scene.visible(BARELY_VISIBLE)
    for i, j in assign_estimates(without, scene.pieces).pairs:
        truth, estimate = scene.pieces[j], without[i]
        if j not in visible:
            continue
        error, counted = error_vector(
            estimate.T_world_part,
            truth.T_world_part,
            get_part(scene.part).symmetry,
            inplane_known=estimate.inplane_known,
        )
        noise = estimate.covariance
        unit = np.array([_padded(counted, estimates[i].covariance - noise, 0.0) for estimates in with_one])
        size = counted.shape[1]
        in_coordinates = np.concatenate([counted.T @ error, np.zeros(6 - size)])
        rows.append((in_coordinates, _padded(counted, noise, 1.0), unit, size))
    return rows


def _padded(counted: Array, covariance: Array, variance: float) -> Array:
    """A covariance in the coordinates that count, with a variance for those that do not."""
    out, size = variance * np.eye(6), counted.shape[1]
    out[:size, :size] = counted.T @ covariance @ counted
    return out
