"""The fits find what made the data; the scripts run and print."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from scipy.special import expit

from benchmark.detector.drawings import draw
from benchmark.detector.evaluate import Tally
from benchmark.episodes.evaluation import TruePiece
from benchmark.report.reliability import reliability
from benchmark.seeds import PICTURES
from benchmark.tuning import confirmation, edge_sigmas, ellipse_score, pose_probability
from benchmark.tuning.candidates import TERMS, candidates_of
from benchmark.tuning.covariance_sample import NAMES, CovarianceSample, covariance_sample
from benchmark.tuning.edge_sigmas import enlargement, fit_sigmas, inside
from benchmark.tuning.ellipse_score import f_difference, fit_logistic, fit_weights
from benchmark.tuning.pose_probability import PoseSample, fit_probability
from benchmark.tuning.scenes import KnownScene
from vision import Workspace, load_views
from vision.grouping.score import DEFAULT_WEIGHTS
from vision.matching.parameters import CONFIRMATION, MatchingParameters
from vision.pose.edge_errors import USUAL
from vision.pose.probability import ProbabilityWeights

THREE_VIEWS = Path(__file__).resolve().parents[2] / "docs" / "images" / "three_views"


@pytest.fixture(scope="module")
def candidates():
    return [candidates_of(draw("tune", "complete", PICTURES["earlier"].start + k)) for k in range(3)]


def test_logistic_weights_that_made_the_data_are_found_again():
    rng = np.random.default_rng(20_000)
    terms, weights = rng.normal(size=(20_000, 3)), np.array([2.0, 0.5, 1.0])
    is_true = rng.random(20_000) < expit(terms @ weights - 1.0)
    free = np.full(3, np.inf)
    found = fit_logistic(terms, is_true, np.full(20_000, -1.0), free)
    assert np.allclose(found, weights, atol=0.1)
    held = fit_logistic(terms, is_true, np.full(20_000, -1.0), np.array([1.5, np.inf, np.inf]))
    assert held[0] == pytest.approx(1.5)


def test_the_terms_and_the_weights_make_the_score_that_tells_true_ellipses(candidates):
    weights = np.array(DEFAULT_WEIGHTS[: len(TERMS)])
    odds = np.concatenate([c.terms @ weights for c in candidates])
    is_true = np.concatenate([c.is_true for c in candidates])
    assert is_true.any()
    assert not is_true.all()
    assert np.median(odds[is_true]) > 0 > np.median(odds[~is_true])


def test_held_weights_stay_where_they_are_in_the_code(candidates):
    held = fit_weights(candidates, ("error",))
    assert held.error <= DEFAULT_WEIGHTS.error
    assert held.are_valid


def test_a_difference_of_f_is_that_of_the_same_pictures():
    good, bad = Tally(8, 10, 10, 0.1, 1), Tally(4, 10, 10, 0.1, 1)
    assert f_difference([good, bad], [good, bad]) == (0, 0, 0)
    more, low, high = f_difference([good] * 5, [bad] * 5)
    assert (more, low, high) == pytest.approx((0.4, 0.4, 0.4))
    more, low, high = f_difference([good, bad] * 5, [replace(bad, detections=12)] * 10)
    assert low < more < high


@pytest.fixture(scope="module")
def scene():
    """Three pictures of four pieces of cover 2."""
    poses = [np.array(piece["T_world_part"]) for piece in json.loads((THREE_VIEWS / "truth.json").read_text())]
    origins = np.array([pose[:3, 3] for pose in poses])
    room = Workspace(tuple(origins.min(axis=0) - 0.05), tuple(origins.max(axis=0) + 0.05))
    pieces = [TruePiece("cover2", RigidTransform.from_matrix(pose), 1.0, True) for pose in poses]
    return KnownScene("cover2", "lab", tuple(load_views(THREE_VIEWS)), room, tuple(pieces))


def test_the_covariance_of_a_pose_is_made_of_the_shared_errors_and_the_noise(scene):
    errors = covariance_sample([scene])
    assert len(errors) == 4
    usual = errors.covariance(np.array([getattr(USUAL, name) for name in NAMES]))
    expected = sorted(np.trace(e.covariance) for e in scene.localize(MatchingParameters()).estimates)
    assert np.allclose(sorted(np.trace(usual, axis1=1, axis2=2)), expected, rtol=1e-6)
    assert (np.abs(errors.error[:, :3]) < 1e-3).all()


@pytest.fixture(scope="module")
def simulated():
    """Errors that two sigmas, 0.02 and 0.05 px, made; the second works on half of the coordinates."""
    rng, count, sigmas = np.random.default_rng(20_001), 4000, np.array([0.02, 0.05])
    unit = np.stack([np.diag([1.0, 2.0, 1.0, 0.5, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0, 0.0, 2.0, 0.0])])
    noise = np.diag([1e-4] * 5 + [1.0])
    drawn = rng.multivariate_normal(np.zeros(6), noise + np.einsum("k,kij->ij", sigmas**2, unit), count)
    drawn[:, 5] = 0.0  # does not count
    shape = (count, *unit.shape)
    return CovarianceSample(
        np.arange(count) // 4,
        drawn,
        np.broadcast_to(noise, (count, 6, 6)),
        np.broadcast_to(unit, shape),
        np.full(count, 5),
    )


def test_sigmas_that_made_the_errors_are_found_again(simulated):
    found = fit_sigmas(simulated, np.array([0.1, 0.1]))
    assert found == pytest.approx([0.02, 0.05], rel=0.1)
    assert inside(simulated, found, 0.95).mean() == pytest.approx(0.95, abs=0.02)
    assert enlargement(simulated, found) == pytest.approx(1.0, abs=0.05)
    assert enlargement(simulated, found / 2) == pytest.approx(2.0, abs=0.1)


def test_the_slope_is_that_of_the_likelihood(simulated):
    squares, step = np.array([0.03, 0.04]) ** 2, 1e-7
    for k, unit in enumerate(np.eye(2)):
        sides = [simulated.losses(np.sqrt(squares + sign * step * unit)).mean() for sign in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * step)
        assert simulated.slope(np.sqrt(squares))[k] == pytest.approx(expected, rel=1e-4)


def test_a_changed_setting_leaves_the_others_alone():
    assert confirmation.changed("demand", 0.5) == replace(CONFIRMATION, demand=0.5 * CONFIRMATION.demand)
    assert confirmation.changed("most_peaks", 0.01).most_peaks == 1


def test_what_is_found_and_what_is_lost_is_counted(scene):
    usual = confirmation.outcome([scene], CONFIRMATION)
    assert (len(usual.found), len(usual.half), usual.false_poses) == (4, 4, 0)
    nothing = confirmation.outcome([replace(scene, pieces=scene.pieces[:1])], CONFIRMATION)
    assert (len(nothing.found), nothing.false_poses) == (1, 3)


def test_probability_weights_that_made_the_data_are_found_again():
    rng = np.random.default_rng(20_000)
    made_of = ProbabilityWeights(evidence=6.0, turned=2.0, weakest=3.0, constant=4.0)
    evidence, turned, weakest = rng.uniform(0.2, 1, 20_000), rng.random(20_000) < 0.5, rng.random(20_000)
    rows = np.column_stack([evidence, turned, weakest, -np.ones(20_000)])
    is_right = rng.random(20_000) < expit(rows @ np.array(made_of))
    assert np.allclose(fit_probability(PoseSample(rows, is_right)), made_of, atol=0.5)


def test_reliability_sorts_poses_by_what_they_say():
    rows = reliability([0.1, 0.5, 0.7, 0.995, 1.0], [False, False, True, True, True])
    assert [(row.low, row.right.successes, row.right.n) for row in rows if row.right.n] == [
        (0.0, 0, 1),
        (0.5, 1, 2),
        (0.99, 2, 2),
    ]
    assert rows[1].said == pytest.approx(0.6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "words"),
    [
        (ellipse_score, ("| coverage_squared |", "F − F in the code", "validation 500000")),
        (edge_sigmas, ("| swell_px |", "inside the 95% ellipsoid", "validation 40000")),
        (confirmation, ("| rival_px |", "false poses", "tuning 30000")),
        (pose_probability, ("| weakest |", "said on average", "validation 40000")),
    ],
    ids=["ellipse_score", "edge_sigmas", "confirmation", "pose_probability"],
)
def test_a_script_runs_and_prints_its_tables_and_seeds(script, words, capsys):
    script.main(["--quick", "--format", "md"])
    printed = capsys.readouterr().out
    assert [word for word in words if word not in printed] == []
