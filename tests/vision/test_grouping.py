import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmark.detector.drawings import draw, fill_ellipse
from benchmark.detector.evaluate import Tally, judge, match
from benchmark.detector.photographs import PHOTOGRAPHIC
from vision import GroupingParameters, detect_edges, detect_ellipses, find_ellipses, group_edges, group_ellipses
from vision.errors import InputError
from vision.geometry.ellipse import Ellipse, overlap
from vision.grouping.detector import halved
from vision.regions.region_ellipses import region_ellipses
from vision.regions.segmentation import segment


def photograph(*painted, size=(480, 640), ground=90.0, noise=2.0, seed=0):
    """Ellipses painted one over the other, PSF 0.7 px, noise."""
    canvas = np.full(size, ground)
    for ellipse, grey in painted:
        fill_ellipse(canvas, ellipse, grey)
    rng = np.random.default_rng(seed)
    noisy = cv2.GaussianBlur(canvas, (0, 0), 0.7) + rng.normal(0, noise, size)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8)


def by_region_growing(image):
    return region_ellipses(segment(image))[:1]


@pytest.mark.parametrize("axes", [(100, 60), (80, 80), (40, 35), (200, 150), (20, 20)])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_noisy_ellipse_is_measured_to_hundredths_of_a_pixel(axes, seed):
    truth = Ellipse.from_geometric(320.3, 239.6, *axes, 0.6)
    (found,) = detect_ellipses(photograph((truth, 170.0), seed=seed))
    assert np.abs(found[:2] - truth.centre).max() < 0.05
    assert np.abs(found[2:4] - axes).max() < 0.1


@pytest.mark.parametrize("gap", [4, 6])
def test_the_two_edges_of_a_chamfer_stay_two_ellipses(gap):
    outer = Ellipse.from_geometric(320.3, 240.2, 100, 90, 0.3)
    inner = Ellipse.from_geometric(320.3, 240.2, 100 - gap, 90 - gap, 0.3)
    image = photograph((outer, 150.0), (inner, 200.0))
    found = detect_ellipses(image, GroupingParameters.for_model())
    assert len(found) == 2
    for truth in (outer, inner):
        assert min(np.abs(row[2:4] - truth.semi_axes).max() for row in found) < 0.3


@pytest.mark.parametrize(("gap", "number"), [(4, 1), (30, 2)])
def test_in_photographs_the_edges_of_a_thin_rim_are_one_and_concentric_rings_are_two(gap, number):
    outer = Ellipse.from_geometric(320.3, 240.2, 100, 90, 0.3)
    inner = Ellipse.from_geometric(320.3, 240.2, 100 - gap, 90 - gap, 0.3)
    assert len(detect_ellipses(photograph((outer, 150.0), (inner, 200.0)))) == number


@pytest.mark.parametrize("gap", [4, 10])
def test_near_rims_are_kept_apart_on_demand(gap):
    outer = Ellipse.from_geometric(320.3, 240.2, 150, 140, 0.3)
    inner = Ellipse.from_geometric(320.3, 240.2, 150 - gap, 140 - gap, 0.3)
    found = detect_ellipses(photograph((outer, 170.0), (inner, 90.0)), GroupingParameters(max_apart_px=3))
    assert len(found) == 2
    for truth in (outer, inner):
        assert min(np.abs(row[2:4] - truth.semi_axes).max() for row in found) < 0.3


@pytest.mark.parametrize("category", PHOTOGRAPHIC)
def test_photographic_drawings_ask_for_what_can_be_seen(category):
    drawing = draw("tune", category, 1)
    height, width = drawing.image.shape
    assert drawing.ellipses
    for ellipse in drawing.ellipses:
        outline = ellipse.sample(64)
        inside = ((outline >= -2) & (outline <= (width + 1, height + 1))).all(axis=1)
        assert inside.mean() > 0.45


def test_a_thin_ellipse_is_found():
    truth = Ellipse.from_geometric(320, 240, 120, 24, 0.5)
    (found,) = detect_ellipses(photograph((truth, 160.0)))
    assert overlap(Ellipse.from_geometric(*found), truth) > 0.97


def test_an_ellipse_cut_by_the_border_is_found():
    truth = Ellipse.from_geometric(320, 460, 90, 70, 0.2)
    (found,) = detect_ellipses(photograph((truth, 160.0)))
    assert overlap(Ellipse.from_geometric(*found), truth) > 0.9


def test_a_faint_ellipse_is_found_beside_strong_clutter():
    truth = Ellipse.from_geometric(450, 240, 70, 50, 0.4)
    image = photograph((truth, 99.0), noise=1.0)
    cv2.rectangle(image, (20, 40), (280, 440), 250, -1)
    for row in range(60, 430, 12):
        cv2.line(image, (30, row), (270, row), 10, 3)
    found = [Ellipse.from_geometric(*row) for row in detect_ellipses(image)]
    assert any(overlap(ellipse, truth) > 0.95 for ellipse in found)


