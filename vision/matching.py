"""Two-phase matching of a vision model against a scene (Section 6): hypotheses, confirmation, refinement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.camera import View
from vision.candidates import Candidates, SalientCircles, Workspace, find_candidates, vote
from vision.confirmation import Evidence, SceneEdges
from vision.evidence import EdgeField
from vision.features import EllipseFeature
from vision.model_contour import ModelContour
from vision.pose import Observations, PoseEstimate, Refinement, refine_pose
from vision.vision_model import VisionModel

Array = NDArray[np.float64]
Features = Sequence[Sequence[EllipseFeature]]


@dataclass(frozen=True)
class MatchingParameters:
    """Settings of the matching.

    Attributes:
        candidates: how many of the most promising candidates are refined and confirmed in a round.
        minimum_scores: edge support below which a pose is not accepted, round by round: what is beyond doubt first.
        minimum_separation: distance of two parts below which one of them is a duplicate, in part diameters.
        points_per_ellipse: edge points of each matched ellipse that enter the refinement.
        reach_px: how far from the projected model edges are looked for, iteration by iteration.
        rim_reach_px: the same for the first correction of a candidate.
        loose_reach_px: tolerance with which candidates are first weighed by the edges near them.
        joint_edges: refine on every edge along the model; otherwise only on the matched ellipses' own points.
    """

    candidates: int = 30
    minimum_scores: tuple[float, ...] = (0.6, 0.45, 0.35, 0.30)
    minimum_separation: float = 0.12
    points_per_ellipse: int = 48
    reach_px: tuple[float, ...] = (5.0, 4.0, 3.0, 2.5, 2.0, 2.0, 1.5, 1.5)
    rim_reach_px: tuple[float, ...] = (6.0, 5.0, 4.0, 3.0)
    loose_reach_px: float = 7.0
    joint_edges: bool = True


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A hypothesis on its way: pose, matched ellipses and evidence."""

    T: Array
    matches: NDArray[np.intp]
    process: str
    evidence: Evidence
    refinement: Refinement
    turned: bool = False
    inplane_known: bool = False

    @property
    def score(self) -> float:
        """Before the rotation about the axis is known, only the salient circles count."""
        return self.evidence.score if self.turned else self.evidence.salient


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
        self.views, self.fields, self.model, self.workspace = views, fields, model, workspace
        self.parameters = parameters or MatchingParameters()
        self.circles = SalientCircles.of(model)
        self._cameras = [(v.T_world_camera.as_matrix(), v.camera) for v in views]

    def match(self, features: Features) -> list[PoseEstimate]:
        """All instances of the part that the features and the edges support, best first."""
        candidates = find_candidates(self.views, features, self.model, self.workspace)
        candidates = candidates.distinct(self.model.diameter_m)
        scene = SceneEdges(self.views, self.fields)
        contour = self._contour(candidates)
        accepted: list[PoseEstimate] = []
        pool: list[_Candidate] = []
        for number, minimum_score in enumerate(self.parameters.minimum_scores):
            # The taught strategy goes first; afterwards one extractor makes good what the other has lost.
            allowed = self._by_strategy(candidates, features) if number == 0 else np.ones(len(candidates), bool)
            chosen = self._promising(candidates, allowed, scene, contour)
            developed = (self._develop(candidates, int(i), features, scene, contour) for i in chosen)
            pool += [c for c in developed if c is not None]
            found, pool = self._accept(pool, minimum_score, scene, contour)
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
        self, candidates: Candidates, allowed: NDArray[np.bool_], scene: SceneEdges, contour: ModelContour
    ) -> NDArray[np.intp]:
        """The candidates with the most votes, and those with the most unclaimed edges near their salient circles.

        A part that a single ellipse speaks for has few votes, one amid clutter has edges everywhere: neither order
        alone serves all.
        """
        loose = self.parameters.loose_reach_px
        open_ = np.flatnonzero(allowed)
        support = np.array([scene.evidence(candidates.pose(int(i)), contour, loose).salient for i in open_])
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

    def _develop(
        self, candidates: Candidates, i: int, features: Features, scene: SceneEdges, contour: ModelContour
    ) -> _Candidate | None:
        """Refine a candidate on its matched ellipses, match again, and weigh its circles about the axis."""
        T, matches = candidates.pose(i), candidates.matches[i]
        refined: Refinement | None = None
        for _ in range(2):
            refined = self._refine_on_ellipses(T, matches, features)
            if refined is None:
                return None
            T = refined.T_world_part
            matches = vote(T[None, :3, 3], T[None, :3, 2], self.views, features, self.circles)[1][0]
        if refined is None or (matches < 0).all():
            return None
        if self.parameters.joint_edges:
            T = self._refine_on_rims(T, scene, contour)
        v, m, _ = candidates.seed[i]
        return _Candidate(T, matches, features[v][m].process, scene.evidence(T, contour), refined)

    def _refine_on_rims(self, T: Array, scene: SceneEdges, contour: ModelContour) -> Array:
        """Let the edges of all views correct a pose that the ellipses of one view left uncertain in depth."""
        reach = self.parameters.rim_reach_px
        rims = contour.salient()
        refined = refine_pose(
            T, lambda pose, k: scene.observe(pose, rims, reach[k]), self.views, iterations=len(reach), inplane=False
        )
        if refined is None or self._far(refined.T_world_part, T):
            return T
        return refined.T_world_part

    def _far(self, T: Array, T_before: Array) -> bool:
        """Whether a refinement ran away."""
        return bool(np.linalg.norm(T[:3, 3] - T_before[:3, 3]) > 0.05 * self.model.diameter_m)

    def _refine_on_ellipses(self, T: Array, matches: NDArray[np.intp], features: Features) -> Refinement | None:
        def observe(pose: Array, _: int) -> Observations:
            return self._ellipse_observations(pose, matches, features)

        return refine_pose(T, observe, self.views, iterations=4, inplane=False)

    def _ellipse_observations(self, T: Array, matches: NDArray[np.intp], features: Features) -> Observations:
        """Edge points of matched ellipses, each paired with the point of its circle that it is nearest to.

        The viewing ray meets the plane of the circle; the direction from the centre to that point gives the point of
        the circle, and the projected tangent there gives the contour normal.
        """
        blocks = []
        for v, k in zip(*np.nonzero(matches >= 0), strict=True):
            points = features[v][matches[v, k]].points
            stride = max(len(points) // self.parameters.points_per_ellipse, 1)
            pixels = points[::stride]
            T_world_camera, camera = self._cameras[v]
            normal_part = np.array([0.0, 0.0, self.circles.side[k]])
            T_part_camera = np.linalg.inv(T) @ T_world_camera
            rays = np.column_stack([(pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy), np.ones(len(pixels))])
            rays = rays @ T_part_camera[:3, :3].T
            eye = T_part_camera[:3, 3]
            reach = (self.circles.height[k] - eye[2]) / rays[:, 2]
            direction = (eye + reach[:, None] * rays)[:, :2]
            direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
            height = np.full(len(direction), self.circles.height[k])
            model = np.column_stack([direction * self.circles.radius[k], height])
            tangent = np.cross(normal_part, np.column_stack([direction, np.zeros(len(direction))]))
            normals = _image_normals(model, tangent, np.linalg.inv(T_part_camera), camera.fx, camera.fy)
            of_view, of_circle = (np.full(len(pixels), number, np.intp) for number in (v, k))
            blocks.append((of_view, model, pixels, normals, of_circle))
        if not blocks:
            none, flat = np.empty(0, np.intp), np.empty((0, 2))
            return Observations(none, np.empty((0, 3)), flat, flat, np.empty(0), none)
        view, model, pixels, normals, circle = (np.concatenate([b[j] for b in blocks]) for j in range(5))
        return Observations(view, model, pixels, normals, np.full(len(view), 0.3), circle)

    def _accept(
        self, pool: list[_Candidate], minimum_score: float, scene: SceneEdges, contour: ModelContour
    ) -> tuple[list[PoseEstimate], list[_Candidate]]:
        """Greedily accept the best supported candidate, let it claim its edges, and weigh the rest again.

        Returns:
            The accepted poses, and the candidates that are left.
        """
        accepted: list[PoseEstimate] = []
        while pool:
            best = max(pool, key=lambda c: c.score)
            if best.score < minimum_score:
                break
            pool = [c for c in pool if c is not best]
            if not best.turned:
                pool.append(self._turn(best, scene, contour))
                continue
            final = self._finish(best, scene, contour)
            if final is None:
                continue
            accepted.append(final)
            T = final.T_world_part.as_matrix()
            scene.claim(T, contour)
            pool = self._left_over(pool, T[:3, 3], scene, contour)
        return accepted, pool

    def _turn(self, candidate: _Candidate, scene: SceneEdges, contour: ModelContour) -> _Candidate:
        """Settle the rotation about the axis by the supporting features, which then count as well."""
        fold = self.model.symmetry_fold
        if fold is None:
            return replace(candidate, turned=True)
        T, known = scene.find_inplane(candidate.T, contour, fold)
        return replace(candidate, T=T, evidence=scene.evidence(T, contour), turned=True, inplane_known=known)

    def _left_over(
        self, pool: list[_Candidate], origin: Array, scene: SceneEdges, contour: ModelContour
    ) -> list[_Candidate]:
        """The candidates that are not the part just found, those near it weighed without the edges it claimed."""
        left = []
        for candidate in pool:
            distance = np.linalg.norm(candidate.T[:3, 3] - origin) / self.model.diameter_m
            if distance < self.parameters.minimum_separation:
                continue
            if distance < 1.2:
                candidate = replace(candidate, evidence=scene.evidence(candidate.T, contour))
            left.append(candidate)
        return left

    def _finish(self, candidate: _Candidate, scene: SceneEdges, contour: ModelContour) -> PoseEstimate | None:
        """The final refinement of an accepted candidate."""
        refined, T = candidate.refinement, candidate.T
        if self.parameters.joint_edges:
            reach = self.parameters.reach_px
            joint = refine_pose(
                T,
                lambda pose, i: scene.observe(pose, contour, reach[i]),
                self.views,
                iterations=len(reach),
                inplane=candidate.inplane_known,
            )
            if joint is None:
                return None
            if not self._far(joint.T_world_part, T):
                refined, T = joint, joint.T_world_part
        evidence = scene.evidence(T, contour)
        return PoseEstimate(
            part=self.model.part,
            T_world_part=RigidTransform.from_matrix(T),
            covariance=refined.covariance,
            score=evidence.score,
            process=candidate.process,
            residual_px=refined.residual_px,
            views=evidence.views,
            inplane_known=candidate.inplane_known,
        )


def _image_normals(points: Array, tangents: Array, T_camera_part: Array, fx: float, fy: float) -> Array:
    """Unit normals (N, 2) of the image of a curve through points (N, 3) with tangents (N, 3)."""
    x, y, z = (points @ T_camera_part[:3, :3].T + T_camera_part[:3, 3]).T
    tx, ty, tz = (tangents @ T_camera_part[:3, :3].T).T
    along = np.column_stack([fx * (tx - x / z * tz), fy * (ty - y / z * tz)])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.column_stack([along[:, 1], -along[:, 0]])
