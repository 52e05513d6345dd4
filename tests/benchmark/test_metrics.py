from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import binomtest, chi2, kstest

from benchmark.episodes.metrics import (
    assign,
    hull_points,
    is_extracted,
    is_inside_ellipsoid,
    match_limit_mm,
    mssd_mm,
    normalized_error,
    pose_errors,
    pose_offset,
    summarise,
    wilson_interval,
)


@dataclass(frozen=True)
class Fold:
    fold: int | None


NONE, FIVE, CONTINUOUS = Fold(1), Fold(5), Fold(None)
seeds = st.integers(0, 2**32 - 1)


def pose(seed: int) -> RigidTransform:
    rng = np.random.default_rng(seed)
    return RigidTransform.from_components(rng.normal(size=3), Rotation.random(random_state=rng))


def offset(translation: list[float], rotvec_deg: list[float]) -> RigidTransform:
    return RigidTransform.from_components(translation, Rotation.from_rotvec(rotvec_deg, degrees=True))


def disc(n: int = 120, radius: float = 0.05) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    ring = np.column_stack([radius * np.cos(t), radius * np.sin(t), np.zeros(n)])
    up = np.array([0, 0, 0.01])
    return np.vstack([ring + up, ring - up, 0.3 * ring])


@given(seed=seeds)
@settings(deadline=None, max_examples=30)
def test_mssd_is_attained_on_the_convex_hull(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(300, 3))
    hull = hull_points(points)
    assert len(hull) < len(points)
    estimate, truth = pose(seed), pose(seed + 1)
    for symmetry in (NONE, FIVE):
        assert mssd_mm(estimate, truth, symmetry, hull) == pytest.approx(
            mssd_mm(estimate, truth, symmetry, points), rel=1e-12
        )


def test_a_hull_with_many_points_is_thinned_almost_without_loss() -> None:
    points = np.random.default_rng(0).normal(size=(6000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = hull_points(points)
    assert 500 < len(hull) <= 2000
    whole, thinned = (mssd_mm(pose(1), pose(2), NONE, p) for p in (points, hull))
    assert whole * 0.999 < thinned <= whole


def test_flat_parts_have_hull_points_too() -> None:
    assert len(hull_points(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]))) == 3


@given(seed=seeds)
@settings(deadline=None, max_examples=20)
def test_pure_translation(seed: int) -> None:
    truth = pose(seed)
    errors = pose_errors(truth * offset([0.003, 0, 0.004], [0, 0, 0]), truth, FIVE, disc())
    assert errors.translation_mm == pytest.approx(5)
    assert errors.mssd_mm == pytest.approx(5)
    assert max(errors.tilt_deg, errors.rotation_deg, errors.inplane_deg) < 1e-5


@pytest.mark.parametrize("turn", [0.0, 3.0, -3.0, 33.0, 36.5, 71.0, 72.0, 144.0, -75.0, 180.0])
def test_turns_about_the_axis_count_modulo_the_symmetry(turn: float) -> None:
    truth = pose(3)
    estimate = truth * offset([0, 0, 0], [0, 0, turn])
    expected = abs(math.remainder(turn, 72))
    errors = pose_errors(estimate, truth, FIVE, disc())
    assert errors.inplane_deg == pytest.approx(expected, abs=1e-5)
    assert errors.rotation_deg == pytest.approx(expected, abs=1e-5)
    assert errors.tilt_deg < 1e-5
    continuous = pose_errors(estimate, truth, CONTINUOUS, disc())
    assert continuous.inplane_deg is None
    assert max(continuous.rotation_deg, continuous.mssd_mm) < 1e-5


@given(seed=seeds, tilt=st.floats(0, 179), azimuth=st.floats(0, 360), turn=st.floats(-180, 180))
@settings(deadline=None, max_examples=40)
def test_tilt_is_the_angle_of_the_axes_whatever_the_turn(seed: int, tilt: float, azimuth: float, turn: float) -> None:
    truth = pose(seed)
    direction = np.array([math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth)), 0])
    estimate = truth * offset([0, 0, 0], list(tilt * direction)) * offset([0, 0, 0], [0, 0, turn])
    errors = pose_errors(estimate, truth, NONE, disc())
    assert errors.tilt_deg == pytest.approx(tilt, abs=1e-5)
    assert errors.inplane_deg == pytest.approx(abs(turn), abs=1e-4)
    assert errors.rotation_deg >= tilt - 1e-5
    assert pose_errors(estimate, truth, CONTINUOUS, disc()).rotation_deg == pytest.approx(tilt, abs=1e-5)