def test_an_outline_out_of_focus_is_found():
    truth = Ellipse.from_geometric(320, 240, 90, 70, 0.2)
    image = cv2.GaussianBlur(photograph((truth, 140.0), noise=0.0), (0, 0), 6.0)
    noisy = np.clip(image + np.random.default_rng(0).normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    (found,) = detect_ellipses(noisy)
    assert overlap(Ellipse.from_geometric(*found), truth) > 0.93


def test_an_occluded_ellipse_is_put_together_from_its_fragments():
    truth = Ellipse.from_geometric(300, 240, 120, 90, 0.2)
    image = photograph((truth, 180.0))
    cv2.rectangle(image, (280, 0), (330, 479), 40, -1)
    grouping = group_edges(image)
    best = max(grouping.features, key=lambda f: overlap(f.ellipse, truth))
    assert overlap(best.ellipse, truth) > 0.97
    members = grouping.groups[grouping.features.index(best)]
    assert len(members) >= 2
    assert best.extractor == "group"
    assert 0.5 < best.support < 0.95
    assert 0 <= best.score <= 1


@pytest.mark.parametrize("axes", [(60, 42), (25, 18), (90, 30), (12, 9), (80, 79)])
@pytest.mark.parametrize("extract", [group_ellipses, by_region_growing])
def test_the_covariance_of_grouped_ellipses_is_honest(extract, axes):
    errors = []
    for seed in range(30):
        truth = Ellipse.from_geometric(160.3 + seed / 31, 120.1 + seed / 47, *axes, 0.4 + seed / 20)
        (feature,) = extract(photograph((truth, 160.0), size=(240, 320), seed=seed))
        error = feature.ellipse.p - truth.p
        if np.hypot(*error[:2]) > np.hypot(*(feature.ellipse.p[:2] - truth.p[2:4])):  # focal points have no order
            error = feature.ellipse.p - truth.p[[2, 3, 0, 1, 4]]
        errors.append(error @ np.linalg.solve(feature.ellipse.covariance, error))
    # The mean of 30 from chi-square with 5 degrees of freedom has the deviation 0.6.
    assert 3.0 < np.mean(errors) < 7.0


def test_the_size_limits_of_the_vision_model_are_kept():
    big, small = Ellipse.from_geometric(200, 240, 90, 80, 0.0), Ellipse.from_geometric(500, 240, 30, 25, 0.0)
    image = photograph((big, 170.0), (small, 170.0))
    assert len(detect_ellipses(image)) == 2
    (only,) = detect_ellipses(image, GroupingParameters(size_px=(50, 120)))
    assert only[2] == pytest.approx(90, abs=0.2)


def test_very_many_ellipses_are_all_found():
    centres = [(x, y) for x in range(20, 630, 28) for y in range(20, 470, 28)]  # 374 of them
    discs = [Ellipse.from_geometric(x, y, 11, 10, 0.3) for x, y in centres]
    found = detect_ellipses(photograph(*((disc, 180.0) for disc in discs)))
    assert len(match([Ellipse.from_geometric(*row) for row in found], discs)) == len(discs)


def test_find_ellipses_tells_score_and_covariance_of_what_detect_ellipses_returns():
    truth = Ellipse.from_geometric(320, 240, 90, 70, 0.2)
    soft = cv2.GaussianBlur(photograph((truth, 140.0), noise=0.0), (0, 0), 6.0)  # found at half the resolution
    noisy = np.clip(soft + np.random.default_rng(0).normal(0, 3, soft.shape), 0, 255).astype(np.uint8)
    for image in (noisy, photograph((truth, 140.0))):
        (feature,) = find_ellipses(image)
        assert np.array_equal([feature.ellipse.geometric], detect_ellipses(image))
        assert GroupingParameters().min_score <= feature.score <= 1
        assert np.abs(feature.ellipse.distance(feature.points)).mean() < 0.5
        assert np.sqrt(feature.ellipse.covariance[4, 4]) < 1


def test_edges_can_be_handed_in():
    image = photograph((Ellipse.from_geometric(200, 240, 90, 80, 0.0), 170.0))
    features = group_ellipses(image, edges=detect_edges(image))
    assert np.array_equal([f.ellipse.geometric for f in features], detect_ellipses(image))
    with pytest.raises(InputError, match="edge map"):
        group_ellipses(image[:100], edges=detect_edges(image))


def test_straight_clutter_and_noise_have_no_ellipses():
    image = np.full((300, 400), 80, np.uint8)
    for k in range(10):
        cv2.line(image, (20 * k, 5), (390 - 25 * k, 290), 30 + 20 * k, 3, cv2.LINE_AA)
    assert len(detect_ellipses(image)) == 0
    noise = np.random.default_rng(0).integers(0, 256, (300, 400)).astype(np.uint8)
    assert len(detect_ellipses(noise)) == 0


@pytest.mark.parametrize("shape", [(0, 0), (0, 7), (1, 1), (2, 2), (1, 500), (3, 3), (64, 64)])
def test_empty_tiny_and_constant_images_give_an_empty_result(shape):
    found = detect_ellipses(np.full(shape, 99, np.uint8))
    assert found.shape == (0, 5)
    assert found.dtype == np.float64


def test_a_large_image_is_no_trouble():
    truth = Ellipse.from_geometric(1500, 1000, 900, 700, 0.3)
    (found,) = detect_ellipses(photograph((truth, 170.0), size=(2000, 3000), noise=1.0))
    assert overlap(Ellipse.from_geometric(*found), truth) > 0.99


@pytest.mark.parametrize("axes", [(120, 90), (60, 15), (30, 20), (10, 8)])
def test_a_complete_outline_is_supported_all_around(axes):
    image = photograph((Ellipse.from_geometric(320.3, 239.6, *axes, 0.6), 170.0))
    (feature,) = group_ellipses(image)
    assert feature.support > 0.9


def test_an_image_is_halved_until_it_fits() -> None:
    image = np.zeros((50, 100), np.uint8)
    smaller, factor = halved(image, 30)
    assert (smaller.shape, factor) == ((13, 25), 4)
    assert halved(image, 100)[1] == 1


def test_an_image_above_the_limit_is_halved_and_measured_in_its_own_pixels():
    truth = Ellipse.from_geometric(900.3, 300.7, 120, 80, 0.4)
    (found,) = detect_ellipses(photograph((truth, 170.0), size=(600, 1700)))
    assert np.abs(found - truth.geometric).max() < 0.15


@pytest.mark.parametrize(
    "convert",
    [
        lambda g: g.astype(float),
        lambda g: np.dstack([g, g, g]),
        lambda g: np.asfortranarray(g),
        lambda g: np.repeat(g, 2, axis=1)[:, ::2],
        lambda g: g.astype(np.int32),
    ],
)
def test_grey_levels_may_come_in_other_forms(convert):
    image = photograph((Ellipse.from_geometric(150, 120, 70, 50, 0.3), 170.0), size=(240, 320))
    assert np.allclose(detect_ellipses(convert(image)), detect_ellipses(image))


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 6), st.integers(60, 160), st.integers(60, 160), st.integers(0, 2**31), st.booleans())
def test_noise_of_any_scale_and_contrast_gives_finite_ellipses(scale, height, width, seed, binary):
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(height, width)), (0, 0), scale)
    image = np.where(noise > 0, 255, 0) if binary else np.clip(128 + 60 * noise / noise.std(), 0, 255)
    found = detect_ellipses(image.astype(np.uint8))
    assert np.isfinite(found).all()
    assert (found[:, 2] >= found[:, 3]).all()
    assert (found[:, 3] > 0).all()


