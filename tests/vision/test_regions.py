import pickle
from dataclasses import astuple

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.stats import chi2

from vision.errors import InputError
from vision.geometry.ellipse import Ellipse
from vision.geometry.ellipse_fit import fit_ellipse
from vision.regions.boundary_ellipses import covered
from vision.regions.region_ellipses import (
    AttributeConstraints,
    BoundaryFitParameters,
    RegionGrowingParameters,
    region_ellipses,
    segment,
)

SUPERSAMPLING = 8


def draw(shapes, size=(240, 320), background=60, blur_px=0.7, noise=0.0, seed=0):
    """Ellipses (x, y, a, b, angle, grey) painted one over the other, each pixel the mean of 8 x 8 samples."""
    f = SUPERSAMPLING
    big = np.full((size[0] * f, size[1] * f), background, np.float32)
    for x, y, a, b, angle, grey in shapes:
        # OpenCV paints the pixels on the outline too, half a sample too far.
        outline = Ellipse.from_geometric(x, y, a - 0.5 / f, b - 0.5 / f, angle).sample(720)
        cv2.fillPoly(big, [np.round(((outline + 0.5) * f - 0.5) * 64).astype(np.int32)], float(grey), shift=6)
    image = cv2.resize(big, size[::-1], interpolation=cv2.INTER_AREA)
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    image = image + np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def nearest(features, shape):
    return min(features, key=lambda f: np.abs(f.ellipse.geometric[:4] - shape[:4]).max())


DISC = (150.3, 120.8, 70.0, 70.0, 0.0, 180)
OVAL = (160.4, 118.2, 90.0, 62.0, 0.5, 180)
HOLE = (160.4, 118.2, 50.0, 34.5, 0.5, 60)


def test_areas_of_regions_and_boundaries_add_up_to_the_image():
    segmentation = segment(draw([OVAL, HOLE], noise=2))
    areas = [r.attributes.area_px for r in segmentation.regions]
    assert sum(areas) + np.count_nonzero(segmentation.labels == 0) == 240 * 320
    assert areas == [np.count_nonzero(segmentation.labels == r.label) for r in segmentation.regions]
    assert (segmentation.labels[segmentation.edges] == 0).all()


def test_every_region_is_the_sum_of_its_quadtree_leaves():
    segmentation = segment(draw([OVAL, HOLE], noise=2))
    for region in segmentation.regions:
        painted = np.zeros(segmentation.labels.shape, bool)
        for x, y, size, label in segmentation.leaves[region.leaves]:
            assert label == region.label
            painted[y : y + size, x : x + size] = True
        assert (painted == (segmentation.labels == region.label)).all()
        x, y, width, height = region.box
        assert (cv2.boundingRect(painted.astype(np.uint8)) == np.array([x, y, width, height])).all()


def test_a_ring_on_a_ground_is_three_regions_with_their_grey_levels_and_holes():
    regions = segment(draw([OVAL, HOLE], noise=2)).regions
    assert len(regions) == 3
    by_area = sorted(regions, key=lambda r: -r.attributes.area_px)
    assert [round(r.attributes.grey_mean / 10) for r in by_area] == [6, 18, 6]
    assert [len(r.holes) for r in by_area] == [1, 1, 0]
    assert by_area[1].attributes.grey_deviation < 5


def test_a_disc_is_circular_and_an_ellipse_is_simple():
    disc = max(segment(draw([DISC])).regions, key=lambda r: r.attributes.circularity).attributes
    assert disc.circularity == pytest.approx(1.0, abs=0.03)
    assert disc.shape_complexity == pytest.approx(1.0, abs=0.03)
    assert disc.area_px == pytest.approx(np.pi * 69.5**2, rel=0.02)
    assert disc.perimeter_px == pytest.approx(2 * np.pi * 69.5, rel=0.015)
    oval = min(segment(draw([(160, 120, 90, 40, 0.3, 200)])).regions, key=lambda r: r.attributes.area_px).attributes
    assert oval.circularity < 0.85
    assert oval.shape_complexity == pytest.approx(1.0, abs=0.03)


