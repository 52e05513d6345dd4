"""Pose hypotheses: made from candidates or from arcs, aligned to the edges, and kept as arrays with their support.

A candidate is one reading of one ellipse; it becomes a hypothesis when the edges of all views have had their say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from vision.extraction import Arc
from vision.frozen import frozen_arrays
from vision.geometry.workspace import Workspace
from vision.matching.arcs import MOST_UNEXPLAINED, arc_poses
from vision.matching.candidates import Candidates
from vision.matching.parameters import MatchingParameters
from vision.matching.scene_edges import Evidence, SceneEdges
from vision.matching.votes import EllipseTable, count_votes
from vision.model.contour import ModelContour
from vision.model.solid import share_inside
from vision.model.vision_model import SalientCircles
from vision.pose.alignment import align_on_ellipses

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class HypothesisPool:
    """N hypotheses.

    Attributes:
        poses: (N, 4, 4) T_world_part.
        matches: (N, V, K) the ellipses matched to the salient circles, -1 for none.
        seed: (N, 3) view, ellipse and salient circle that the hypothesis was made from; -1 for an arc.
        salient: (N,) edge support of the salient circles.
        score: (N,) edge support of all circles; that of the salient ones before the hypothesis is turned.
        turned: (N,) whether the rotation about the axis has been looked for.
        inplane_known: (N,) whether it was found.
    """

    poses: Array
    matches: Indices
    seed: Indices
    salient: Array
    score: Array
    turned: Mask
    inplane_known: Mask

    @classmethod
    def of(cls, poses: Array, matches: Indices, seed: Indices, salient: Array) -> HypothesisPool:
        """New hypotheses, not yet turned about their axes."""
        no = np.zeros(len(poses), bool)
        return cls(poses, matches, seed, salient, salient, no, no)

    @classmethod
    def empty(cls, views: int, circles: int) -> HypothesisPool:
        """No hypotheses about a model with so many salient circles in so many views."""
        none = np.empty(0)
        matches = np.empty((0, views, circles), np.intp)
        return cls.of(np.empty((0, 4, 4)), matches, np.empty((0, 3), np.intp), none)

    def __len__(self) -> int:
        """Number of hypotheses."""
        return len(self.poses)

    def take(self, index: Indices | Mask) -> HypothesisPool:
        """Some of the hypotheses."""
        return HypothesisPool(*(getattr(self, field.name)[index] for field in fields(self)))

    def joined(self, other: HypothesisPool) -> HypothesisPool:
        """These and others."""
        mine = (getattr(self, field.name) for field in fields(self))
        theirs = (getattr(other, field.name) for field in fields(self))
        return HypothesisPool(*(np.concatenate(pair) for pair in zip(mine, theirs, strict=True)))

    @property
    def standing(self) -> Array:
        """(N,) before the rotation about the axis is known, only the salient circles count."""
        return np.where(self.turned, self.score, self.salient)

    def near(self, origin: Array, distance_m: float) -> Mask:
        """(N,) whose origin is nearer than that to a point (3,)."""
        return np.asarray(np.linalg.norm(self.poses[:, :3, 3] - origin, axis=1) < distance_m)

    def weighed(self, index: Indices, evidence: Evidence) -> HypothesisPool:
        """The pool with new evidence for the hypotheses of these numbers."""
        salient, score = self.salient.copy(), self.score.copy()
        salient[index], score[index] = evidence.salient, evidence.score
        return replace(self, salient=salient, score=score)


HOPELESS_SUPPORT = 0.12  # edges run along that much of any contour by chance
DEPTH_REACH_PX = 4.0
DEPTH_PRIOR = 2.0  # support that a relative change of depth by one must gain
CLASHING_SHARE = 0.2  # of the outlines inside another part


class HypothesisGenerator:
    """Makes hypotheses about one model in one scene."""

    def __init__(
        self, scene: SceneEdges, circles: SalientCircles, contour: ModelContour, parameters: MatchingParameters
    ) -> None:
        """Prepare.

        Args:
            scene: the edges of all views.
            circles: the model's salient circles.
            contour: the model, sampled for the scene's scale.
            parameters: settings.
        """
        self.scene, self.circles, self.contour, self.parameters = scene, circles, contour, parameters

    def promising(self, candidates: Candidates, allowed: NDArray[np.bool_]) -> Indices:
        """The candidates with the most votes, and those with the most unclaimed edges near their salient circles.

        A part that a single ellipse speaks for has few votes, one amid clutter has edges everywhere: neither order
        alone serves all.
        """
        open_ = np.flatnonzero(allowed)
        support = self._loose_support(candidates.take(open_).poses())
        share = self.parameters.candidates // 2
        by_votes = open_[np.argsort(-candidates.votes[open_], kind="stable")][:share]
        by_edges = open_[np.argsort(-support, kind="stable")][:share]
        hopeless = set(open_[support < HOPELESS_SUPPORT].tolist())
        chosen = dict.fromkeys([*by_votes.tolist(), *by_edges.tolist()])
        return np.array([i for i in chosen if i not in hopeless], dtype=np.intp)

    def from_candidates(self, candidates: Candidates, table: EllipseTable) -> HypothesisPool:
        """Refine candidates on their matched ellipses, match again, and weigh their circles about the axis."""
        # A copy, for the compiled loops take read-only arrays for another type, and would be compiled twice.
        poses, matches = candidates.poses(), candidates.matches.copy()
        cameras, circles = self.scene.cameras, self.circles
        good = np.ones(len(poses), bool)
        for _ in range(2):
            good &= align_on_ellipses(poses, matches, cameras, circles, table, 3)
            matches = count_votes(poses, cameras, circles, table)[1]
        good &= (matches >= 0).any(axis=(1, 2))
        poses, matches, seed = poses[good], matches[good], candidates.seed[good]
        if self.parameters.joint_edges:
            poses = self._aligned_on_rims(self._at_best_depth(poses, seed))
        return self._pool(poses, matches, seed)

    def from_arcs(
        self,
        arcs: Sequence[Sequence[Arc]],
        workspace: Workspace,
        table: EllipseTable,
        found: Sequence[Array],
    ) -> HypothesisPool:
        """What the arcs suggest that no part found explains, moved to where the edges of all views agree."""
        left = [self.scene.unclaimed(v, mine, MOST_UNEXPLAINED) for v, mine in enumerate(arcs)]
        poses, seed = arc_poses(left, self.scene.views, self.scene.cameras, self.circles, workspace)
        separation = self.parameters.minimum_separation * 2 * self.circles.radius.max()
        for T in found:
            free = np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1) > separation
            free &= share_inside(poses, T, self.circles) < CLASHING_SHARE
            poses, seed = poses[free], seed[free]
        best = np.argsort(-self._loose_support(poses), kind="stable")[: self.parameters.candidates]
        poses, seed = poses[best], seed[best]
        poses = self._aligned_on_rims(self._at_best_depth(poses, seed))
        return self._pool(poses, count_votes(poses, self.scene.cameras, self.circles, table)[1], seed)

    def supported_by_others(self, T_world_part: Array, view: int, *, inplane: bool) -> Array:
        """A pose that one view alone supports, moved along its line of sight to where the other views agree best.

        Where a piece stands on edge, two views may see different faces of it: the circles of one face then fit one
        view at any depth.

        Args:
            T_world_part: 4x4 pose.
            view: the number of that view, in practice the one whose ellipse or arc made the hypothesis.
            inplane: whether the rotation about the part's axis is known.
        """
        moved = self._moved_in_depth(
            T_world_part[None], np.array([view]), np.array(self.parameters.far_depth_shares)
        )[0]
        support = self.scene.evidence(moved, self.contour, DEPTH_REACH_PX).score
        best = moved[[int(support.argmax())]]
        self.scene.align(best, self.contour, self.parameters.rim_reach_px, inplane=inplane)
        return np.asarray(best[0])

    def aligned(self, T_world_part: Array, *, inplane: bool) -> Array:
        """A pose corrected by the edges along all its circles, of which a first correction used the salient ones."""
        poses = T_world_part[None].copy()
        self.scene.align(poses, self.contour, self.parameters.whole_reach_px, inplane=inplane)
        return np.asarray(poses[0])

    def _pool(self, poses: Array, matches: Indices, seed: Indices) -> HypothesisPool:
        return HypothesisPool.of(poses, matches, seed, self.scene.evidence(poses, self.contour.salient()).salient)

    def _loose_support(self, poses: Array) -> Array:
        return self.scene.evidence(poses, self.contour.sparse(), self.parameters.loose_reach_px).promise

    def _at_best_depth(self, poses: Array, seed: Indices) -> Array:
        """Poses moved along the line of sight of the view that made them to where all views show the most edges.

        The size of one ellipse tells the depth within a percent or two, which another view sees as many pixels.
        """
        if not self.parameters.depth_search:
            return poses
        shares = np.array(self.parameters.depth_shares)
        moved = self._moved_in_depth(poses, seed[:, 0], shares)
        support = self.scene.evidence(moved.reshape(-1, 4, 4), self.contour.sparse(), DEPTH_REACH_PX).salient
        best = (support.reshape(moved.shape[:2]) - DEPTH_PRIOR * np.abs(shares)).argmax(axis=1)
        return np.asarray(moved[np.arange(len(poses)), best])

    def _moved_in_depth(self, poses: Array, view: Indices, shares: Array) -> Array:
        """Poses (N, S, 4, 4) whose distances from views (N,) differ by relative changes (S,)."""
        eyes = np.stack([v.T_world_camera.translation for v in self.scene.views])[view]
        moved = np.repeat(poses[:, None], len(shares), axis=1)
        moved[:, :, :3, 3] += shares[:, None] * (poses[:, :3, 3] - eyes)[:, None]
        return moved

    def _aligned_on_rims(self, poses: Array) -> Array:
        """Let the edges of all views correct poses that the ellipses of one view left uncertain."""
        corrected = poses.copy()
        good = self.scene.align(corrected, self.contour.salient(), self.parameters.rim_reach_px, inplane=False)
        leash_m = self.parameters.leash * 2 * self.circles.radius.max()
        good &= np.linalg.norm(corrected[:, :3, 3] - poses[:, :3, 3], axis=1) < leash_m
        return np.where(good[:, None, None], corrected, poses)