@settings(max_examples=40, deadline=None)
@given(arrays(np.uint8, st.tuples(st.integers(0, 40), st.integers(0, 40))))
def test_any_grey_image_gives_finite_ellipses(image):
    found = detect_ellipses(image)
    assert found.shape[1] == 5
    assert np.isfinite(found).all()
    assert (found[:, 2] >= found[:, 3]).all()
    assert (found[:, 3] > 0).all()


@settings(max_examples=20, deadline=None)
@given(arrays(np.float64, st.tuples(st.integers(1, 9), st.integers(1, 9))))
def test_any_float_image_gives_a_value_or_an_input_error(image):
    if np.isfinite(image).all() and image.min() >= 0 and image.max() <= 255:
        assert detect_ellipses(image).shape[1] == 5
    else:
        with pytest.raises(InputError, match="expected"):
            detect_ellipses(image)


@pytest.mark.parametrize("size_px", [(0, 5), (9, 3)])
def test_parameters_are_checked(size_px):
    with pytest.raises(InputError, match="size_px"):
        GroupingParameters(size_px=size_px)


def test_drawings_are_reproducible_and_their_splits_differ():
    assert np.array_equal(draw("tune", "occluded", 3).image, draw("tune", "occluded", 3).image)
    assert draw("tune", "occluded", 3).image.shape != draw("test", "occluded", 3).image.shape
    with pytest.raises(InputError, match="split"):
        draw("train", "occluded", 0)


def test_matching_is_one_to_one():
    truth = Ellipse.from_geometric(50, 50, 30, 20, 0.0)
    near = Ellipse.from_geometric(50.5, 50, 30, 20, 0.0)
    assert match([near, truth], [truth]) == [(1, 0)]
    assert match([], [truth]) == []


@pytest.mark.slow
def test_drawn_clutter_is_mastered():
    tally = Tally()
    for k in range(6):
        for category in ("complete", "concentric", "occluded"):
            drawing = draw("test", category, k)
            tally += judge(drawing, detect_ellipses(drawing.image), 0.0)
    assert tally.precision > 0.85
    assert tally.recall > 0.75
