"""Poses behind pieces of the outline of a drawn plate."""

from __future__ import annotations

import numpy as np
import pytest

from vision.extraction import Arc, arcs_of
from vision.geometry.camera import camera_arrays
from vision.geometry.circle import project_circle
from vision.geometry.workspace import Workspace
from vision.grouping.edge_grouping import GroupingParameters, group_edges
from vision.matching.arcs import arc_poses
from vision.model.vision_model import SalientCircles

WORKSPACE = Workspace((-0.06, -0.06, -0.02), (0.06, 0.06, 0.03))


def outline_arc(plate, T, view, first_deg, span_deg, rng):
    """A piece of the outline's image with the noise of edge points."""
    ellipse = project_circle(plate.salient[0].circle.moved(T), view)
    points = ellipse.sample(720)[np.arange(int(2 * span_deg)) + int(2 * first_deg)]
    return Arc(points + rng.normal(scale=0.1, size=points.shape), -ellipse.normals(points))


@pytest.mark.parametrize(("first_deg", "span_deg"), [(10, 90), (150, 120), (60, 200)])
def test_a_piece_of_the_outline_leads_near_the_pose(first_deg, span_deg, plate, photograph, pose):
    truth = pose(8, -5, 0, about=(4, -3, 0))
    (view,) = photograph([], views=[1])
    arc = outline_arc(plate, truth, view, first_deg, span_deg, np.random.default_rng(10_021))
    poses, seed = arc_poses([[arc]], [view], camera_arrays([view]), SalientCircles.of(plate), WORKSPACE)
    fronts = poses[seed[:, 2] == 0]
    along_sight = truth.translation - view.T_world_camera.translation
    along_sight /= np.linalg.norm(along_sight)
    off = fronts[:, :3, 3] - truth.translation
    across = np.linalg.norm(off - (off @ along_sight)[:, None] * along_sight, axis=1)
    assert across.min() < 0.0025
    assert (np.linalg.norm(off, axis=1) < 0.02).any()
    assert (seed[:, :2] == (0, -1)).all()
    assert (fronts[:, 2, 2] > 0.9).all()


def test_a_straight_edge_suggests_no_plate(plate, photograph):
    (view,) = photograph([], views=[1])
    points = np.column_stack([np.linspace(200, 420, 120), np.full(120, 240.0)])
    arc = Arc(points, np.tile([0.0, 1.0], (120, 1)))
    poses, _ = arc_poses([[arc]], [view], camera_arrays([view]), SalientCircles.of(plate), WORKSPACE)
    assert len(poses) == 0


def test_no_arcs_no_poses(plate, photograph):
    views = photograph([])
    poses, seed = arc_poses([[], [], []], views, camera_arrays(views), SalientCircles.of(plate), WORKSPACE)
    assert poses.shape == (0, 4, 4)
    assert seed.shape == (0, 3)


def test_arcs_are_long_fragments_whose_normals_point_inwards(plate, photograph, pose):
    T = pose(2, 1, 0, about=(3, -4, 0))
    (view,) = photograph([T], views=[0], noise=0)
    arcs = arcs_of(group_edges(view.gray, GroupingParameters.for_model()), 60)
    assert arcs
    assert [len(a.points) for a in arcs] == sorted((len(a.points) for a in arcs), reverse=True)
    outline = project_circle(plate.salient[0].circle.moved(T), view)
    mine = [arc for arc in arcs if (np.abs(outline.distance(arc.points)) < 1).mean() > 0.9]
    assert mine
    for arc in mine:
        assert (np.einsum("ij,ij->i", outline.centre - arc.points, arc.inwards) > 0).all()
