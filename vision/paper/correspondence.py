"""The first phase (Section 6): ellipses of all views that one pose explains, by their attributes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.features import EllipseFeature
from vision.frozen import frozen_arrays
from vision.geometry.camera import View, camera_arrays
from vision.geometry.workspace import Workspace
from vision.matching.candidates import Candidates, find_candidates
from vision.matching.votes import EllipseTable, count_votes
from vision.model.vision_model import SalientCircles, VisionModel
from vision.paper.parameters import PaperParameters
from vision.paper.region_growing import NamedEllipse
from vision.pose.stereo import pose_by_stereo

Array = NDArray[np.float64]
Matches = NDArray[np.intp]
Features = Sequence[Sequence[EllipseFeature]]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Correspondence:
    """Ellipses that one pose explains.

    Attributes:
        T_world_part: (4, 4) the pose by stereo, but for its turn about the axis.
        matches: (V, K) number of the ellipse within its view that shows a salient circle, -1 for none.
    """

    T_world_part: Array
    matches: Matches

    def ellipses(self) -> frozenset[tuple[int, int]]:
        """View and number of every ellipse that is explained."""
        return frozenset(
            (int(v), int(self.matches[v, k])) for v, k in zip(*np.nonzero(self.matches >= 0), strict=True)
        )


def correspondences(
    views: Sequence[View],
    salient: Sequence[Sequence[NamedEllipse]],
    model: VisionModel,
    workspace: Workspace | None,
    parameters: PaperParameters,
) -> list[Correspondence]:
    """Correspondences of the salient features, those that explain most first.

    The reading of one ellipse leaves its tilt and distance unsure. Its circle is therefore looked for with much slack
    in the other views; the ellipses that show it there give the pose by stereo, and this pose says which ellipses
    show the other circles.
    """
    features = [[n.feature for n in named] for named in salient]
    circles, table, cameras = SalientCircles.of(model), EllipseTable.of(features), camera_arrays(views)
    readings = _readings(views, features, salient, model, workspace).distinct(model.diameter_m)
    readings = readings.take(np.arange(min(len(readings), parameters.most_candidates)))
    if not len(readings):
        return []
    _, loose = count_votes(readings.poses(), cameras, circles, table, parameters.slack)
    poses = []
    for T, (v, m, k), seen in zip(readings.poses(), readings.seed, loose, strict=True):
        same = np.full_like(seen, -1)
        same[:, k] = _named(seen, salient)[:, k]
        same[v, k] = m
        pose = pose_by_stereo(T, same, features, views, circles, passes=1)
        if pose is not None:
            poses.append(pose)
    if not poses:
        return []
    votes, matches = count_votes(np.array(poses), cameras, circles, table)
    best_first = [(poses[i], _named(matches[i], salient)) for i in np.argsort(-votes, kind="stable")]
    distinct = {named.tobytes(): (T, named) for T, named in reversed(best_first)}
    found = []
    for T, named in reversed(distinct.values()):
        pose = pose_by_stereo(T, named, features, views, circles)
        if pose is not None and np.count_nonzero(named >= 0) >= parameters.fewest_matches:
            found.append(Correspondence(pose, named))
    return found[: parameters.most_hypotheses]


def _readings(
    views: Sequence[View],
    features: Features,
    salient: Sequence[Sequence[NamedEllipse]],
    model: VisionModel,
    workspace: Workspace | None,
) -> Candidates:
    """Every ellipse, read as every circle that it can be by its attributes."""
    candidates = find_candidates(views, features, model, workspace)
    named = np.array([salient[v][m].circles[k] for v, m, k in candidates.seed], dtype=bool)
    return candidates.take(np.flatnonzero(named))


def _named(matches: Matches, salient: Sequence[Sequence[NamedEllipse]]) -> Matches:
    """Matches (V, K) without the ellipses that cannot be the circle by their attributes."""
    kept = matches.copy()
    for v, k in zip(*np.nonzero(matches >= 0), strict=True):
        if not salient[v][matches[v, k]].circles[k]:
            kept[v, k] = -1
    return kept