def test_mssd_of_a_tilted_disc_is_that_of_its_rim() -> None:
    tilt = 4.0
    points = disc()
    expected = 2 * math.sin(math.radians(tilt / 2)) * math.hypot(0.05, 0.01) * 1000
    estimate = pose(5) * offset([0, 0, 0], [tilt, 0, 0])
    assert mssd_mm(estimate, pose(5), CONTINUOUS, points) == pytest.approx(expected)


@given(seed=seeds)
@settings(deadline=None, max_examples=20)
def test_errors_do_not_depend_on_the_world_frame(seed: int) -> None:
    estimate, truth, world = pose(seed), pose(seed + 1), pose(seed + 2)
    here = pose_errors(estimate, truth, FIVE, disc())
    there = pose_errors(world * estimate, world * truth, FIVE, disc())
    assert vars(here) == pytest.approx(vars(there), abs=1e-4)


@given(seed=seeds, turn=st.sampled_from([-144.0, -72.0, 0.0, 72.0]))
@settings(deadline=None, max_examples=20)
def test_the_offset_leads_from_the_nearest_true_pose_to_the_estimate(seed: int, turn: float) -> None:
    truth, error = pose(seed), offset([0.001, -0.002, 0.003], [1.0, -2.0, 3.0])
    estimate = truth * error * offset([0, 0, 0], [0, 0, turn])
    found = pose_offset(estimate, truth, FIVE)
    assert found.translation_mm == pytest.approx((1, -2, 3))
    assert found.rotation_deg == pytest.approx((1, -2, 3), abs=1e-6)


@pytest.mark.parametrize(("symmetry", "known"), [(CONTINUOUS, True), (FIVE, False)])
def test_the_offset_has_no_turn_where_none_is_known(symmetry: Fold, known: bool) -> None:
    estimate = pose(7) * offset([0, 0, 0], [3.0, 0, 0]) * offset([0, 0, 0], [0, 0, 40.0])
    found = pose_offset(estimate, pose(7), symmetry, inplane_known=known)
    assert found.rotation_deg == pytest.approx((3, 0, 0), abs=1e-5)


def test_a_flipped_part_is_not_matched() -> None:
    errors = pose_errors(pose(1) * offset([0, 0, 0], [180, 0, 0]), pose(1), FIVE, disc())
    assert errors.tilt_deg == pytest.approx(180)
    assert errors.mssd_mm > match_limit_mm(0.1) == pytest.approx(10)


def test_extraction_needs_one_circle_in_two_views_above_the_overlap() -> None:
    assert is_extracted([[0.1, 0.0, 0.2], [0.81, 0.1, 0.9]])
    assert not is_extracted([[0.8, 0.9, 0.8]])
    assert not is_extracted([[0.9, 0.1, 0.1], [0.1, 0.9, 0.9 - 0.1]])
    assert not is_extracted([])


def test_assignment_prefers_more_pairs_to_cheaper_pairs() -> None:
    costs = {("a", 0): 0.1, ("a", 1): 0.9, ("b", 0): 0.95, ("b", 1): 5.0}
    found = assign(["a", "b"], [0, 1], lambda e, t: costs[e, t], lambda _: 1.0)
    assert found.pairs == ((1, 0), (0, 1))
    assert found.false_positives == ()


def test_what_is_over_the_limit_or_left_over_is_a_false_positive() -> None:
    estimates = [0.0, 0.2, 10.0, 55.0]
    found = assign(estimates, [0.1, 10.1, 30.0], lambda e, t: abs(e - t) if e < 50 else math.inf, lambda _: 1.0)
    assert [j for _, j in found.pairs] == [0, 1]
    assert found.pairs[1] == (2, 1)
    assert len(found.false_positives) == 2
    assert 3 in found.false_positives


@pytest.mark.parametrize(("estimates", "truths"), [([], [1.0]), ([1.0], []), ([], [])])
def test_nothing_to_assign(estimates: list[float], truths: list[float]) -> None:
    found = assign(estimates, truths, lambda *_: 0.0, lambda _: 1.0)
    assert found.pairs == ()
    assert len(found.false_positives) == len(estimates)


@given(n=st.integers(1, 300), share=st.floats(0, 1), confidence=st.sampled_from([0.9, 0.95, 0.99]))
@settings(deadline=None)
def test_wilson_interval_is_scipys(n: int, share: float, confidence: float) -> None:
    successes = round(share * n)
    expected = binomtest(successes, n).proportion_ci(confidence, method="wilson")
    assert wilson_interval(successes, n, confidence) == pytest.approx((expected.low, expected.high), abs=1e-12)
    low, high = wilson_interval(successes, n, confidence)
    assert 0 <= low <= successes / n <= high <= 1


def test_an_empty_sample_tells_nothing() -> None:
    assert wilson_interval(0, 0) == (0, 1)
    assert summarise([]).mean is None