def test_a_bitten_disc_is_more_complex_than_a_whole_one():
    bitten = segment(draw([DISC, (220, 120, 30, 30, 0, 60)])).regions
    assert max(r.attributes.shape_complexity for r in bitten if r.attributes.grey_mean > 150) > 1.15


def test_pruning_leaves_what_lies_within_all_bounds():
    regions = segment(draw([OVAL, HOLE])).regions
    assert AttributeConstraints().prune(regions) == list(regions)
    bright = AttributeConstraints(grey_mean=(150, 255)).prune(regions)
    assert [r.attributes.grey_mean > 150 for r in bright] == [True]
    none = AttributeConstraints(grey_mean=(150, 255), area_px=(0, 10))
    assert none.prune(regions) == []
    assert none.violations(bright[0].attributes) == {"area_px": "large"}
    assert AttributeConstraints(grey_mean=(254, 255)).violations(bright[0].attributes) == {"grey_mean": "small"}
    assert AttributeConstraints(grey_mean=(150, 255)).violations(bright[0].attributes) == {}
    area = bright[0].attributes.area_px
    assert AttributeConstraints(area_px=(area, area)).prune(regions) == bright


def test_constraints_must_be_ranges():
    for bounds in ((2, 1), (float("nan"), 1), (1, 2, 3)):
        with pytest.raises(InputError, match="area_px"):
            AttributeConstraints(area_px=bounds)


@pytest.mark.parametrize(
    "shape",
    [
        DISC,
        OVAL,
        (150.1, 120.7, 60.0, 25.0, 1.2, 220),
        (150.5, 120.5, 14.3, 12.1, 2.0, 20),
        (99.9, 88, 33, 30, 0, 110),
    ],
)
def test_a_clean_ellipse_is_found_to_a_twentieth_of_a_pixel(shape):
    gray = draw([shape])
    features = region_ellipses(segment(gray))
    assert len(features) == 1
    error = features[0].ellipse.geometric[:4] - shape[:4]
    assert np.abs(error[:2]).max() < 0.05
    assert np.abs(error[2:]).max() < 0.1
    assert features[0].extractor == "region"
    assert features[0].support > 0.95


def test_both_rims_of_a_ring_are_found_even_where_only_the_ring_is_left():
    gray = draw([OVAL, HOLE], noise=2)
    segmentation = segment(gray)
    for constraints in (None, AttributeConstraints(grey_mean=(150, 255))):
        features = region_ellipses(segmentation, constraints)
        assert len(features) == 2
        for shape in (OVAL, HOLE):
            assert np.abs(nearest(features, shape).ellipse.geometric[:4] - shape[:4]).max() < 0.15


def test_a_shared_rim_carries_the_attributes_of_the_region_inside():
    gray = draw([OVAL])
    (feature,) = region_ellipses(segment(gray))
    assert feature.attributes.grey_mean == pytest.approx(180, abs=2)


@pytest.mark.parametrize("occluder_x", [230, 205, 180])
def test_the_outline_of_an_occluder_is_kept_out_of_the_fit(occluder_x):
    gray = draw([DISC, (occluder_x, 90, 45, 45, 0, 110)], noise=1)
    features = region_ellipses(segment(gray))
    disc, occluder = nearest(features, DISC), nearest(features, (occluder_x, 90, 45, 45))
    assert np.abs(disc.ellipse.geometric[:4] - DISC[:4]).max() < 0.25
    assert np.abs(occluder.ellipse.geometric[:4] - (occluder_x, 90, 45, 45)).max() < 0.25
    assert disc.support < 0.95 < occluder.support


@pytest.mark.parametrize("radius", [12.0, 20.0, 70.0])
def test_blur_does_not_shrink_circles(radius):
    gray = draw([(150.2, 120.6, radius, radius, 0, 180)])
    (feature,) = region_ellipses(segment(gray))
    assert np.abs(np.subtract(feature.ellipse.semi_axes, radius)).max() < 0.03


