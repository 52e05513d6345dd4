"""How likely it is that a pose is right: what confirms it, weighed so that of the poses that say 95 %, 95 % are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ProbabilityWeights(NamedTuple):
    """Weights of a logistic model, none negative.

    ``benchmark/tuning/pose_probability.py`` fits them to poses in rendered scenes. A pose is right where it counts as
    matched in the benchmark's tables: no point of the part is farther off than a tenth of its diameter.

    Attributes:
        score: of the edge support, 0 to 1.
        turned: where the turn about the axis is known, or has no meaning.
        shown: of the share that is in sight of the edges that face the views, 0 to 1.
        constant: is subtracted.
    """

    score: float = 9.0
    turned: float = 4.5
    shown: float = 16.0
    constant: float = 12.7


USUAL_WEIGHTS = ProbabilityWeights()
"""Those of this project's localizer."""


def terms(score: ArrayLike, turned: ArrayLike, shown: ArrayLike) -> NDArray[np.float64]:
    """What the weights are multiplied by, (..., 4)."""
    given = (np.asarray(values, dtype=float) for values in (score, turned, shown, -np.ones(np.shape(score))))
    return np.stack(list(given), axis=-1)


def probability(weights: ProbabilityWeights, score: float, turned: bool, shown: float) -> float:
    """The probability that a pose is right; the arguments are those of :class:`ProbabilityWeights`."""
    return float(1 / (1 + np.exp(-terms(score, turned, shown) @ np.array(weights))))
