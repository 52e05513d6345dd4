"""The fits find what made the data; the scripts run and print."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit

from benchmark.detector.drawings import draw
from benchmark.detector.evaluate import Tally
from benchmark.seeds import PICTURES
from benchmark.tuning import ellipse_score
from benchmark.tuning.candidates import TERMS, candidates_of
from benchmark.tuning.ellipse_score import f_difference, fit_logistic, fit_weights
from vision.grouping.score import DEFAULT_WEIGHTS


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("script", "words"), [(ellipse_score, ("coverage_squared", "F − F in the code"))], ids=["ellipse_score"]
)
def test_a_script_runs_and_prints_its_tables_and_seeds(script, words, capsys):
    script.main(["--quick", "--format", "md"])
    printed = capsys.readouterr().out
    assert all(word in printed for word in (*words, "| in the code |", "benchmark/seeds.py"))
