"""The paper's system as a localizer: the taught extractor finds, the other verifies, two or three views give the pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace, depth_range
from vision.localizer import Localization, checked_models, checked_scene
from vision.matching.candidates import find_candidates
from vision.model.vision_model import CircleFeature, SalientCircles, VisionModel
from vision.paper.edge_grouping import AggregationParameters, group_by_aggregation
from vision.paper.region_growing import PruningParameters, grow_ellipses
from vision.paper.supporting import best_turn, sightings, turned, window
from vision.pose.estimate import PoseEstimate
from vision.pose.stereo import absolute_orientation, pose_by_stereo, rim_correspondences

Array = NDArray[np.float64]
Names = NDArray[np.bool_]
UNKNOWN_DEPTH_M = (0.1, 10.0)


@dataclass(frozen=True)
class PaperParameters:
    """Settings of the paper's system.

    Attributes:
        region: of region growing.
        group: of edge grouping.
        size_slack: by how much the semi-major axis of an ellipse may differ from what the workspace allows.
        most_hypotheses: so many of the best supported correspondences are verified.
        fewest_matches: least number of ellipses, over all views, that a hypothesis must explain.
        fewest_supporting: least number of supporting features, over all views, that must verify it.
        separation: parts found nearer to each other than this share of their diameter are one.
    """

    region: PruningParameters = field(default_factory=lambda: PruningParameters(smaller=0.1, larger=5.0, grey=3.0))
    group: AggregationParameters = field(default_factory=AggregationParameters)
    size_slack: float = 0.15
    most_hypotheses: int = 60
    fewest_matches: int = 3
    fewest_supporting: int = 1
    separation: float = 0.4


class PaperLocalizer:
    """The system of the paper, or its predecessor [18], which has region growing alone."""

    def __init__(
        self,
        models: Sequence[VisionModel],
        name: str = "paper",
        parameters: PaperParameters | None = None,
    ) -> None:
        """Prepare.

        Args:
            models: the taught parts to look for.
            name: "paper" follows the taught strategy; "previous" extracts every feature by region growing.
            parameters: settings.

        Raises:
            InputError: when there is no model.
        """
        self.models = checked_models(models)
        self.name = name
        self.parameters = parameters or PaperParameters()

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:
        """See :meth:`vision.localizer.Localizer.localize`."""
        flat = [v.undistorted() for v in checked_scene(views, workspace)]
        found = [estimate for model in self.models for estimate in self._find(flat, model, workspace)]
        estimates = tuple(sorted((e for e, _ in found), key=lambda e: -e.score))
        return Localization(estimates)

    def _find(self, views, model, workspace):
        salient = [self._extract(v, model.salient, workspace) for v in views]
        features, names = [[f for f, _ in s] for s in salient], [[n for _, n in s] for s in salient]
        candidates = find_candidates(views, features, model, workspace)
        if not len(candidates):
            return []
        named = np.array([names[v][m][k] for v, m, k in candidates.seed], dtype=bool)
        candidates = candidates.take(np.flatnonzero(named)).distinct(model.diameter_m)
        circles = SalientCircles.of(model)
        out = []
        poses = candidates.poses()
        for i in range(min(len(candidates), self.parameters.most_hypotheses)):
            matches = candidates.matches[i].copy()
            for v in range(len(views)):
                for k in range(matches.shape[1]):
                    if matches[v, k] >= 0 and not names[v][matches[v, k]][k]:
                        matches[v, k] = -1
            if (matches >= 0).sum() < self.parameters.fewest_matches:
                continue
            T = pose_by_stereo(poses[i], matches, features, views, circles)
            if T is None:
                continue
            if any(np.linalg.norm(T[:3, 3] - o.T_world_part.translation) < self.parameters.separation * model.diameter_m for o, _ in out):
                continue
            seen = self._sightings(T, model, views, workspace)
            turn, agree = best_turn(seen, model.supporting, model.symmetry_fold)
            if len(agree) < self.parameters.fewest_supporting:
                continue
            T = turned(T, turn)
            out.append((PoseEstimate(model.part, RigidTransform.from_matrix(T), 1e-6*np.eye(6), float(min(1, 0.1*((matches>=0).sum()+0.5*len(agree)))), features[candidates.seed[i][0]][candidates.seed[i][1]].process, 0.0, int((matches>=0).any(axis=1).sum()), True), matches))
        return out

    def _sightings(self, T, model, views, workspace):
        radii = [c.circle.radius_m for c in model.supporting]
        windows = [w for v in views if (w := window(v, T, model.diameter_m, radii)) is not None]
        found = [[f for f, _ in self._extract(w, model.supporting, workspace)] for w in windows]
        return sightings(T, found, windows, model.supporting)

    def _extract(self, view: View, circles: Sequence[CircleFeature], workspace: Workspace | None):
        """Ellipses by the extractors taught for these circles, with which circles each can be."""
        near, far = depth_range(view, workspace) if workspace is not None else UNKNOWN_DEPTH_M
        fx = view.camera.fx
        mine = lambda e: [i for i, c in enumerate(circles) if ("region" if self.name == "previous" else c.extractor) == e]
        out = []
        region, group = mine("region"), mine("group")
        slack = self.parameters.size_slack
        if region:
            for n in grow_ellipses(view.gray, [circles[i] for i in region], (fx / far, fx / near), self.parameters.region):
                allowed = np.zeros(len(circles), bool)
                allowed[region] = n.circles
                out.append((n.feature, allowed))
        if group:
            radii = np.array([circles[i].circle.radius_m for i in group])
            size = ((1 - slack) * fx * radii.min() / far, (1 + slack) * fx * radii.max() / near)
            for f in group_by_aggregation(view.gray, size, self.parameters.group):
                a = f.ellipse.semi_axes[0]
                allowed = np.zeros(len(circles), bool)
                allowed[group] = ((1 - slack) * fx * radii / far <= a) & (a <= (1 + slack) * fx * radii / near)
                if allowed.any():
                    out.append((f, allowed))
        return out
