"""The paper's system as a localizer: the taught extractor finds, the other one verifies, stereo gives the pose."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.features import EllipseFeature, Extractor
from vision.geometry.camera import View, camera_arrays
from vision.geometry.workspace import Workspace, depth_range
from vision.localizer import Localization, checked_models, checked_scene
from vision.matching.candidates import find_candidates
from vision.matching.votes import EllipseTable, count_votes
from vision.model.vision_model import CircleFeature, SalientCircles, VisionModel
from vision.paper.edge_grouping import AggregationParameters, group_by_aggregation
from vision.paper.region_growing import NamedEllipse, PruningParameters, grow_ellipses
from vision.paper.stereo_covariance import stereo_covariance
from vision.paper.supporting import Sighting, best_turn, sightings, turned, window
from vision.pose.estimate import PoseEstimate
from vision.pose.stereo import pose_by_stereo
from vision.settings import NOT_NEGATIVE, POSITIVE, check, count

Array = NDArray[np.float64]
Matches = NDArray[np.intp]
PAPER_PRESETS = ("paper", "previous")
UNKNOWN_DEPTH_M = (0.05, 20.0)  # without a workspace


@dataclass(frozen=True)
class PaperParameters:
    """Settings of the paper's system.

    Attributes:
        region: of region growing.
        group: of edge grouping.
        size_slack: by how much the semi-major axis of an ellipse may leave what the workspace allows.
        slack: factor on the tolerances with which the same circle is looked for in another view.
        most_hypotheses: so many of the best supported correspondences are verified.
        fewest_matches: least number of ellipses, over all views, that a correspondence must explain.
        fewest_supporting: least number of supporting features, over all views, that must verify a hypothesis.
        separation: parts found nearer to each other than this share of their diameter are one.
    """

    region: PruningParameters = field(default_factory=PruningParameters)
    group: AggregationParameters = field(default_factory=AggregationParameters)
    size_slack: float = 0.15
    slack: float = 4.0
    most_hypotheses: int = 100
    fewest_matches: int = 2
    fewest_supporting: int = 1
    separation: float = 0.4

    def __post_init__(self) -> None:
        check(self, size_slack=NOT_NEGATIVE, slack=POSITIVE, separation=POSITIVE)
        check(self, most_hypotheses=count(1), fewest_matches=count(1), fewest_supporting=count())


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    """A correspondence: a pose (4, 4) but for its turn, and the ellipses (V, K) that it explains."""

    T_world_part: Array
    matches: Matches
    extractor: Extractor


class PaperLocalizer:
    """The system of the paper, or its predecessor [18].

    Attributes:
        models: the taught parts.
        name: ``paper`` extracts every feature as its model says; ``previous`` has region growing alone.
        parameters: settings.
    """

    def __init__(
        self, models: Sequence[VisionModel], name: str = "paper", parameters: PaperParameters | None = None
    ) -> None:
        """Prepare.

        Raises:
            InputError: when there is no model, or no such preset.
        """
        if name not in PAPER_PRESETS:
            raise InputError("preset of the paper's system", got=repr(name), expected=" or ".join(PAPER_PRESETS))
        self.models = checked_models(models)
        self.name = name
        self.parameters = parameters or PaperParameters()

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:
        """See :meth:`vision.localizer.Localizer.localize`."""
        flat = [view.undistorted() for view in checked_scene(views, workspace)]
        estimates: list[PoseEstimate] = []
        features: list[list[EllipseFeature]] = [[] for _ in flat]
        for model in self.models:
            salient = [self._extract(view, model.salient, workspace) for view in flat]
            estimates += self._match(flat, salient, model, workspace)
            for of_view, named in zip(features, salient, strict=True):
                of_view += [n.feature for n in named]
        best_first = sorted(estimates, key=lambda e: -e.score)
        return Localization(tuple(best_first), tuple(tuple(f) for f in features))

    def _extract(
        self, view: View, circles: Sequence[CircleFeature], workspace: Workspace | None
    ) -> list[NamedEllipse]:
        """Section 5: ellipses that can be these circles, each circle's by the extractor that was taught for it."""
        near, far = depth_range(view, workspace) if workspace is not None else UNKNOWN_DEPTH_M
        px_per_m = view.camera.fx / far, view.camera.fx / near
        by_regions = np.array([self.name == "previous" or c.extractor == "region" for c in circles], dtype=bool)
        found = []
        if by_regions.any():
            asked = np.flatnonzero(by_regions).tolist()
            for named in grow_ellipses(view.gray, [circles[i] for i in asked], px_per_m, self.parameters.region):
                found.append(replace(named, circles=_scattered(named.circles, asked, len(circles))))
        if not by_regions.all():
            asked = np.flatnonzero(~by_regions).tolist()
            slack = self.parameters.size_slack
            radii_m = np.array([circles[i].circle.radius_m for i in asked])
            least, most = (1 - slack) * px_per_m[0] * radii_m, (1 + slack) * px_per_m[1] * radii_m
            for feature in group_by_aggregation(view.gray, (least.min(), most.max()), self.parameters.group):
                fits = (least <= feature.ellipse.semi_axes[0]) & (feature.ellipse.semi_axes[0] <= most)
                found.append(NamedEllipse(feature, _scattered(fits, asked, len(circles))))
        return found

    def _match(
        self,
        views: Sequence[View],
        salient: Sequence[Sequence[NamedEllipse]],
        model: VisionModel,
        workspace: Workspace | None,
    ) -> list[PoseEstimate]:
        """Section 6: correspondences of salient features, verified by supporting ones; best first, one a place."""
        features = [[n.feature for n in named] for named in salient]
        circles = SalientCircles.of(model)
        accepted: list[PoseEstimate] = []
        for hypothesis in self._hypotheses(views, salient, model, workspace):
            T = pose_by_stereo(hypothesis.T_world_part, hypothesis.matches, features, views, circles)
            if T is None or not self._is_apart(T, accepted, model):
                continue
            turn, seen = best_turn(self._sightings(T, views, model, workspace), model.supporting, model.symmetry_fold)
            if len(seen) < self.parameters.fewest_supporting:
                continue
            accepted.append(_estimate(turned(T, turn), hypothesis, seen, features, views, model))
        return accepted

    def _hypotheses(
        self,
        views: Sequence[View],
        salient: Sequence[Sequence[NamedEllipse]],
        model: VisionModel,
        workspace: Workspace | None,
    ) -> Iterator[_Hypothesis]:
        """The first phase: ellipses of all views that one pose explains, by their attributes; best first."""
        features = [[n.feature for n in named] for named in salient]
        candidates = find_candidates(views, features, model, workspace)
        named = np.array([salient[v][m].circles[k] for v, m, k in candidates.seed], dtype=bool)
        candidates = candidates.take(np.flatnonzero(named)).distinct(model.diameter_m)
        candidates = candidates.take(np.arange(min(len(candidates), self.parameters.most_hypotheses)))
        circles, table, cameras = SalientCircles.of(model), EllipseTable.of(features), camera_arrays(views)
        # The reading of one ellipse leaves its tilt and distance unsure: its circle is looked for with much slack in
        # the other views, and the two ellipses together say where the others have to be.
        loose = count_votes(candidates.poses(), cameras, circles, table, self.parameters.slack)[1]
        poses, seeds = [], []
        for T, (v, m, k), matches in zip(candidates.poses(), candidates.seed, loose, strict=True):
            same = np.full_like(matches, -1)
            same[:, k] = [i if i >= 0 and salient[w][i].circles[k] else -1 for w, i in enumerate(matches[:, k])]
            same[v, k] = m
            found = pose_by_stereo(T, same, features, views, circles)
            if found is not None:
                poses.append(found)
                seeds.append((v, m))
        if not poses:
            return
        votes, matched = count_votes(np.array(poses), cameras, circles, table)
        for i in np.argsort(-votes, kind="stable"):
            matches = matched[i]
            for v, k in zip(*np.nonzero(matches >= 0), strict=True):
                if not salient[v][matches[v, k]].circles[k]:
                    matches[v, k] = -1
            if np.count_nonzero(matches >= 0) >= self.parameters.fewest_matches:
                v, m = seeds[i]
                yield _Hypothesis(poses[i], matches, features[v][m].extractor)

    def _is_apart(self, T: Array, accepted: Sequence[PoseEstimate], model: VisionModel) -> bool:
        least_m = self.parameters.separation * model.diameter_m
        return all(np.linalg.norm(T[:3, 3] - e.T_world_part.translation) > least_m for e in accepted)

    def _sightings(
        self, T: Array, views: Sequence[View], model: VisionModel, workspace: Workspace | None
    ) -> list[Sighting]:
        """The second phase: the extractor taught for the supporting features looks for them around a prediction."""
        if not model.supporting:
            return []
        radii_m = [c.circle.radius_m for c in model.supporting]
        windows = [window(view, T, model.diameter_m, radii_m) for view in views]
        seen = [w for w in windows if w is not None]
        found = [[n.feature for n in self._extract(w, model.supporting, workspace)] for w in seen]
        return sightings(T, found, seen, model.supporting)


