"""The sizes of the edges' shared errors, fitted: ``python -m benchmark.tuning.edge_sigmas``.

These errors (``vision/pose/edge_errors.py``) widen the covariance of a pose. Their standard deviations are those of
the greatest likelihood, given the errors of the focal localizer's poses in the tuning scenes and taking them for
Gaussian. Then all are made larger by one factor, so that 95 % of the tuning scenes' true poses lie inside the 95 %
ellipsoid. The figures are those of the validation scenes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import chdtri

from benchmark.episodes.metrics import ELLIPSOID_SHARE
from benchmark.report.grid import NOTHING, Grid, rate_text
from benchmark.report.rate import Rate
from benchmark.seeds import SCENES
from benchmark.tuning.covariance_sample import NAMES, CovarianceSample, covariance_sample
from benchmark.tuning.options import Report, Size, run, seeds_in_words
from benchmark.tuning.scenes import known_scenes
from vision.pose.edge_errors import USUAL

Array = NDArray[np.float64]

NUMBER = 20  # scenes of each part, for the fit and for the validation
GROSS = 100.0  # squared error, by the sigmas in the code, from which another hole was taken for the right one
UNIT_PX = 0.03  # of the search, about the size of what is looked for
FACTORS = np.arange(0.5, 4.0, 0.01)
RESAMPLES, REFITS = 2000, 100


def fit_sigmas(errors: CovarianceSample, start: Array) -> Array:
    """Standard deviations (K,) in pixels of the greatest likelihood, looked for from others on."""

    def loss(squares: Array) -> tuple[float, Array]:
        sigmas = UNIT_PX * np.sqrt(squares)
        return float(errors.losses(sigmas).mean()), UNIT_PX**2 * errors.slope(sigmas)

    # In the squares, the slope does not vanish where a sigma is zero.
    found = minimize(loss, (start / UNIT_PX) ** 2, jac=True, method="L-BFGS-B", bounds=[(0.0, None)] * len(start))
    return np.asarray(UNIT_PX * np.sqrt(found.x))


def enlargement(errors: CovarianceSample, sigmas: Array) -> float:
    """The smallest factor on all sigmas with which the ellipsoids hold the share that they claim."""
    wide = (f for f in FACTORS if inside(errors, f * sigmas, ELLIPSOID_SHARE).mean() >= ELLIPSOID_SHARE)
    return float(next(wide, FACTORS[-1]))


def inside(errors: CovarianceSample, sigmas: Array, share: float) -> NDArray[np.bool_]:
    """(N,) whether the true pose lies in the ellipsoid that is to hold this share of them."""
    return np.asarray(errors.squared(sigmas) < chdtri(errors.components, 1 - share))


def intervals(errors: CovarianceSample, sigmas: Array) -> tuple[Array, Array]:
    """95 % intervals (K,) of fitted sigmas, from fits to resampled scenes."""
    rng = np.random.default_rng(0)
    fits = [fit_sigmas(errors.take(_resampled(errors, rng)), sigmas) for _ in range(REFITS)]
    low, high = np.quantile(fits, [0.025, 0.975], axis=0)
    return low, high


def _resampled(errors: CovarianceSample, rng: np.random.Generator) -> NDArray[np.intp]:
    """Numbers of the poses of as many scenes, drawn with replacement."""
    scenes = np.unique(errors.scene)
    return np.concatenate([np.flatnonzero(errors.scene == s) for s in rng.choice(scenes, len(scenes))])


def gain(errors: CovarianceSample, sigmas: Array, others: Array) -> tuple[float, float, float]:
    """Log likelihood per pose beyond that of other sigmas, with its 95 % interval from resampled scenes."""
    rng, gained = np.random.default_rng(0), errors.losses(others) - errors.losses(sigmas)
    low, high = np.quantile([gained[_resampled(errors, rng)].mean() for _ in range(RESAMPLES)], [0.025, 0.975])
    return float(gained.mean()), float(low), float(high)


def measure(size: Size) -> Report:
    """Fit and evaluate on so many scenes of each part."""
    code = np.array([getattr(USUAL, name) for name in NAMES])
    found = {use: covariance_sample(known_scenes(use, size)) for use in ("tuning", "validation")}
    kept = {use: errors.take(errors.squared(code) < GROSS) for use, errors in found.items()}
    tuning, validation = kept["tuning"], kept["validation"]
    fitted = fit_sigmas(tuning, code)
    factor = enlargement(tuning, fitted)
    sets = {"in the code": code, "fitted": fitted, f"fitted, times {factor:.2f}": factor * fitted}
    lines = [
        f"{len(errors)} poses for the {use}, {len(found[use]) - len(errors)} left out as gross."
        for use, errors in kept.items()
    ]
    lines.append(f"Those in the code would hold 95 % of the tuning poses times {enlargement(tuning, code):.2f}.")
    lines.append(seeds_in_words("Scenes", {use: SCENES[use][: size.number] for use in kept}))
    return Report((sigma_grid(sets, *intervals(tuning, fitted)), outcome_grid(sets, validation)), tuple(lines))


def sigma_grid(sets: dict[str, Array], low: Array, high: Array) -> Grid:
    """The sigmas, one column for each set; the interval is that of the second."""
    rows = [
        (name, *(f"{sigmas[k]:.4f}" for sigmas in sets.values()), f"{low[k]:.4f} to {high[k]:.4f}")
        for k, name in enumerate(NAMES)
    ]
    return Grid(
        "Standard deviations of the errors that edges share",
        ("Error", *sets, "interval"),
        tuple(rows),
        note="Interval: 95 % of the fitted ones, by bootstrap over scenes.",
    )


def outcome_grid(sets: dict[str, Array], errors: CovarianceSample) -> Grid:
    """The validation, one row for each set of sigmas; the first is what the others are held against."""
    first, *_ = sets.values()
    rows = []
    for name, sigmas in sets.items():
        more, low, high = gain(errors, sigmas, first)
        shares = [_rate(inside(errors, sigmas, share)) for share in (0.5, ELLIPSOID_SHARE)]
        gained = NOTHING if sigmas is first else f"{more:+.3f} ({low:+.3f} to {high:+.3f})"
        rows.append((name, *map(rate_text, shares), gained))
    return Grid(
        "The covariance on the validation scenes",
        ("Sigmas", "inside the 50% ellipsoid", "inside the 95% ellipsoid", "log likelihood − that of the code"),
        tuple(rows),
        note="In brackets: 95 % intervals, Wilson's for shares, else by bootstrap over scenes. Likelihood per pose.",
    )


def _rate(held: NDArray[np.bool_]) -> Rate:
    return Rate.of(held.tolist())


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit, validate and print, from the command line."""
    run("Fit the sizes of the errors that many edges share.", NUMBER, measure, arguments)


if __name__ == "__main__":
    main()
