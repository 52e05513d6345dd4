"""Two-phase matching of a vision model against a scene (Section 6): hypotheses, confirmation, refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.alignment import align_on_ellipses
from vision.camera import View
from vision.candidates import Candidates, SalientCircles, Workspace, find_candidates
from vision.confirmation import SceneEdges
from vision.ellipse_observations import observe_ellipses
from vision.ellipse_table import EllipseTable
from vision.evidence import EdgeField
from vision.features import EllipseFeature
from vision.hypothesis_pool import HypothesisPool
from vision.model_contour import ModelContour
from vision.pose import PoseEstimate, Refinement, refine_pose
from vision.vision_model import VisionModel
from vision.voting import votes_of

Array = NDArray[np.float64]
Features = Sequence[Sequence[EllipseFeature]]


@dataclass(frozen=True)
class MatchingParameters:
    """Settings of the matching.

    Attributes:
        candidates: how many of the most promising candidates are refined and confirmed in a round.
        minimum_scores: edge support below which a pose is not accepted, round by round: what is beyond doubt first.
        minimum_separation: distance of two parts below which one of them is a duplicate, in part diameters.
        reach_px: how far from the projected model edges are looked for, iteration by iteration.
        rim_reach_px: the same for the first correction of a candidate.
        loose_reach_px: tolerance with which candidates are first weighed by the edges near them.
        joint_edges: refine on every edge along the model; otherwise only on the matched ellipses' own points.
    """

    candidates: int = 60
    minimum_scores: tuple[float, ...] = (0.6, 0.5, 0.42)
    minimum_separation: float = 0.12
    reach_px: tuple[float, ...] = (3.0, 2.0, 1.5, 1.5)
    rim_reach_px: tuple[float, ...] = (6.0, 5.0, 4.0, 3.0)
    loose_reach_px: float = 7.0
    depth_shares: tuple[float, ...] = (0.0, -0.02, -0.015, -0.01, -0.005, 0.005, 0.01, 0.015, 0.02)
    joint_edges: bool = True


class Matcher:
    """Matches one model in one set of views."""

    def __init__(
        self,
        views: Sequence[View],
        fields: Sequence[EdgeField],
        model: VisionModel,
        workspace: Workspace | None = None,
        parameters: MatchingParameters | None = None,
    ) -> None:
        """Prepare.

        Args:
            views: one or more, with distortion-free lenses.
            fields: their edge fields.
            model: the part to find.
            workspace: where parts can be.
            parameters: settings.
        """
        self.views, self.model, self.workspace = views, model, workspace
        self.parameters = parameters or MatchingParameters()
        self.circles = SalientCircles.of(model)
        self.scene = SceneEdges(views, fields)

    def match(self, features: Features) -> list[PoseEstimate]:
        """All instances of the part that the features and the edges support, best first."""
        candidates = find_candidates(self.views, features, self.model, self.workspace)
        candidates = candidates.distinct(self.model.diameter_m)
        table = EllipseTable.of(features)
        contour = self._contour(candidates)
        self.scene.forget_claims()
        accepted: list[PoseEstimate] = []
        pool: HypothesisPool | None = None
        for number, minimum_score in enumerate(self.parameters.minimum_scores):
            # The taught strategy goes first; afterwards one extractor makes good what the other has lost.
            allowed = self._by_strategy(candidates, features) if number == 0 else np.ones(len(candidates), bool)
            chosen = self._promising(candidates, allowed, contour)
            developed = self._develop(candidates.take(chosen), table, contour)
            pool = developed if pool is None else pool.joined(developed)
            found, pool = self._accept(pool, minimum_score, features, contour)
            accepted += found
            candidates = self._untried(candidates, chosen, accepted)
            if not len(candidates):
                break
        return sorted(accepted, key=lambda e: -e.score)

    def _by_strategy(self, candidates: Candidates, features: Features) -> NDArray[np.bool_]:
        """Which candidates come from the extractor that the model wants tried first for their salient feature."""
        salient = self.model.salient
        return np.array([features[v][m].process == salient[k].extractor for v, m, k in candidates.seed], dtype=bool)

    def _promising(
        self, candidates: Candidates, allowed: NDArray[np.bool_], contour: ModelContour
    ) -> NDArray[np.intp]:
        """The candidates with the most votes, and those with the most unclaimed edges near their salient circles.

        A part that a single ellipse speaks for has few votes, one amid clutter has edges everywhere: neither order
        alone serves all.
        """
        open_ = np.flatnonzero(allowed)
        poses = candidates.take(open_).poses()
        support = self.scene.evidence(poses, contour.sparse(), self.parameters.loose_reach_px).salient
        share = self.parameters.candidates // 2
        by_votes = open_[np.argsort(-candidates.votes[open_], kind="stable")][:share]
        by_edges = open_[np.argsort(-support, kind="stable")][:share]
        return np.array(list(dict.fromkeys([*by_votes.tolist(), *by_edges.tolist()])), dtype=np.intp)

    def _untried(
        self, candidates: Candidates, tried: NDArray[np.intp], accepted: Sequence[PoseEstimate]
    ) -> Candidates:
        """What is left for the next round: parts hidden among others surface when those have claimed their edges."""
        free = np.ones(len(candidates), bool)
        free[tried] = False
        separation = self.parameters.minimum_separation * self.model.diameter_m
        for estimate in accepted:
            distance = np.linalg.norm(candidates.origin - estimate.T_world_part.translation, axis=1)
            free &= distance > separation
        return candidates.take(np.flatnonzero(free))

    def _contour(self, candidates: Candidates) -> ModelContour:
        """The model sampled for the distance at which the candidates lie."""
        eye = self.views[0].T_world_camera.translation
        distance = float(np.median(np.linalg.norm(candidates.origin - eye, axis=1))) if len(candidates) else 1.0
        return ModelContour.of(self.model, self.views[0].camera.fx / distance)

    def _develop(self, candidates: Candidates, table: EllipseTable, contour: ModelContour) -> HypothesisPool:
        """Refine candidates on their matched ellipses, match again, and weigh their circles about the axis."""
        poses, matches = candidates.poses(), candidates.matches
        cameras, circles = self.scene.cameras, self.circles.arrays
        good = np.ones(len(poses), bool)
        for _ in range(2):
            good &= align_on_ellipses(poses, matches, cameras, circles, table.arrays, 4)
            matches = votes_of(poses, cameras, circles, table)[1]
        good &= (matches >= 0).any(axis=(1, 2))
        poses, matches, seed = poses[good], matches[good], candidates.seed[good]
        if self.parameters.joint_edges:
            poses = self._at_best_depth(poses, seed, contour)
            poses = self._aligned_on_rims(poses, contour)
        return HypothesisPool.of(poses, matches, seed, self.scene.evidence(poses, contour.salient()).salient)

    def _at_best_depth(self, poses: Array, seed: NDArray[np.intp], contour: ModelContour) -> Array:
        """Poses moved along the line of sight of the view that made them to where all views show the most edges.

        The size of one ellipse tells the depth within a percent or two, which another view sees as many pixels.
        """
        shares = np.array(self.parameters.depth_shares)
        eyes = np.stack([v.T_world_camera.translation for v in self.views])[seed[:, 0]]
        sight = poses[:, :3, 3] - eyes
        moved = np.repeat(poses[:, None], len(shares), axis=1)
        moved[:, :, :3, 3] += shares[:, None] * sight[:, None]
        support = self.scene.evidence(moved.reshape(-1, 4, 4), contour.sparse(), 4.0).salient.reshape(moved.shape[:2])
        best = (support - 2.0 * np.abs(shares)).argmax(axis=1)
        return np.asarray(moved[np.arange(len(poses)), best])

    def _aligned_on_rims(self, poses: Array, contour: ModelContour) -> Array:
        """Let the edges of all views correct poses that the ellipses of one view left uncertain in depth."""
        corrected = poses.copy()
        good = self.scene.align(corrected, contour.salient(), self.parameters.rim_reach_px, inplane=False)
        good &= np.linalg.norm(corrected[:, :3, 3] - poses[:, :3, 3], axis=1) < self._leash_m
        return np.where(good[:, None, None], corrected, poses)

    @property
    def _leash_m(self) -> float:
        """How far a refinement may move a pose before it has run away."""
        return 0.05 * self.model.diameter_m

    def _accept(
        self, pool: HypothesisPool, minimum_score: float, features: Features, contour: ModelContour
    ) -> tuple[list[PoseEstimate], HypothesisPool]:
        """Greedily accept the best supported hypothesis, let it claim its edges, and weigh the rest again.

        Returns:
            The accepted poses, and the hypotheses that are left.
        """
        accepted: list[PoseEstimate] = []
        while len(pool):
            best = int(np.argmax(pool.standing))
            if pool.standing[best] < minimum_score:
                break
            chosen, pool = pool.take(np.array([best])), pool.take(np.arange(len(pool)) != best)
            if not chosen.turned[0]:
                pool = pool.joined(self._turn(chosen, contour))
                continue
            final = self._finish(chosen, features, contour)
            if final is None:
                continue
            accepted.append(final)
            self.scene.claim(final.T_world_part.as_matrix(), contour, self.model)
            pool = self._left_over(pool, final.T_world_part.translation, contour)
        return accepted, pool

    def _turn(self, hypothesis: HypothesisPool, contour: ModelContour) -> HypothesisPool:
        """Settle the rotation about the axis by the supporting features, which then count as well."""
        yes = np.ones(1, bool)
        fold = self.model.symmetry_fold
        if fold is None:
            return replace(hypothesis, turned=yes)
        T, known = self.scene.find_inplane(hypothesis.poses[0], contour, fold)
        turned = replace(hypothesis, poses=T[None], turned=yes, inplane_known=np.array([known]))
        return turned.weighed(np.array([0]), self.scene.evidence(T[None], contour))

    def _left_over(self, pool: HypothesisPool, origin: Array, contour: ModelContour) -> HypothesisPool:
        """The hypotheses that are not the part just found, those near it weighed without the edges it claimed."""
        diameter = self.model.diameter_m
        pool = pool.take(~pool.near(origin, self.parameters.minimum_separation * diameter))
        near = np.flatnonzero(pool.near(origin, 1.2 * diameter))
        return pool.weighed(near, self.scene.evidence(pool.poses[near], contour)) if len(near) else pool

    def _finish(self, hypothesis: HypothesisPool, features: Features, contour: ModelContour) -> PoseEstimate | None:
        """The final refinement of an accepted hypothesis."""
        known = bool(hypothesis.inplane_known[0])
        T = hypothesis.poses[0]
        refined = self._refined(T, known, contour) if self.parameters.joint_edges else None
        if refined is None or np.linalg.norm(refined.T_world_part[:3, 3] - T[:3, 3]) > self._leash_m:
            refined = self._refined_on_ellipses(T, hypothesis.matches[0], features)
        if refined is None:
            return None
        T = refined.T_world_part
        evidence = self.scene.evidence(T[None], contour)
        v, m, _ = hypothesis.seed[0]
        return PoseEstimate(
            part=self.model.part,
            T_world_part=RigidTransform.from_matrix(T),
            covariance=refined.covariance,
            score=float(evidence.score[0]),
            process=features[v][m].process,
            residual_px=refined.residual_px,
            views=int(evidence.views[0]),
            inplane_known=known,
        )

    def _refined(self, T: Array, inplane: bool, contour: ModelContour) -> Refinement | None:
        """On every unclaimed edge along the model, in all views."""
        reach = self.parameters.reach_px
        return refine_pose(
            T,
            lambda pose, i: self.scene.observe(pose, contour, reach[i]),
            self.views,
            iterations=len(reach),
            inplane=inplane,
        )

    def _refined_on_ellipses(self, T: Array, matches: NDArray[np.intp], features: Features) -> Refinement | None:
        """On the edge points of the matched ellipses alone."""
        return refine_pose(
            T,
            lambda pose, _: observe_ellipses(pose, matches, features, self.views, self.circles),
            self.views,
            iterations=4,
            inplane=False,
        )
