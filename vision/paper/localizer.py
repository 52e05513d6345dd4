"""The paper's system as a localizer: the taught extractor finds, the other one verifies, stereo gives the pose."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace, depth_range
from vision.localizer import Localization, checked_models, checked_scene
from vision.model.projection import GRAZING_COSINE
from vision.model.vision_model import CircleFeature, SalientCircles, VisionModel
from vision.paper.correspondence import Correspondence, correspondences
from vision.paper.edge_fit import fitted_to_edges
from vision.paper.edge_grouping import group_by_aggregation
from vision.paper.own_extractors import both_extractors
from vision.paper.parameters import PaperParameters
from vision.paper.region_growing import NamedEllipse, grow_ellipses
from vision.paper.stereo_covariance import stereo_covariance
from vision.paper.supporting import SecondLook, Sighting, best_turn, turned
from vision.pose.estimate import PoseEstimate

Array = NDArray[np.float64]
PAPER_PRESETS = ("paper", "previous")
UNKNOWN_DEPTH_M = (0.05, 20.0)  # without a workspace


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
        if self.parameters.own_extractors:
            return both_extractors(view.gray, circles, px_per_m, self.parameters)
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
        """Section 6: correspondences of salient features, verified by supporting ones; best first."""
        features = [[n.feature for n in named] for named in salient]
        look = SecondLook(
            views, model, lambda view: [n.feature for n in self._extract(view, model.supporting, workspace)]
        )
        verified = []
        for found in correspondences(views, salient, model, workspace, self.parameters):
            turn, seen = best_turn(look.sightings(found.T_world_part), model.supporting, model.symmetry_fold)
            if len(seen) >= self.parameters.fewest_supporting or not model.supporting:
                T = turned(found.T_world_part, turn)
                verified.append((_score(T, found, seen, views, model), T, found, seen))
        accepted: list[PoseEstimate] = []
        explained: set[tuple[int, int]] = set()
        for score, T, found, seen in sorted(verified, key=lambda v: -v[0]):
            ellipses = found.ellipses()
            shared = len(ellipses & explained) > self.parameters.shared * len(ellipses)
            if not shared and self._is_apart(T, accepted, model):
                explained |= ellipses
                accepted.append(_estimate(T, found, seen, score, features, views, model))
        return fitted_to_edges(accepted, views, model) if self.parameters.edge_fit else accepted

    def _is_apart(self, T: Array, accepted: Sequence[PoseEstimate], model: VisionModel) -> bool:
        least_m = self.parameters.separation * model.diameter_m
        return all(np.linalg.norm(T[:3, 3] - e.T_world_part.translation) > least_m for e in accepted)


def _scattered(values: NDArray[np.bool_], places: Sequence[int], length: int) -> NDArray[np.bool_]:
    out = np.zeros(length, dtype=bool)
    out[places] = values
    return out


def _score(
    T: Array, found: Correspondence, seen: Sequence[Sighting], views: Sequence[View], model: VisionModel
) -> float:
    """The share of the features in sight that were found, over all views; a copy of many counts for its share."""
    pose = RigidTransform.from_matrix(T)
    eyes = np.array([view.T_world_camera.translation for view in views])
    shown = 0
    for feature in model.features:
        circle = feature.circle.moved(pose)
        towards = eyes - circle.centre
        shown += int((towards @ circle.normal > GRAZING_COSINE * np.linalg.norm(towards, axis=1)).sum())
    counts = Counter((s.feature, s.view) for s in seen)
    supporting = sum(min(n / model.supporting[k].copies, 1.0) for (k, _), n in counts.items())
    return float(min(1.0, (np.count_nonzero(found.matches >= 0) + supporting) / max(shown, 1)))


def _estimate(
    T: Array,
    found: Correspondence,
    seen: Sequence[Sighting],
    score: float,
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    model: VisionModel,
) -> PoseEstimate:
    """Section 7: the pose with its covariance; the extractor is that of most of its ellipses."""
    covariance, residual_px = stereo_covariance(T, found.matches, features, views, SalientCircles.of(model))
    extractors = Counter(features[v][m].extractor for v, m in sorted(found.ellipses()))
    return PoseEstimate(
        part=model.part,
        T_world_part=RigidTransform.from_matrix(T),
        covariance=covariance,
        score=score,
        extractor=extractors.most_common(1)[0][0],
        residual_px=residual_px,
        views=int(np.count_nonzero((found.matches >= 0).any(axis=1))),
        inplane_known=bool(seen),
    )
