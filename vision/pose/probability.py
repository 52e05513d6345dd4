"""How likely it is that a pose is right: what confirms it, weighed so that of the poses that say 95 %, 95 % are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.pose.estimate import PoseEstimate


class ProbabilityWeights(NamedTuple):
    """Weights of a logistic model, none negative.

    ``benchmark/tuning/pose_probability.py`` fits them to poses in rendered scenes. A pose is right where it counts as
    matched in the benchmark's tables: no point of the part is farther off than a tenth of its diameter.

    Attributes:
        evidence: of the edge support times the square root of the share in sight: support of many edges says more.
        turned: where the turn about the axis is known, or has no meaning.
        weakest: of the least edge support of a salient circle in sight: a wrong pose has some that no edge confirms.
        constant: is subtracted.
    """

    evidence: float = 13.0
    turned: float = 3.0
    weakest: float = 6.2
    constant: float = 8.3

    @property
    def are_valid(self) -> bool:
        """Whether all are finite numbers and none is negative."""
        return all(isinstance(weight, float) and 0 <= weight < np.inf for weight in self)


USUAL_WEIGHTS = ProbabilityWeights()
"""Those of this project's localizer."""


def probability_terms(estimate: PoseEstimate, *, turn_matters: bool = True) -> NDArray[np.float64]:
    """What the weights are multiplied by, (4,).

    Args:
        estimate: a pose that knows how much of the part is in sight.
        turn_matters: False for a part that looks the same at any angle.
    """
    salient = [c for f in estimate.features if f.role == "salient" for c in f.copies if c is not None]
    evidence = estimate.score * np.sqrt(estimate.shown or 0.0)
    turned = estimate.inplane_known or not turn_matters
    return np.array([evidence, float(turned), min(salient, default=0.0), -1.0])


def pose_probability(
    estimate: PoseEstimate, weights: ProbabilityWeights = USUAL_WEIGHTS, *, turn_matters: bool = True
) -> float:
    """The probability that a pose is right; the arguments are those of :func:`probability_terms`."""
    return float(1 / (1 + np.exp(-probability_terms(estimate, turn_matters=turn_matters) @ np.array(weights))))
