"""Second phase of matching: the edges along all features of a posed model confirm or refute it (Section 6).

Salient circles alone leave open which face of the part is seen and how it is turned about its axis; the supporting
features (bolt holes, slots) decide, by whether edges run where they must be (Fig. 9 d).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_field import EdgeField, StackedEdges
from vision.extraction import Arc
from vision.frozen import frozen_arrays
from vision.geometry.camera import View, camera_arrays
from vision.matching.edge_support import claim_edges, share_claimed, tally_support
from vision.matching.parameters import CONFIRMATION, ConfirmationParameters
from vision.model.contour import ModelContour
from vision.model.projection import COVER_BLOCK_PX
from vision.model.solid import render_depth
from vision.model.vision_model import VisionModel
from vision.pose.alignment import align_on_edges
from vision.pose.observations import Observations, observe_edges

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Evidence:
    """The edge support of posed models.

    Attributes:
        score: (N,) weighted mean support over all circles in sight, 0 to 1, less what a part that shows little lacks.
        salient: (N,) the same over the salient circles only.
        promise: (N,) mean support of the salient circles times the share in sight: before a pose is exact, long
            edges near it promise more than short ones on it.
        shown: (N,) share in sight of the samples that face the views.
        views: (N,) number of views whose support is at least half of the best view's.
        of_circle: (N, C) mean support of each circle of the contour.
        samples: (N, C) number of its samples in sight, over all views; 0 where a circle is not seen.
    """

    score: Array
    salient: Array
    promise: Array
    shown: Array
    views: NDArray[np.intp]
    of_circle: Array
    samples: Array


class SceneEdges:
    """The edge fields of all views, and which edges have been claimed by parts already found."""

    def __init__(
        self,
        views: Sequence[View],
        fields: Sequence[EdgeField],
        parameters: ConfirmationParameters = CONFIRMATION,
    ) -> None:
        """Nothing is claimed at first.

        Args:
            views: with distortion-free lenses.
            fields: their edge fields.
            parameters: settings.
        """
        self.views, self.fields, self.parameters = views, fields, parameters
        self.cameras = camera_arrays(views)
        self._reduced = [v.camera.reduced(COVER_BLOCK_PX) for v in views]
        blocks = (max(c.height_px for c in self._reduced), max(c.width_px for c in self._reduced))
        distance = _stacked([f.distance for f in fields], np.inf)
        self._edges = StackedEdges(
            distance=distance,
            direction=_stacked([f.direction for f in fields], 0.0),
            nearest=_stacked([f.nearest for f in fields], -1.0),
            claimed=np.zeros(distance.shape, bool),
            cover=np.full((len(views), *blocks), np.inf, np.float32),
        )

    def forget_claims(self) -> None:
        """Set all edges free."""
        if self._edges.claimed.any():
            self._edges.distance[:] = _stacked([f.distance for f in self.fields], np.inf)
        self._edges.claimed[:] = False
        self._edges.cover[:] = np.inf

    def evidence(self, poses: Array, contour: ModelContour, reach_px: float | None = None) -> Evidence:
        """Support of poses (N, 4, 4) by edges that no other part has claimed, within a reach or the usual one."""
        least_shown = self.parameters.least_shown
        total, count = self._tally(poses, contour, self.parameters.reach_px if reach_px is None else reach_px)
        seen, facing = count[..., 0], count[..., 1]
        # A small hole says as much per pixel as a rim, but a rim is longer: square roots balance the two.
        weight = contour.circle_weight * np.sqrt(seen.sum(axis=1))
        mean = total.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
        in_sight = seen.sum(axis=(1, 2)) / np.maximum(facing.sum(axis=(1, 2)), 1)
        shown = np.minimum(in_sight, least_shown)
        # Where only a little is in sight, other edges happen to lie along it more easily.
        lacking = self.parameters.demand * (least_shown - shown)
        salient = _weighted_mean(mean, weight * contour.circle_salient)
        of_view = total.sum(axis=2) / np.maximum(seen.sum(axis=2), 1)
        return Evidence(
            np.maximum(_weighted_mean(mean, weight) - lacking, 0.0),
            np.maximum(salient - lacking, 0.0),
            salient * shown / least_shown,
            in_sight,
            np.count_nonzero(of_view > 0.5 * np.maximum(of_view.max(axis=1, keepdims=True), 0.1), axis=1),
            mean,
            seen.sum(axis=1),
        )

    def align(self, poses: Array, contour: ModelContour, reaches_px: Sequence[float], *, inplane: bool) -> Mask:
        """Let the nearest unclaimed edges of all views correct poses (N, 4, 4), in place.

        A pose that is uncertain in depth after one view's ellipse becomes certain by the others.

        Returns:
            (N,) False where too few edges were in reach.
        """
        return align_on_edges(poses, self.cameras, contour.samples, self._edges, np.array(reaches_px), inplane)

    def inplane_support(self, T_world_part: Array, contour: ModelContour, angles: Array) -> Array:
        """Mean support (A,) of the circles that tell the rotation about z, at each of the angles (A,)."""
        part = contour.asymmetric()
        total, count = self._tally(turned(T_world_part, angles), part, self.parameters.reach_px)
        return self._gain(total.sum(axis=1) @ part.circle_weight, count[..., 0].sum(axis=1) @ part.circle_weight)

    def inplane_support_all_round(self, T_world_part: Array, contour: ModelContour, fold: int, least: int) -> Array:
        """The same at n angles, evenly spaced over 1/fold of a turn; fold n >= ``least``, a multiple of all copies.

        Turned by the angle between them, the copies of a feature change places. So the first copy alone, looked at
        all the way round, tells what all of them would: a fraction of the work where there are twenty.
        """
        part = contour.first_copies()
        copies = {c: int(contour.circle_copies[c]) for c in np.unique(part.circle)}
        n = least + -least % int(np.lcm.reduce([fold, *copies.values()]))
        all_round = turned(T_world_part, np.arange(n) * 2 * np.pi / n)
        total, count = self._tally(all_round, part, self.parameters.reach_px)
        support, seen = np.zeros(n // fold), np.zeros(n // fold)
        for c, k in copies.items():
            for out, of_first in ((support, total[:, :, c]), (seen, count[:, :, c, 0])):
                of_all = of_first.sum(axis=1).reshape(k, n // k).sum(axis=0)
                out += part.circle_weight[c] * np.resize(of_all, n // fold)
        return self._gain(support, seen)

    def find_inplane(self, T_world_part: Array, contour: ModelContour, fold: int) -> tuple[Array, bool]:
        """Turn a pose about its axis to where the supporting features have edges.

        Args:
            T_world_part: 4x4, any rotation about z.
            contour: of the model.
            fold: number of rotations that look the same.

        Returns:
            The turned pose, and whether the best angle stands out from the rest and has no equal: where nothing but
            some of many like holes is in sight, any of them may be the first.
        """
        lever = contour.asymmetric().reach_m
        if lever == 0:
            return T_world_part, False
        distance = min(np.linalg.norm(v.T_world_camera.translation - T_world_part[:3, 3]) for v in self.views)
        around_px = 2 * np.pi * lever * self.views[0].camera.fx / distance
        least = int(np.ceil(around_px / self.parameters.inplane_step_px))
        support = self.inplane_support_all_round(T_world_part, contour, fold, least)
        peaks = _peaks(support, float(around_px) / fold, self.parameters)
        step = 2 * np.pi / (fold * len(support))
        angles = peaks[:, None] * step + np.linspace(-step, step, 9)
        fine = self.inplane_support(T_world_part, contour, angles.ravel()).reshape(angles.shape)
        best = np.unravel_index(int(fine.argmax()), fine.shape)
        rivals = np.delete(fine.max(axis=1), best[0])
        spread = float(np.median(np.abs(support - np.median(support)))) * 1.4826
        least_gain = max(self.parameters.outstanding_spreads * spread, self.parameters.outstanding_support)
        stands_out = fine[best] - np.median(support) > least_gain
        alone = fine[best] - rivals.max(initial=-np.inf) > self.parameters.rival_support
        return turned(T_world_part, angles[best][None])[0], bool(stands_out and alone)

    def observe(self, T_world_part: Array, contour: ModelContour, reach_px: float) -> Observations:
        """Sub-pixel edges along the visible circles of a posed model, claimed ones left out."""
        return observe_edges(T_world_part, contour, self.cameras, self.fields, self._edges.claimed, reach_px)

    def claim(
        self,
        T_world_part: Array,
        contour: ModelContour,
        model: VisionModel,
        width_px: int = 2,
        *,
        hiding: bool = True,
    ) -> None:
        """Mark the edges that a part explains as its own, and with ``hiding`` what lies behind it as hidden."""
        for v, reduced in enumerate(self._reduced):
            hidden = self._edges.cover[v, : reduced.height_px, : reduced.width_px]
            T_camera_part = self.cameras.T_camera_world[v] @ T_world_part
            if hiding:
                render_depth(hidden, T_camera_part, reduced, model)
            reach, least = self.parameters.reach_px, self.parameters.claim_support
            intrinsics = self.cameras.intrinsics[v]
            claim_edges(T_camera_part, intrinsics, contour.samples, self._edges, v, reach, least, width_px)

    def unclaimed(self, view: int, arcs: Sequence[Arc], most: int) -> list[Arc]:
        """The first arcs of a view, at most so many, of which most points have not been claimed."""
        most_claimed = self.parameters.claimed_share
        left = (arc for arc in arcs if share_claimed(self._edges.claimed[view], arc.points) < most_claimed)
        return list(islice(left, most))

    def _gain(self, support: Array, seen: Array) -> Array:
        """Support (A,) per sample in sight, less that of chance: holes must not look better out of sight than in."""
        return (support - self.parameters.chance_support * seen) / max(float(seen.mean()), 1.0)

    def _tally(self, poses: Array, contour: ModelContour, reach_px: float) -> tuple[Array, Array]:
        """Sum of the support (N, V, C), and number of the samples (N, V, C, 2) in sight, and of all that face it."""
        shape = (len(poses), len(self.views), len(contour.circle_weight))
        total, count = np.zeros(shape), np.zeros((*shape, 2))
        poses = np.array(poses, order="C")  # writable, so that the loops are compiled for one type alone
        tally_support(poses, self.cameras, contour.samples, self._edges, reach_px, total, count)
        return total, count


def turned(T_world_part: Array, angles: Array) -> Array:
    """The pose (4, 4) after rotations of the part about its own z axis by each of the angles (A,): (A, 4, 4)."""
    out = np.repeat(T_world_part[None], len(angles), axis=0)
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    x, y = T_world_part[:3, 0], T_world_part[:3, 1]
    out[:, :3, 0] = cosine * x + sine * y
    out[:, :3, 1] = cosine * y - sine * x
    return out


def _stacked(images: Sequence[NDArray[np.float32]], beyond: float) -> NDArray[np.float32]:
    """Images of all views in one array, the smaller ones filled up."""
    rows, columns = (max(image.shape[axis] for image in images) for axis in (0, 1))
    if all(image.shape[:2] == (rows, columns) for image in images):
        return np.stack(images)
    out = np.full((len(images), rows, columns, *images[0].shape[2:]), beyond, np.float32)
    for target, image in zip(out, images, strict=True):
        target[: image.shape[0], : image.shape[1]] = image
    return out


def _peaks(support: Array, around_px: float, parameters: ConfirmationParameters) -> NDArray[np.intp]:
    """Numbers of the best of evenly spaced angles, and of others like it that are no neighbours, best first.

    Args:
        support: (A,) of angles over one period.
        around_px: length of the period where the features are.
        parameters: settings.
    """
    best = support.max()
    summit = (support >= np.roll(support, 1)) & (support >= np.roll(support, -1))
    order = np.flatnonzero(summit & (support > best - parameters.rival_coarse_support))
    order = order[np.argsort(-support[order], kind="stable")]
    apart = np.abs(order - order[0]) * around_px / len(support)
    other = np.minimum(apart, around_px - apart) > parameters.rival_px
    return np.asarray(order[other | (np.arange(len(order)) == 0)][: parameters.most_peaks], np.intp)


def _weighted_mean(values: Array, weights: Array) -> Array:
    """Means (N,) of values (N, C); 0 where all weights are."""
    total = weights.sum(axis=1)
    return np.asarray((values * weights).sum(axis=1) / np.where(total > 0, total, 1.0))