@pytest.mark.parametrize(("noise", "grey"), [(2.0, 110), (2.0, 160), (4.0, 130)])
def test_errors_on_noisy_images_agree_with_the_covariance(noise, grey):
    rng, errors = np.random.default_rng(5), []
    for seed in range(40):
        truth = Ellipse.from_geometric(*(60 + rng.uniform(-0.5, 0.5, 2)), 40, 32, 0.0)
        gray = draw([(*truth.geometric, grey)], size=(120, 120), noise=noise, seed=seed)
        best = region_ellipses(segment(gray))[0].ellipse
        select = np.array([[0.5, 0, 0.5, 0, 0], [0, 0.5, 0, 0.5, 0], [0, 0, 0, 0, 1]])
        d = select @ (best.p - truth.p)
        errors.append(d @ np.linalg.solve(select @ best.covariance @ select.T, d) / 3)
    assert 0.15 < np.mean(errors) < 2.0


def test_boxes_and_streaks_are_not_ellipses():
    gray = np.full((240, 320), 60, np.uint8)
    gray[40:200, 60:260] = 170
    gray[100:110, 80:240] = 90
    assert region_ellipses(segment(gray)) == []


def test_a_quarter_turn_turns_the_ellipses():
    gray = draw([OVAL, HOLE])
    turned = np.rot90(gray).copy()
    expected = [(f.ellipse.centre[1], 319 - f.ellipse.centre[0]) for f in region_ellipses(segment(gray))]
    found = [tuple(f.ellipse.centre) for f in region_ellipses(segment(turned))]
    assert np.allclose(sorted(found), sorted(expected), atol=0.02)


@settings(deadline=None, max_examples=40)
@given(hnp.arrays(np.uint8, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=80)))
def test_any_grey_image_gives_a_segmentation_and_a_list(gray):
    segmentation = segment(gray)
    assert segmentation.labels.shape == gray.shape
    for feature in region_ellipses(segmentation):
        assert np.isfinite(feature.ellipse.p).all()
        assert 0 < feature.support <= 1


@settings(deadline=None, max_examples=10)
@given(st.integers(1, 40), st.integers(1, 3000))
def test_thin_and_long_images_are_no_problem(height, width):
    gray = np.random.default_rng(height).integers(0, 255, (height, width), dtype=np.uint8)
    assert region_ellipses(segment(gray)) is not None


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 4, 2), np.uint8),
        np.full((4, 4), np.nan),
        np.full((4, 4), 256, np.uint16),
        np.zeros(4, np.uint8),
    ],
)
def test_what_is_no_image_is_refused(image):
    with pytest.raises(InputError, match="image: got"):
        segment(image)


@pytest.mark.parametrize("shape", [(0, 5), (5, 0), (0, 0)])
def test_an_empty_image_has_no_regions(shape):
    segmentation = segment(np.zeros(shape, np.uint8))
    assert segmentation.labels.shape == shape
    assert segmentation.regions == ()
    assert region_ellipses(segmentation) == []


def test_ellipses_are_those_of_the_image_and_settings_of_the_segmentation():
    gray = draw([DISC])
    settings_of_mine = RegionGrowingParameters(blur_px=1.5)
    segmentation = segment(gray, settings_of_mine)
    (before,) = region_ellipses(segmentation)
    gray[:] = 0
    (after,) = region_ellipses(segmentation)
    assert (before.ellipse.p == after.ellipse.p).all()
    assert segmentation.parameters == settings_of_mine
    (other,) = region_ellipses(segment(draw([DISC])))
    assert (other.ellipse.p != before.ellipse.p).any()


def test_bad_settings_are_refused():
    with pytest.raises(InputError, match=r"edge_high of RegionGrowingParameters: got 2; expected .* >= 5"):
        RegionGrowingParameters(edge_low=5, edge_high=2)
    with pytest.raises(InputError, match="blur_px"):
        RegionGrowingParameters(blur_px=0)
    with pytest.raises(InputError, match="sigma_px"):
        BoundaryFitParameters(sigma_px=0)


def test_segmentations_survive_pickling_read_only():
    segmentation = segment(draw([DISC]))
    copy = pickle.loads(pickle.dumps(segmentation))
    assert (copy.labels == segmentation.labels).all()
    assert not copy.labels.flags.writeable
    assert not copy.gray.flags.writeable
    assert [f.ellipse.p.tolist() for f in region_ellipses(copy)] == [
        f.ellipse.p.tolist() for f in region_ellipses(segmentation)
    ]
    assert not copy.regions[0].contour.flags.writeable
    assert astuple(copy.regions[0].attributes) == astuple(segmentation.regions[0].attributes)


