"""Guides between views, on a drawn plate whose circles are known."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle, project_circle
from vision.teaching.guides import click_errors, epipolar_curve, faces, predict_circle, predict_ellipse

UPRIGHT = RigidTransform.identity()


@pytest.fixture(scope="module")
def views(photograph):
    return photograph([UPRIGHT], views=5)


@pytest.fixture(scope="module")
def back_view(views):
    """The first view's camera, looking at the plate from below."""
    over = RigidTransform.from_rotation(Rotation.from_euler("x", np.pi))
    return View(views[0].image, views[0].camera, over * views[0].T_world_camera, "back")


def circle_of(plate, name):
    return next(f for f in plate.features if f.name == name).circle


def off_line_px(curve, pixel):
    """Distance of a pixel from a polyline."""
    start, along = curve[:-1], np.diff(curve, axis=0)
    share = np.clip(np.einsum("ij,ij->i", pixel - start, along) / (along**2).sum(axis=1), 0, 1)
    return np.linalg.norm(start + share[:, None] * along - pixel, axis=1).min()


def distorted(view):
    camera = view.camera
    lens = Camera(camera.width_px, camera.height_px, camera.fx, camera.fy, camera.cx, camera.cy, (-0.3, 0.1, 0, 0, 0))
    return View(view.image, lens, view.T_world_camera, view.name)


@pytest.mark.parametrize("within_m", [None, 0.04])
@pytest.mark.parametrize("lens", [lambda view: view, distorted], ids=["straight", "distorted"])
def test_the_point_itself_is_on_its_epipolar_curve(views, lens, within_m):
    first, second = lens(views[0]), lens(views[3])
    for point in np.random.default_rng(20_001).uniform(-0.02, 0.02, (20, 3)):
        curve = epipolar_curve(first.project(point)[0], first, second, within_m=within_m)
        assert off_line_px(curve, second.project(point)[0]) < 0.05


def test_a_part_of_known_size_shortens_the_curve(views):
    pixel = views[0].project(np.zeros(3))[0]
    whole, part = (epipolar_curve(pixel, views[0], views[1], within_m=size) for size in (None, 0.03))
    length = [np.linalg.norm(curve[-1] - curve[0]) for curve in (whole, part)]
    assert length[1] < 0.5 * length[0]
    assert off_line_px(whole, part[0]) < 0.05
    # Its ends are the points of the sight line that are 30 mm from the origin.
    middle = (part[0] + part[-1]) / 2
    assert np.linalg.norm(middle - views[1].project(np.zeros(3))[0]) < 0.05 * length[1]


def test_the_curve_stays_in_the_picture(views):
    curve = epipolar_curve(views[0].project(np.zeros(3))[0], views[0], views[4])
    assert (curve > -0.5).all()
    assert (curve < [639.5, 479.5]).all()
    edge = np.minimum(curve + 0.5, [640, 480] - (curve + 0.5)).min(axis=1)
    assert edge[0] < 5
    assert edge[-1] < 5


def test_a_sight_line_that_misses_the_part_has_no_curve(views):
    far = views[0].project([0.05, 0.0, 0.0])[0]
    assert epipolar_curve(far, views[0], views[1], within_m=0.02).shape == (0, 2)
    # Seen from beside, the line of sight passes outside the picture.
    aside = View(
        views[1].image,
        views[1].camera,
        views[1].T_world_camera * RigidTransform.from_translation([0.5, 0.0, 0.0]),
    )
    assert epipolar_curve(views[0].project(np.zeros(3))[0], views[0], aside, within_m=0.02).shape == (0, 2)


@pytest.mark.parametrize("name", ["outline_front", "ring_front", "bore_front"])
def test_one_view_tells_the_circle_around_the_axis(name, plate, views):
    truth = circle_of(plate, name)
    for number, view in enumerate(views):
        found = predict_circle(views, {number: view.project(truth.sample(24))})
        assert np.allclose(found.centre, truth.centre, atol=1e-6)
        assert found.radius_m == pytest.approx(truth.radius_m, abs=1e-6)
        assert found.normal @ truth.normal > 0.999


def test_one_view_of_the_back_tells_the_circle_there(plate, views, back_view):
    truth = circle_of(plate, "bore_back")
    found = predict_circle([back_view], {0: back_view.project(truth.sample(24))})
    assert np.allclose(found.centre, truth.centre, atol=1e-6)
    assert found.normal.tolist() == [0, 0, -1]


