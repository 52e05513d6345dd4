import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle, circle_poses, plane_axes, project_circle

CAMERA = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
coordinate = st.floats(-0.1, 0.1)


def view_at(T_world_camera=None):
    T = RigidTransform.identity() if T_world_camera is None else T_world_camera
    return View(np.zeros((480, 640), np.uint8), CAMERA, T)


circles = st.builds(
    lambda x, y, z, nx, ny, r: Circle(np.array([x, y, z]), np.array([nx, ny, -1.0]), r),
    coordinate,
    coordinate,
    st.floats(0.5, 2.5),
    st.floats(-1.5, 1.5),
    st.floats(-1.5, 1.5),
    st.floats(0.005, 0.12),
)


@given(circles)
def test_projected_points_lie_on_the_projected_ellipse(circle):
    ellipse = project_circle(circle, view_at())
    assert ellipse is not None
    assert np.abs(ellipse.distance(CAMERA.project(circle.sample(24)))).max() < 1e-4


@given(circles)
def test_one_of_the_two_candidates_is_the_circle(circle):
    ellipse = project_circle(circle, view_at())
    candidates = circle_poses(ellipse, CAMERA, circle.radius_m)
    best = min(candidates, key=lambda c: 1 - c.normal @ circle.normal * np.sign(-circle.normal @ circle.centre))
    assert np.linalg.norm(best.centre - circle.centre) < 1e-5
    assert abs(best.normal @ circle.normal) > 1 - 1e-4


@given(circles)
def test_both_candidates_have_the_same_image_and_face_the_camera(circle):
    ellipse = project_circle(circle, view_at())
    for candidate in circle_poses(ellipse, CAMERA, circle.radius_m):
        assert candidate.normal @ candidate.centre < 0
        again = project_circle(candidate, view_at())
        assert np.abs(again.distance(ellipse.sample(20))).max() < 1e-3


def test_a_circle_behind_the_camera_has_no_image():
    assert project_circle(Circle(np.array([0, 0, -1.0]), np.array([0, 0, 1.0]), 0.05), view_at()) is None


def test_world_poses_cancel():
    circle = Circle(np.array([0.02, -0.01, 1.0]), np.array([0.3, 0.1, -1]), 0.05)
    T_world_camera = RigidTransform.from_components([1, 2, 3], Rotation.from_rotvec([0.3, -0.8, 1.1]))
    moved = project_circle(circle.moved(T_world_camera), view_at(T_world_camera))
    assert np.allclose(moved.geometric, project_circle(circle, view_at()).geometric, atol=1e-6)


def test_a_moved_circle_lies_where_its_points_are_moved_to():
    circle = Circle(np.array([0.02, -0.01, 1.0]), np.array([0.3, 0.1, -1]), 0.05)
    T = RigidTransform.from_components([1, 2, 3], Rotation.from_rotvec([0.3, -0.8, 1.1]))
    moved, points = circle.moved(T), T.apply(circle.sample(12))
    assert np.allclose((points - moved.centre) @ moved.normal, 0, atol=1e-12)
    assert np.allclose(np.linalg.norm(points - moved.centre, axis=1), moved.radius_m)
    assert (T.rotation.as_matrix() @ circle.normal) @ moved.normal > 0


def test_plane_axes_are_right_handed():
    n = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, -1], [0.6, 0, 0.8]])
    u, v = plane_axes(n)
    assert np.allclose(np.cross(u, v), n)