def test_half_a_circumference_is_half_covered():
    ellipse = Ellipse.from_geometric(50, 50, 40, 25, 0.7)
    assert covered(ellipse.geometric, ellipse.sample(200), 6.0) == 1.0
    assert covered(ellipse.geometric, ellipse.sample(200)[:100], 6.0) == pytest.approx(0.5, abs=0.04)


# The fit.


def noisy(ellipse, n, part, sigma, rng):
    angle = np.linspace(0, 2 * np.pi * part, n, endpoint=False)
    (a, b), turn = ellipse.semi_axes, ellipse.angle
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return (
        np.column_stack([a * np.cos(angle), b * np.sin(angle)]) @ rotation.T
        + ellipse.centre
        + rng.normal(0, sigma, (n, 2))
    )


@pytest.mark.parametrize(("a", "b", "part"), [(100, 80, 1.0), (100, 80, 0.5), (40, 12, 1.0), (100, 99.9, 1.0)])
def test_the_covariance_of_region_ellipses_is_honest(a, b, part):
    truth, rng, trials = Ellipse.from_geometric(300, 200, a, b, 0.4), np.random.default_rng(1), 150
    errors = []
    for _ in range(trials):
        fitted = fit_ellipse(noisy(truth, 200, part, 0.1, rng), 0.1)
        # Centre and s, which do not depend on the order of the focal points.
        select = np.array([[0.5, 0, 0.5, 0, 0], [0, 0.5, 0, 0.5, 0], [0, 0, 0, 0, 1]])
        d = select @ (fitted.p - truth.p)
        errors.append(d @ np.linalg.solve(select @ fitted.covariance @ select.T, d))
    assert chi2.ppf(1e-4, 3 * trials) < np.sum(errors) < chi2.ppf(1 - 1e-4, 3 * trials)


def test_the_covariance_grows_with_the_scatter_and_with_missing_arc():
    truth, rng = Ellipse.from_geometric(0, 0, 60, 40, 1.0), np.random.default_rng(2)

    def spread(part, sigma):
        return np.trace(fit_ellipse(noisy(truth, 100, part, sigma, rng), 0.05).covariance)

    assert spread(1.0, 0.05) < spread(1.0, 0.5)
    assert 10 * spread(1.0, 0.05) < spread(0.4, 0.05)


def test_one_point_in_ten_far_off_hardly_moves_the_fit():
    truth, rng = Ellipse.from_geometric(10, -20, 60, 40, 1.0), np.random.default_rng(3)
    points = noisy(truth, 200, 1.0, 0.1, rng)
    points[::10] += rng.uniform(-6, 6, (20, 2))
    assert np.abs(fit_ellipse(points, 0.1).geometric - truth.geometric).max() < 0.1


@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 2)), np.ones((50, 2)), np.column_stack([np.arange(50.0), np.arange(50.0)]), np.eye(5)[:, :2]],
)
def test_points_that_determine_no_ellipse_give_none(points):
    assert fit_ellipse(points) is None


def test_points_that_are_no_points_are_refused():
    for points in (np.full((9, 2), np.nan), np.zeros((9, 3)), np.zeros(4)):
        with pytest.raises(InputError, match="edge points"):
            fit_ellipse(points)
    with pytest.raises(InputError, match="sigma_px"):
        fit_ellipse(np.random.default_rng(0).random((9, 2)), sigma_px=0)


def test_pruning_before_tracing_leaves_the_same_regions():
    segmentation = segment(draw([OVAL, HOLE, (40, 40, 20, 20, 0, 120)], noise=2))
    for constraints in (
        AttributeConstraints(area_px=(1000, 20000)),
        AttributeConstraints(grey_mean=(100, 255), circularity=(0.8, 1.2)),
        AttributeConstraints(grey_deviation=(0, 0)),
    ):
        kept = segmentation.prune(constraints)
        assert [r.label for r in kept] == [r.label for r in constraints.prune(segmentation.regions)]
