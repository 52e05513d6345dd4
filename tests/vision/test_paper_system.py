"""The paper's own system on drawn plates, and its parts on drawn ellipses."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse, focal_jacobian, focal_residual
from vision.geometry.workspace import Workspace
from vision.model.vision_model import AttributeRange
from vision.paper.edge_grouping import AggregationParameters, group_by_aggregation
from vision.paper.ellipse_filter import EllipseFilter, initial_estimate
from vision.paper.localizer import PaperLocalizer
from vision.paper.region_growing import PruningParameters, attribute_constraints, grow_ellipses
from vision.paper.supporting import sightings, window

WORKSPACE = Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))
TRUE = Ellipse.from_geometric(100.0, 80.0, 50.0, 30.0, 0.4)


@pytest.fixture(scope="module")
def drawn():
    """A bright ellipse and a small one on a dark ground."""
    image = np.full((480, 640), 40.0)
    y, x = np.mgrid[:480, :640]
    for ellipse, grey in ((Ellipse.from_geometric(300, 220, 90, 60, 0.5), 180), (TRUE, 120)):
        inside = ellipse.distance(np.column_stack([x.ravel(), y.ravel()]).astype(float)).reshape(480, 640)
        image += np.clip(0.5 - inside, 0, 1) * (grey - image)
    return cv2.GaussianBlur(image, None, 0.7).round().astype(np.uint8)


@pytest.fixture
def scene(pose):
    return [pose(-33, 0, 0, about=(5, 3, 11)), pose(33, 4, 1, about=(-4, 6, 70))]


def strategy(model, salient, supporting):
    """The model with other extractors for its salient and its supporting features."""
    of_role = {"salient": salient, "supporting": supporting}
    return replace(model, features=tuple(replace(f, extractor=of_role[f.role]) for f in model.features))


def test_moments_of_a_whole_outline_are_those_of_the_ellipse():
    assert initial_estimate(TRUE.sample(400))[4] == pytest.approx(TRUE.p[4], rel=0.05)


def test_the_filter_finds_an_ellipse_from_a_rough_estimate():
    points = TRUE.sample(64) + np.random.default_rng(10_000).normal(scale=0.2, size=(64, 2))
    state = EllipseFilter(initial_estimate(points) + np.array([4, -3, 3, 2, 6]), prior_px=15.0, noise_px=1.0)
    before = state.fitting_error(points)
    state.take_in(points)
    assert state.is_ellipse
    assert state.fitting_error(points) < 0.2 * before
    assert np.abs(Ellipse(state.p).semi_axes - np.array(TRUE.semi_axes)).max() < 1.5
    assert np.linalg.eigvalsh(state.covariance).min() > 0


def test_foci_that_start_in_the_centroid_stay_together_but_for_rounding():
    """The printed initial estimate: f changes alike with both focal points, so nothing but rounding can part them."""
    points, states = TRUE.sample(64), []
    for printed in (True, False):
        state = EllipseFilter(initial_estimate(points, foci_in_centroid=printed), prior_px=15.0, noise_px=1.0)
        state.take_in(points[:4])
        apart = np.hypot(*(state.p[:2] - state.p[2:4]))
        assert apart < 1e-6 if printed else apart > 10
        state.take_in(points[4:])
        states.append(state)
    assert states[0].fitting_error(points) > 5 * states[1].fitting_error(points)


def test_grouping_finds_what_has_the_right_size(drawn):
    def found(low, high):
        features = group_by_aggregation(drawn, (low, high))
        return sorted(round(float(f.ellipse.semi_axes[0]) / 10) for f in features)

    assert found(30, 120) == [5, 9]
    assert found(30, 70) == [5]


def test_a_group_is_of_compatible_fragments():
    """Two halves of an ellipse, one on brighter ground, are one where grey levels may differ so much."""
    image = two_halves((180, 40), (120, 80))

    def found(grey_tolerance):
        parameters = AggregationParameters(grey_tolerance=grey_tolerance, min_share=0.5)
        return [f for f in group_by_aggregation(image, (80, 120), parameters) if f.ellipse.semi_axes[1] > 50]

    assert len(found(100.0)) == 1
    assert found(20.0) == []


def two_halves(left, right):
    """An ellipse of 100 x 70 px whose contrast fades in the middle; grey inside and outside, left and right."""
    y, x = np.mgrid[:300, :400]
    inside = ((x - 200) / 100.0) ** 2 + ((y - 150) / 70.0) ** 2 < 1
    image = np.where(x < 200, np.where(inside, *left), np.where(inside, *right))
    faded = 110 + (image - 110) * np.clip((np.abs(x - 200) - 20) / 20, 0, 1)
    return cv2.GaussianBlur(faded.astype(np.uint8), None, 0.7)


def test_a_fragment_that_does_not_fit_leaves_its_group():
    """A square with wide round corners is smooth and convex, and no ellipse fits it."""
    y, x = np.mgrid[:300, :400]
    image = np.where(((x - 200) / 80.0) ** 4 + ((y - 150) / 80.0) ** 4 < 1, 180, 40).astype(np.uint8)
    assert group_by_aggregation(cv2.GaussianBlur(image, None, 0.7), (60, 110)) == []


def test_a_magnified_window_shows_a_point_where_its_camera_says(photograph):
    (view,) = photograph([], views=[0], noise=0)
    picture = view.image.copy()
    picture[230:233, 340:343] = 250
    T = np.eye(4)
    seen = window(View(picture, view.camera, view.T_world_camera), T, 0.06, [0.0015])
    assert seen.camera.fx > 1.5 * view.camera.fx
    (ray,) = view.camera.rays([[341.0, 231.0]]) @ view.T_world_camera.rotation.as_matrix().T
    y, x = np.nonzero(seen.image > 140)
    assert seen.project(view.T_world_camera.translation + 0.5 * ray)[0] == pytest.approx(
        (x.mean(), y.mean()), abs=0.2
    )


def test_a_sighting_has_the_size_and_the_place_of_a_feature(plate, photograph, pose):
    (view,), T = photograph([], views=[0]), pose(2, -3, 1, about=(4, -5, 20))
    (hole,) = plate.supporting

    def seen(offset_m, factor):
        circle = Circle([offset_m, 0, hole.circle.centre[2]], [0, 0, 1], factor * hole.circle.radius_m).moved(T)
        feature = EllipseFeature(project_circle(circle, view), "region", np.empty((0, 2)), 1.0, 1.0)
        return [s.turn_rad for s in sightings(T.as_matrix(), [[feature]], [view], [hole])]

    assert seen(0.022, 1.0) == pytest.approx([0.0], abs=0.01)
    assert seen(0.022, 2.0) == []
    assert seen(0.015, 1.0) == []


def test_regions_are_pruned_by_every_attribute_that_was_taught(drawn, plate):
    features = [n.feature for n in grow_ellipses(drawn, plate.salient[:1], (500, 5000))]
    (big,) = [f for f in features if 85 < f.ellipse.semi_axes[0] < 95]
    ranges = {name: AttributeRange(value, value) for name, value in vars(big.attributes).items()}
    radius_m = plate.salient[0].circle.radius_m
    scale = big.attributes.perimeter_px / (2 * np.pi * radius_m)

    def kept(**changes):
        circle = replace(plate.salient[0], attributes=tuple((ranges | changes).items()))
        return len(grow_ellipses(drawn, [circle], (scale, scale), PruningParameters(smaller=0.5, larger=2, grey=1.5)))

    assert kept() >= 1
    for name, (factor, least) in {
        "area_px": (5, 0),
        "circularity": (5, 0),
        "shape_complexity": (5, 0),
        "grey_mean": (3, 0),
        "grey_deviation": (3, 20),
    }.items():
        wrong = max(getattr(big.attributes, name) * factor, least)
        assert kept(**{name: AttributeRange(wrong, wrong)}) == 0, name


def test_what_was_not_taught_prunes_nothing(plate):
    assert attribute_constraints(plate.salient[0], (500, 5000), PruningParameters()).area_px is None


@pytest.mark.parametrize(
    ("name", "salient"), [("previous", "region"), ("previous", "group"), ("paper", "region"), ("paper", "group")]
)
def test_plates_are_localised_by_stereo(name, salient, plate, scene, photograph):
    model = strategy(plate, salient, "region" if salient == "group" else "group")
    result = PaperLocalizer([model], name).localize(photograph(scene), WORKSPACE)
    assert len(result.estimates) == 2
    assert {e.extractor for e in result.estimates} == {"region" if name == "previous" else salient}
    for truth in scene:
        off = [np.linalg.norm(e.T_world_part.translation - truth.translation) for e in result.estimates]
        best = result.estimates[int(np.argmin(off))]
        assert min(off) < 1e-3
        assert best.T_world_part.rotation.as_matrix()[:, 2] @ truth.rotation.as_matrix()[:, 2] > np.cos(np.radians(1))
        assert best.inplane_known
        turn = np.degrees((truth.inv() * best.T_world_part).rotation.as_rotvec()[2])
        assert abs(turn - 120 * round(turn / 120)) < 3


def test_what_has_no_supporting_feature_is_no_plate(plate, scene, photograph):
    """The same outline and bore, but holes nearer to the middle than those of the pictures."""
    *salient, hole = plate.features
    nearer = replace(hole, circle=replace(hole.circle, centre=[0.018, 0.0, hole.circle.centre[2]]))
    model = replace(plate, features=(*salient, nearer))
    assert PaperLocalizer([model]).localize(photograph(scene), WORKSPACE).estimates == ()


def test_an_unknown_preset_is_refused(plate):
    with pytest.raises(InputError, match="got 'focal'; expected paper or previous"):
        PaperLocalizer([plate], "focal")


def test_the_update_is_that_of_filterpy():
    points = TRUE.sample(40) + np.random.default_rng(10_001).normal(scale=0.3, size=(40, 2))
    start = initial_estimate(points)
    ours = EllipseFilter(start, prior_px=12.0, noise_px=1.5)
    theirs = ExtendedKalmanFilter(dim_x=5, dim_z=1)
    theirs.x, theirs.P, theirs.R = start[:, None].copy(), np.eye(5) * 144, np.eye(1) * 2.25
    for point in points:
        ours.take_in(point[None])
        theirs.update(
            np.zeros((1, 1)),
            lambda x, z: focal_jacobian(x[:, 0], z[None]),
            lambda x, z: focal_residual(x[:, 0], z[None])[:, None],
            args=(point,),
            hx_args=(point,),
        )
    assert ours.p == pytest.approx(theirs.x[:, 0], rel=1e-9)
    assert ours.covariance == pytest.approx(theirs.P, rel=1e-6, abs=1e-9)
