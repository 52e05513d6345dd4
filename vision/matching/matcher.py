"""Two-phase matching of a vision model against a scene (Section 6).

It reads::

    candidates = every ellipse of every view, read as every salient circle
    for minimum in minimum_scores:                  # from sure to doubtful
        hypotheses += the promising candidates, developed on the edges of all views
                                                    # in the first round those of the taught extractor alone
        while the best hypothesis reaches the minimum:
            settle its turn about the axis by the supporting features
            refine it on the edges, or on its ellipses where those are too few
            if it still stands, where no known part lies:
                accept it: it claims its edges and hides what is behind it
                weigh the hypotheses near it again, without these edges
        candidates -= those tried, and those where a part was found
    once more, for the arcs where no ellipse is left
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.edges.edge_field import EdgeField
from vision.extraction import Arc
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.matching.candidates import Candidates, find_candidates
from vision.matching.hypotheses import CLASHING_SHARE, HypothesisGenerator, HypothesisPool
from vision.matching.parameters import MatchingParameters
from vision.matching.scene_edges import Evidence, SceneEdges
from vision.matching.votes import EllipseTable
from vision.model.contour import ModelContour
from vision.model.solid import share_inside
from vision.model.vision_model import SalientCircles, VisionModel
from vision.pose.estimate import PoseEstimate, features_supported
from vision.pose.observations import observe_ellipses
from vision.pose.probability import pose_probability
from vision.pose.refinement import Refinement, refine_pose
from vision.pose.stereo import pose_by_stereo

Array = NDArray[np.float64]
Features = Sequence[Sequence[EllipseFeature]]


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
        self.parameters = parameters or MatchingParameters()
        self.model = model if self.parameters.patterns else replace(model, patterns=())
        self.views, self.workspace = views, workspace
        self.circles = SalientCircles.of(model)
        self.scene = SceneEdges(views, fields, self.parameters.confirmation)

    def match(self, features: Features, arcs: Sequence[Sequence[Arc]] = ()) -> list[PoseEstimate]:
        """All instances of the part that the features and the edges support, best first.

        What is more likely wrong than right is not among them.

        Args:
            features: the extracted ellipses of every view.
            arcs: of every view, pieces of edges to fall back on; none by default.
        """
        candidates = find_candidates(self.views, features, self.model, self.workspace)
        candidates = candidates.distinct(self.model.diameter_m)
        table = EllipseTable.of(features)
        contour = self._contour(candidates)
        generator = HypothesisGenerator(self.scene, self.circles, contour, self.parameters)
        self.scene.forget_claims()
        accepted: list[PoseEstimate] = []
        pool = HypothesisPool.empty(len(self.views), len(self.circles.radius))
        for number, minimum_score in enumerate(self.parameters.minimum_scores):
            # The taught strategy goes first; afterwards one extractor makes good what the other has lost.
            allowed = candidates.preferred if number == 0 else np.ones(len(candidates), bool)
            chosen = generator.promising(candidates, allowed)
            pool = pool.joined(generator.from_candidates(candidates.take(chosen), table))
            found, pool = self._accept(pool, minimum_score, features, generator, accepted)
            accepted += found
            candidates = self._untried(candidates, chosen, accepted)
        if any(map(len, arcs)) and self.workspace is not None:
            known = [e.T_world_part.as_matrix() for e in accepted]
            pool = pool.joined(generator.from_arcs(arcs, self.workspace, table, known))
            least = self.parameters.minimum_scores[-1]
            accepted += self._accept(pool, least, features, generator, accepted)[0]
        likely = [e for e in accepted if (e.probability or 0.0) >= self.parameters.least_probability]
        return sorted(likely, key=lambda e: -e.score)

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
        origins = candidates.origin
        if self.workspace is not None:
            origins = np.array([self.workspace.low, self.workspace.high])
        distance = float(np.median(np.linalg.norm(origins - eye, axis=1))) if len(origins) else 1.0
        return ModelContour.of(self.model, self.views[0].camera.fx / distance)

    def _accept(
        self,
        pool: HypothesisPool,
        minimum_score: float,
        features: Features,
        generator: HypothesisGenerator,
        known: Sequence[PoseEstimate],
    ) -> tuple[list[PoseEstimate], HypothesisPool]:
        """Greedily accept the best supported hypothesis, let it claim its edges, and weigh the rest again.

        Returns:
            The accepted poses, and the hypotheses that are left.
        """
        accepted: list[PoseEstimate] = []
        contour = generator.contour
        while len(pool):
            best = int(np.argmax(pool.standing))
            if pool.standing[best] < minimum_score:
                break
            chosen, pool = pool.take(np.array([best])), pool.take(np.arange(len(pool)) != best)
            if not chosen.turned[0]:
                pool = pool.joined(self._turn(chosen, generator))
                continue
            final = self._finish(chosen, features, contour)
            if final is None or not self._stands(final, minimum_score, [*known, *accepted]):
                continue
            accepted.append(final)
            self.scene.claim(final.T_world_part.as_matrix(), contour, self.model, hiding=self.parameters.hiding)
            pool = self._left_over(pool, final.T_world_part.as_matrix(), contour)
        return accepted, pool

    def _stands(self, final: PoseEstimate, minimum_score: float, known: Sequence[PoseEstimate]) -> bool:
        """Whether a refined pose is still supported, and has run neither into a known part nor through the floor.

        Where nothing is known of the scene, an ellipse may be a circle too small and too near that one view shows.
        """
        if self.workspace is None and final.views == 1 < len(self.views):
            return False
        if self.workspace is not None:
            floor = self.workspace.low[2] - self.parameters.floor_slack * self.model.diameter_m
            if self.circles.lowest(final.T_world_part.as_matrix()) < floor:
                return False
        spread_m = np.sqrt(np.linalg.eigvalsh(final.covariance[:3, :3])[-1])
        if not spread_m < 0.5 * self.model.diameter_m:
            return False  # it may as well be where another part is
        separation = self.parameters.minimum_separation * self.model.diameter_m
        origin = final.T_world_part.translation
        return final.score >= minimum_score and all(
            np.linalg.norm(origin - other.T_world_part.translation) > separation for other in known
        )

    def _turn(self, hypothesis: HypothesisPool, generator: HypothesisGenerator) -> HypothesisPool:
        """Settle the rotation about the axis by the supporting features, which then count as well."""
        yes = np.ones(1, bool)
        fold = self.model.symmetry_fold
        if fold is None:
            return replace(hypothesis, turned=yes)
        T, known = self.scene.find_inplane(hypothesis.poses[0], generator.contour, fold)
        evidence = self.scene.evidence(T[None], generator.contour)
        least, most = self.parameters.doubtful_scores
        if least < evidence.score[0] < most:
            T, evidence = self._better(T, evidence, generator.aligned(T, inplane=known), generator.contour)
        if self.parameters.depth_search and evidence.views[0] == 1 < len(self.views):
            moved = generator.supported_by_others(T, int(hypothesis.seed[0, 0]), inplane=known)
            T, evidence = self._better(T, evidence, moved, generator.contour)
        turned = replace(hypothesis, poses=T[None], turned=yes, inplane_known=np.array([known]))
        return turned.weighed(np.array([0]), evidence)

    def _better(self, T: Array, evidence: Evidence, T_other: Array, contour: ModelContour) -> tuple[Array, Evidence]:
        """The better supported of two poses (4, 4), with its evidence."""
        other = self.scene.evidence(T_other[None], contour)
        return (T_other, other) if other.score[0] > evidence.score[0] else (T, evidence)

    def _left_over(self, pool: HypothesisPool, T_found: Array, contour: ModelContour) -> HypothesisPool:
        """The hypotheses that are not the part just found, those near it weighed without the edges it claimed."""
        diameter, origin = self.model.diameter_m, T_found[:3, 3]
        pool = pool.take(~pool.near(origin, self.parameters.minimum_separation * diameter))
        pool = pool.take(share_inside(pool.poses, T_found, self.circles) < CLASHING_SHARE)
        near = np.flatnonzero(pool.near(origin, 1.2 * diameter))
        return pool.weighed(near, self.scene.evidence(pool.poses[near], contour)) if len(near) else pool

    def _finish(self, hypothesis: HypothesisPool, features: Features, contour: ModelContour) -> PoseEstimate | None:
        """The final refinement of an accepted hypothesis."""
        known = bool(hypothesis.inplane_known[0])
        T = hypothesis.poses[0]
        refined = self._refined(T, known, contour) if self.parameters.joint_edges else None
        if (
            refined is None
            or np.linalg.norm(refined.T_world_part[:3, 3] - T[:3, 3]) > self.parameters.leash * self.model.diameter_m
        ):
            refined = self._refined_on_ellipses(T, hypothesis.matches[0], features)
        if refined is None:
            return None
        T = refined.T_world_part
        evidence = self.scene.evidence(T[None], contour)
        v, m, _ = hypothesis.seed[0]
        estimate = PoseEstimate(
            part=self.model.part,
            T_world_part=RigidTransform.from_matrix(T),
            covariance=refined.covariance,
            score=float(evidence.score[0]),
            extractor=features[v][m].extractor if m >= 0 else "group",
            residual_px=refined.residual_px,
            views=int(evidence.views[0]),
            inplane_known=known,
            features=features_supported(
                self.model, contour.circle_feature, evidence.of_circle[0], evidence.samples[0]
            ),
            shown=float(evidence.shown[0]),
        )
        turn_matters = self.model.symmetry_fold is not None
        weights = self.parameters.probability_weights
        return replace(estimate, probability=pose_probability(estimate, weights, turn_matters=turn_matters))

    def _refined(self, T: Array, inplane: bool, contour: ModelContour) -> Refinement | None:
        """On every unclaimed edge along the model, in all views."""
        reach = self.parameters.reach_px
        return refine_pose(
            T,
            lambda pose, i: self.scene.observe(pose, contour, reach[i]),
            self.views,
            iterations=len(reach),
            inplane=inplane,
            calibration=self.parameters.calibration,
            edge_errors=self.parameters.edge_errors,
        )

    def _refined_on_ellipses(self, T: Array, matches: NDArray[np.intp], features: Features) -> Refinement | None:
        """On the matched ellipses alone: by stereo where two views share a circle, then on all their edge points."""
        start = pose_by_stereo(T, matches, features, self.views, self.circles)
        return refine_pose(
            T if start is None else start,
            lambda pose, _: observe_ellipses(pose, matches, features, self.views, self.circles),
            self.views,
            iterations=4,
            inplane=False,
            calibration=self.parameters.calibration,
            edge_errors=self.parameters.edge_errors,
        )
