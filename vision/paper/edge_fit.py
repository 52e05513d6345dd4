"""A pose of the paper's system fitted to edges: not the paper's, but the first idea that was added to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from vision.edges.edge_field import EdgeField
from vision.geometry.camera import View
from vision.matching.parameters import MatchingParameters
from vision.matching.scene_edges import SceneEdges
from vision.model.contour import ModelContour
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate
from vision.pose.refinement import Refinement, refine_pose

LEASH = 0.05  # of the part's diameter


def fitted_to_edges(
    estimates: Sequence[PoseEstimate],
    views: Sequence[View],
    model: VisionModel,
    parameters: MatchingParameters | None = None,
) -> list[PoseEstimate]:
    """The poses as the edges along the model in all views have them; those that run away stay as they are.

    Args:
        estimates: poses of one part.
        views: with distortion-free lenses.
        model: of the part.
        parameters: how far edges are looked for; the reach of the first correction of a candidate comes first, for a
            pose by stereo may be off by as much.
    """
    parameters = parameters or MatchingParameters()
    scene = SceneEdges(views, [EdgeField.from_gray(view.gray) for view in views], parameters.confirmation)
    reach = (*parameters.rim_reach_px, *parameters.reach_px)
    origins = [estimate.T_world_part.translation for estimate in estimates]
    distances = [float(np.linalg.norm(o - views[0].T_world_camera.translation)) for o in origins]
    contour = ModelContour.of(model, views[0].camera.fx / float(np.median(distances or [1.0])))
    fitted = []
    for estimate in estimates:
        found = refine_pose(
            estimate.T_world_part.as_matrix(),
            lambda pose, i: scene.observe(pose, contour, reach[i]),
            views,
            iterations=len(reach),
            inplane=estimate.inplane_known,
            calibration=parameters.calibration,
            edge_errors=parameters.edge_errors,
        )
        fitted.append(estimate if found is None else _moved(estimate, found, model))
    return fitted


def _moved(estimate: PoseEstimate, found: Refinement, model: VisionModel) -> PoseEstimate:
    """The estimate with the refined pose, unless this has run away."""
    T = RigidTransform.from_matrix(found.T_world_part)
    if np.linalg.norm(T.translation - estimate.T_world_part.translation) > LEASH * model.diameter_m:
        return estimate
    return replace(estimate, T_world_part=T, covariance=found.covariance, residual_px=found.residual_px)