def test_unsteady_clicks_in_one_view_lead_near_the_ellipse_in_another(plate, views):
    rng = np.random.default_rng(20_002)
    truth = circle_of(plate, "outline_front")
    for number in (0, 1, 2, 4):
        clicks = views[number].project(truth.sample(12)) + rng.normal(size=(12, 2))
        predicted = predict_ellipse(views, {number: clicks}, 3)
        assert np.abs(project_circle(truth, views[3]).distance(predicted.sample(60))).max() < 6


def test_two_views_predict_a_third_to_the_click(plate, views):
    rng = np.random.default_rng(20_003)
    for name, coaxial in (("ring_front", True), ("hole_front", False)):
        truth = circle_of(plate, name)
        marks = {v: views[v].project(truth.sample(12)) + rng.normal(scale=0.5, size=(12, 2)) for v in (0, 2)}
        predicted = predict_ellipse(views, marks, 1, coaxial=coaxial)
        assert np.abs(project_circle(truth, views[1]).distance(predicted.sample(60))).max() < 3


def test_a_tilted_circle_is_predicted_from_two_views(views):
    tilted = Circle(np.array([0.004, 0.0, 0.004]), np.array([0.4, 0.0, 1.0]), 0.016)
    marks = {v: views[v].project(tilted.sample(24)) for v in (0, 2)}
    predicted = predict_ellipse(views, marks, 1, coaxial=False)
    assert np.abs(project_circle(tilted, views[1]).distance(predicted.sample(60))).max() < 0.1


def test_marks_on_both_faces_are_no_circle(plate, views, back_view):
    both = [*views, back_view]
    marks = {
        0: views[0].project(circle_of(plate, "ring_front").sample(24)),
        5: back_view.project(circle_of(plate, "bore_back").sample(24)),
    }
    assert predict_circle(both, marks) is None


def test_marks_in_the_view_itself_have_no_say(plate, views):
    truth = circle_of(plate, "ring_front")
    marks = {v: views[v].project(truth.sample(12)) for v in (0, 2)}
    spoilt = marks | {1: views[1].project(truth.sample(12)) + 40}
    assert np.allclose(predict_ellipse(views, spoilt, 1).p, predict_ellipse(views, marks, 1).p)
    assert predict_ellipse(views, {1: marks[0]}, 1) is None


def test_a_hole_beside_the_axis_is_predicted_at_the_height_that_is_assumed(plate, views):
    truth = circle_of(plate, "hole_front")
    marks = {0: views[0].project(truth.sample(12))}
    found = predict_circle(views, marks, coaxial=False, height_m=float(truth.centre[2]))
    assert np.allclose(found.centre, truth.centre, atol=1e-6)
    assert predict_circle(views, marks, coaxial=False).centre[2] == 0


def test_the_other_face_shows_no_prediction(plate, views, back_view):
    truth = circle_of(plate, "ring_front")
    both = [*views, back_view]
    marks = {0: views[0].project(truth.sample(12)), 2: views[2].project(truth.sample(12))}
    assert predict_ellipse(both, marks, len(views)) is None
    assert predict_ellipse(both, {0: marks[0]}, len(views)) is None
    assert not faces(truth, back_view)
    assert faces(truth, views[0])


@pytest.mark.parametrize(
    "marks",
    [
        {},
        {0: np.zeros((4, 2))},
        {0: np.column_stack([np.arange(30.0), np.arange(30.0)])},
        {0: np.full((6, 2), np.nan)},
    ],
    ids=["none", "four", "line", "nan"],
)
def test_marks_that_make_no_circle_predict_nothing(marks, views):
    assert predict_circle(views, marks) is None
    assert predict_ellipse(views, marks, 1) is None


def test_errors_of_clicks_are_their_distances(plate, views):
    truth = circle_of(plate, "outline_front")
    ellipse = project_circle(truth, views[0])
    on = ellipse.sample(8)
    errors = click_errors(truth, views[0], on + 3.0 * ellipse.normals(on))
    assert np.allclose(errors.px, 3, atol=0.05)
    # 3 px at 0.5 m through a lens of 2133 px.
    assert errors.rms_mm == pytest.approx(3 * 500 / 2133, rel=0.02)
    assert errors.rms_px == pytest.approx(3, rel=0.02)
    again = pickle.loads(pickle.dumps(errors))
    assert np.array_equal(again.px, errors.px)
    assert not again.px.flags.writeable


def test_errors_of_a_circle_behind_the_camera_are_none(views):
    behind = Circle(views[0].T_world_camera.translation * 1.5, np.array([0.0, 0.0, 1.0]), 0.01)
    assert click_errors(behind, views[0], np.zeros((5, 2))) is None
