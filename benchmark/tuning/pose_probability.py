"""How likely a pose is right by what confirms it, fitted: ``python -m benchmark.tuning.pose_probability``.

The weights of ``vision/pose/probability.py`` are the most likely ones, given which of the focal localizer's
poses in the tuning scenes are right, half of the scenes with the sensor of the laboratory and half with that of the
shop floor, and heaps as large as the paper's largest. The reliability is that of the validation scenes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from benchmark.episodes.evaluation import assign_estimates
from benchmark.report.grid import Grid
from benchmark.report.reliability import reliability, reliability_grid
from benchmark.seeds import SCENES
from benchmark.tuning.ellipse_score import fit_logistic, log_loss
from benchmark.tuning.options import Report, Size, run, seeds_in_words
from benchmark.tuning.scenes import KnownScene, known_scenes
from vision.frozen import frozen_arrays
from vision.matching.parameters import MatchingParameters
from vision.pose.probability import USUAL_WEIGHTS, ProbabilityWeights, probability_terms

Array = NDArray[np.float64]

NUMBER = 10  # scenes of each part and sensor, for the fit and for the validation
SENSORS = ("lab", "shopfloor")
PIECES = 6


@dataclass(frozen=True, eq=False)
@frozen_arrays
class PoseSample:
    """N poses: their terms (N, 4), as of ``probability_terms``, and which of them are right (N,)."""

    terms: Array
    is_right: NDArray[np.bool_]


def pose_sample(scenes: Sequence[KnownScene]) -> PoseSample:
    """What the localizer finds in all scenes. The parts have a turn about their axis, known or not."""
    rows, is_right = [np.empty((0, 4))], []
    for scene in scenes:
        estimates = scene.localize(MatchingParameters(least_probability=0.0)).estimates
        right = {i for i, _ in assign_estimates(estimates, scene.pieces).pairs}
        for i, estimate in enumerate(estimates):
            rows.append(probability_terms(estimate)[None])
            is_right.append(i in right)
    return PoseSample(np.vstack(rows), np.array(is_right, dtype=bool))


def fit_probability(sample: PoseSample) -> ProbabilityWeights:
    """The most likely weights, none negative."""
    free = np.full(sample.terms.shape[1], np.inf)
    found = fit_logistic(sample.terms, sample.is_right, np.zeros(len(sample.is_right)), free)
    return ProbabilityWeights._make(found.tolist())


def measure(size: Size) -> Report:
    """Fit to so many scenes of each part and sensor, and validate on as many others."""
    uses = ("tuning", "validation")
    tuning, validation = (pose_sample(known_scenes(use, size, SENSORS, PIECES)) for use in uses)
    sets = {"in the code": USUAL_WEIGHTS, "fitted": fit_probability(tuning)}
    grids = [weights_grid(sets, validation)]
    for name, weights in sets.items():
        chances = expit(validation.terms @ np.array(weights))
        grids.append(reliability_grid({name: reliability(chances.tolist(), validation.is_right.tolist())}))
    lines = (
        f"{_counted(tuning)} for the fit, {_counted(validation)} for the validation.",
        seeds_in_words(f"Scenes, {' and '.join(SENSORS)}", {use: SCENES[use][: size.number] for use in uses}),
    )
    return Report(tuple(grids), lines)


def weights_grid(sets: dict[str, ProbabilityWeights], validation: PoseSample) -> Grid:
    """The weights, one column for each set, and the mean loss on the validation scenes."""
    rows = [(name, *(f"{getattr(w, name):.2f}" for w in sets.values())) for name in ProbabilityWeights._fields]
    losses = (log_loss(validation.terms @ np.array(w), validation.is_right) for w in sets.values())
    rows.append(("loss", *(f"{loss:.3f}" for loss in losses)))
    note = "Loss: mean negative log likelihood on the validation scenes."
    return Grid("Weights of the probability that a pose is right", ("Weight", *sets), tuple(rows), note=note)


def _counted(sample: PoseSample) -> str:
    return f"{len(sample.is_right)} poses, {np.count_nonzero(~sample.is_right)} of them wrong,"


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit and print, from the command line."""
    run("Fit the probability that a pose is right.", NUMBER, measure, arguments)


if __name__ == "__main__":
    main()