def test_summary() -> None:
    summary = summarise([1.0, 2.0, 6.0])
    assert (summary.n, summary.mean, summary.median) == (3, 3.0, 2.0)
    assert summary.std == pytest.approx(np.std([1, 2, 6], ddof=1))
    assert summarise([4.0]).std is None


@given(values=st.lists(st.floats(0, 1e6), min_size=2, max_size=40), seed=seeds)
@settings(deadline=None)
def test_summary_does_not_depend_on_the_order(values: list[float], seed: int) -> None:
    shuffled = [float(v) for v in np.random.default_rng(seed).permutation(values)]
    assert summarise(values) == summarise(shuffled)


# A covariance as poses have it: metres and radians, correlated, the axes of the ellipsoid askew.
_AXES = Rotation.random(random_state=np.random.default_rng(5)).as_matrix()
_ROOT = np.block([[2e-4 * _AXES, np.zeros((3, 3))], [0.004 * np.eye(3), _AXES @ np.diag([0.002, 0.01, 0.005])]])
COVARIANCE = _ROOT @ _ROOT.T


def drawn(symmetry: Fold, claimed: np.ndarray = COVARIANCE, inplane_known: bool = True, unknown_turn: bool = False):
    """Normalized errors of estimates that are drawn around true poses and claim a covariance."""
    rng = np.random.default_rng(8)
    out = []
    for i in range(2000):
        truth, error = pose(i), _ROOT @ rng.normal(size=6)
        turned = Rotation.from_rotvec(error[3:]) * truth.rotation
        if unknown_turn:
            turned = turned * Rotation.from_euler("z", rng.uniform(-np.pi, np.pi))
        elif symmetry.fold is not None:
            turned = turned * Rotation.from_euler("z", 2 * np.pi * rng.integers(symmetry.fold) / symmetry.fold)
        estimate = RigidTransform.from_components(truth.translation + error[:3], turned)
        out.append(normalized_error(estimate, claimed, truth, symmetry, inplane_known=inplane_known))
    return out


@pytest.mark.parametrize(
    ("symmetry", "inplane_known", "unknown_turn", "components"),
    [
        (NONE, True, False, 6),
        (FIVE, True, False, 6),
        (FIVE, False, True, 5),
        (CONTINUOUS, True, True, 5),
    ],
)
def test_errors_drawn_from_the_claimed_covariance_are_chi_square(symmetry, inplane_known, unknown_turn, components):
    errors = drawn(symmetry, inplane_known=inplane_known, unknown_turn=unknown_turn)
    assert {e.components for e in errors} == {components}
    squared = [e.squared for e in errors]
    assert kstest(squared, chi2(components).cdf).pvalue > 0.01
    assert 0.94 < np.mean([is_inside_ellipsoid(e) for e in errors]) < 0.96


@pytest.mark.parametrize("claimed", [0.5, 0.8, 1.5])
def test_a_wrong_covariance_is_found_out(claimed: float) -> None:
    """Standard deviations that are wrong by such a factor leave the range of 90 to 99 %, as far as they must."""
    errors = drawn(NONE, COVARIANCE * claimed**2)
    inside = np.mean([is_inside_ellipsoid(e) for e in errors])
    assert not 0.9 <= inside <= 0.99
    assert inside == pytest.approx(chi2(6).cdf(chi2(6).ppf(0.95) * claimed**2), abs=0.03)


def test_the_normalized_error_is_in_the_frame_of_the_covariance() -> None:
    """Translation first, then the rotation, about the axes of the world and not about those of the part."""
    truth = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_euler("y", 90, degrees=True))
    about_x = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_euler("x", 0.01) * truth.rotation)
    along_z = RigidTransform.from_components([1.0, 2.0, 3.002], truth.rotation)
    covariance = np.diag([1.0, 1.0, 0.001, 0.005, 1.0, 1.0]) ** 2
    assert normalized_error(about_x, covariance, truth, NONE).squared == pytest.approx(4)
    assert normalized_error(along_z, covariance, truth, NONE).squared == pytest.approx(4)
    # Turned by that angle about its own axis, which is the world's x: nothing to see where that is not known.
    assert normalized_error(about_x, covariance, truth, CONTINUOUS).squared == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    "covariance",
    [
        np.zeros((6, 6)),
        -np.eye(6),
        np.full((6, 6), np.nan),
        np.eye(3),
        np.eye(6) + 2 * (np.eye(6, k=3) + np.eye(6, k=-3)),
        np.eye(6) + np.eye(6, k=1) / 10,
    ],
)
def test_what_is_no_covariance_judges_nothing(covariance: np.ndarray) -> None:
    truth = pose(1)
    error = normalized_error(truth, covariance, truth, NONE)
    assert error is None