def _scattered(values: NDArray[np.bool_], places: Sequence[int], length: int) -> NDArray[np.bool_]:
    out = np.zeros(length, dtype=bool)
    out[places] = values
    return out


def _estimate(
    T: Array,
    hypothesis: _Hypothesis,
    seen: Sequence[Sighting],
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    model: VisionModel,
) -> PoseEstimate:
    """Section 7: the pose, with the share of the features in sight that were found as its score."""
    eyes = np.array([view.T_world_camera.translation for view in views])
    facing = sum(
        int(np.count_nonzero((eyes - c.centre) @ c.normal > 0))
        for feature in model.features
        for c in (circle.moved(RigidTransform.from_matrix(T)) for circle in feature.circles())
    )
    matched = hypothesis.matches >= 0
    covariance, residual_px = stereo_covariance(T, hypothesis.matches, features, views, SalientCircles.of(model))
    return PoseEstimate(
        part=model.part,
        T_world_part=RigidTransform.from_matrix(T),
        covariance=covariance,
        score=min(1.0, (np.count_nonzero(matched) + len(seen)) / max(facing, 1)),
        extractor=hypothesis.extractor,
        residual_px=residual_px,
        views=int(np.count_nonzero(matched.any(axis=1))),
        inplane_known=bool(seen),
    )
