"""The weights by which the detector scores an ellipse, fitted: ``python -m benchmark.tuning.ellipse_score``.

The score is a logistic model (``vision/grouping/score.py``). Its weights are the most likely ones given which of the
ellipses that the detector walks in the tuning pictures are true. They are fitted twice: with the weights of the two
errors held at those of the code, because real outlines are less perfect than drawn ones, and without. The weight of a
concentric neighbour is fitted last, with the others given. Every set of weights then gets the least score at which F
is largest on the tuning pictures; the figures are those of the validation pictures.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from benchmark.commands.common import print_line
from benchmark.detector.drawings import CATEGORIES, RENDERED, SPLITS, Drawing, draw
from benchmark.detector.evaluate import Tally, drawable, judge
from benchmark.report.grid import NOTHING, Grid
from benchmark.seeds import PICTURES
from benchmark.tuning.candidates import TERMS, Candidates, candidates_of
from benchmark.tuning.options import Report, Size, run, seeds_in_words
from vision import detect_ellipses
from vision.frozen import frozen_arrays
from vision.grouping.edge_grouping import GroupingParameters
from vision.grouping.score import DEFAULT_WEIGHTS, ScoreWeights

Array = NDArray[np.float64]

USES = ("tuning", "validation")
NUMBER = 40  # pictures of each kind, for the fit and for the validation
QUICK_KINDS = ("complete", "concentric", "occluded")
HELD = ("direction", "error")
LEAST_SCORES = (0.25, 0.33, 0.4, 0.45, 0.5)
RESAMPLES = 2000


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Outcome:
    """How well the detector does with some weights on the validation pictures.

    Attributes:
        name: of the weights.
        least_score: the best of ``LEAST_SCORES`` on the tuning pictures.
        loss: mean negative log likelihood of which candidates are true.
        tallies: one for each picture.
    """

    name: str
    least_score: float
    loss: float
    tallies: tuple[Tally, ...]


def pictures(use: str, number: int, kinds: Sequence[str]) -> list[Drawing]:
    """The first pictures of each kind for "tuning" or "validation"."""
    print_line(f"drawing {use} pictures")
    first = PICTURES[use].start - SPLITS["tune"]
    return [draw("tune", kind, first + k) for kind in kinds for k in range(number)]


def fit_logistic(terms: Array, is_true: NDArray[np.bool_], offset: Array, most: Array) -> Array:
    """Most likely weights (K,) of terms (S, K) in the log odds, each between 0 and ``most`` (K,).

    Args:
        terms: what the weights are multiplied by.
        is_true: (S,) what happened.
        offset: (S,) what the log odds are without the terms.
        most: largest weights.
    """

    def loss(weights: Array) -> tuple[float, Array]:
        odds = offset + terms @ weights
        slope = terms.T @ (expit(odds) - is_true) / len(odds)
        return log_loss(odds, is_true), slope

    start = np.minimum(1.0, most)
    limits = [(0.0, high) for high in most]
    options = {"maxiter": 5000, "maxfun": 20_000, "ftol": 1e-13, "gtol": 1e-9}
    return np.asarray(minimize(loss, start, jac=True, method="L-BFGS-B", bounds=limits, options=options).x)


def log_loss(odds: Array, is_true: NDArray[np.bool_]) -> float:
    """Mean negative log likelihood of what is true, by the logarithms of the odds."""
    return float(np.logaddexp(0.0, np.where(is_true, -odds, odds)).mean())


def fit_weights(candidates: Sequence[Candidates], held: Sequence[str] = ()) -> ScoreWeights:
    """The most likely weights; those of the terms ``held`` are at most what they are in the code."""
    terms, is_true = np.vstack([c.terms for c in candidates]), np.concatenate([c.is_true for c in candidates])
    most = np.array([getattr(DEFAULT_WEIGHTS, name) if name in held else np.inf for name in TERMS])
    alone = fit_logistic(terms, is_true, np.zeros(len(terms)), most)
    odds, neighbours = terms @ alone, _neighbours(candidates, alone)
    (concentric,) = fit_logistic(neighbours[:, None], is_true, odds, np.array([np.inf]))
    return ScoreWeights._make(map(float, [*alone, concentric]))


def loss_of(weights: ScoreWeights, candidates: Sequence[Candidates]) -> float:
    """Mean negative log likelihood of the scores in context."""
    terms, is_true = np.vstack([c.terms for c in candidates]), np.concatenate([c.is_true for c in candidates])
    alone = np.array(weights[: len(TERMS)])
    return log_loss(terms @ alone + weights.concentric * _neighbours(candidates, alone), is_true)


def _neighbours(candidates: Sequence[Candidates], alone: Array) -> Array:
    return np.concatenate([c.neighbours(c.terms @ alone) for c in candidates])


def detect(drawing: Drawing, weights: ScoreWeights, least_score: float) -> Tally:
    """Hits of the detector with these weights in one picture."""
    parameters = replace(GroupingParameters(), weights=weights, min_score=least_score)
    start = time.perf_counter()
    found = detect_ellipses(drawing.image, parameters)
    return judge(drawing, found, time.perf_counter() - start)


def evaluate(
    name: str,
    weights: ScoreWeights,
    tuning: Sequence[Drawing],
    validation: Sequence[Drawing],
    candidates: Sequence[Candidates],
) -> Outcome:
    """Choose the least score on the tuning pictures, and detect with it in the validation pictures."""
    of_score = {s: sum((detect(d, weights, s) for d in tuning), Tally()).f_measure for s in LEAST_SCORES}
    best = max(LEAST_SCORES, key=lambda score: of_score[score])
    tallies = tuple(detect(drawing, weights, best) for drawing in validation)
    return Outcome(name, best, loss_of(weights, candidates), tallies)


def f_difference(ours: Sequence[Tally], theirs: Sequence[Tally]) -> tuple[float, float, float]:
    """By how much F differs on the same pictures, with its 95 % interval from resampled pictures."""
    draws = np.random.default_rng(0).multinomial(len(ours), np.full(len(ours), 1 / len(ours)), RESAMPLES)
    sums = [draws @ [(t.true_positives, t.detections + t.truths) for t in tallies] for tallies in (ours, theirs)]
    f_ours, f_theirs = (2 * s[:, 0] / np.maximum(s[:, 1], 1) for s in sums)
    low, high = np.quantile(f_ours - f_theirs, [0.025, 0.975])
    return sum(ours, Tally()).f_measure - sum(theirs, Tally()).f_measure, float(low), float(high)


def measure(size: Size) -> Report:
    """Fit and evaluate on so many pictures of each kind."""
    kinds = QUICK_KINDS if size.quick else drawable(CATEGORIES)
    tuning, validation = (pictures(use, size.number, kinds) for use in USES)
    fitted_on, held_against = ([candidates_of(d) for d in drawings] for drawings in (tuning, validation))
    sets = {
        "in the code": DEFAULT_WEIGHTS,
        "fitted, errors held": fit_weights(fitted_on, HELD),
        "fitted": fit_weights(fitted_on),
    }
    for weights in sets.values():
        detect(tuning[0], weights, LEAST_SCORES[0])  # compile first
    print_line("detecting")
    outcomes = [evaluate(name, weights, tuning, validation, held_against) for name, weights in sets.items()]
    walked = sum(len(c.is_true) for c in fitted_on)
    lines = (
        f"{len(tuning)} pictures for the fit, with {walked} candidates, and {len(validation)} for the validation.",
        seeds_in_words("Pictures of each kind", {use: PICTURES[use][: size.number] for use in USES}),
    )
    return Report((weights_grid(sets), outcome_grid(outcomes, [d.category for d in validation])), lines)


def weights_grid(sets: dict[str, ScoreWeights]) -> Grid:
    """The weights, one column for each set."""
    rows = [(name, *(f"{getattr(w, name):.2f}" for w in sets.values())) for name in ScoreWeights._fields]
    return Grid("Weights of the score of an ellipse", ("Weight", *sets), tuple(rows))


def outcome_grid(outcomes: Sequence[Outcome], kinds: Sequence[str]) -> Grid:
    """The validation, one row for each set of weights; the first is what the others are held against."""
    rows = []
    for outcome in outcomes:
        whole = sum(outcome.tallies, Tally())
        rendered = [t for t, kind in zip(outcome.tallies, kinds, strict=True) if kind == RENDERED]
        drawn = [t for t, kind in zip(outcome.tallies, kinds, strict=True) if kind != RENDERED]
        f = [f"{sum(some, Tally()).f_measure:.3f}" if some else NOTHING for some in (drawn, rendered)]
        more, low, high = f_difference(outcome.tallies, outcomes[0].tallies)
        rows.append(
            (
                outcome.name,
                f"{outcome.least_score:.2f}",
                f"{outcome.loss:.4f}",
                *f,
                f"{whole.f_measure:.3f}",
                NOTHING if outcome is outcomes[0] else f"{more:+.3f} ({low:+.3f} to {high:+.3f})",
                f"{1e3 * whole.seconds / whole.images:.1f}",
            )
        )
    return Grid(
        "The detector on the validation pictures",
        ("Weights", "least score", "log loss", "F, drawn", "F, rendered", "F", "F − F in the code", "ms"),
        tuple(rows),
        note="Least score: the best of the tuning pictures. In brackets: 95 % bootstrap interval over pictures.",
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit, validate and print, from the command line."""
    run("Fit the weights by which the detector scores an ellipse.", NUMBER, measure, arguments)


if __name__ == "__main__":
    main()
