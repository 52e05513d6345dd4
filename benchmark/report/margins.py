"""The difference of two localizers' matching rates on the same pieces, with a 95 % interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.episodes.metrics import wilson_interval
from benchmark.records.episode_record import EpisodeRecord

Pair = tuple[bool, bool]


@dataclass(frozen=True)
class Margin:
    """Paired difference of two matching rates over the pieces that both localizers were judged on.

    Attributes:
        part: name of the pieces' type.
        method: the localizer that the difference is in favour of.
        rival: the one it is compared with.
        min_visibility: pieces less visible are left out.
        n: number of pieces.
        scenes: number of scenes that they lie in.
        method_only: pieces that only ``method`` matched.
        rival_only: pieces that only ``rival`` matched.
        margin: rate of ``method`` minus rate of ``rival``; None for an empty sample.
        low: of the 95 % interval, None without two scenes.
        high: of the 95 % interval, None without two scenes.
    """

    part: str
    method: str
    rival: str
    min_visibility: float
    n: int
    scenes: int
    method_only: int
    rival_only: int
    margin: float | None
    low: float | None
    high: float | None

    @property
    def excludes_zero(self) -> bool | None:
        """Whether the interval leaves out zero; None where there is no interval."""
        return None if self.low is None or self.high is None else self.low > 0 or self.high < 0


def paired_margin(
    records: Sequence[EpisodeRecord], part: str, methods: tuple[str, str], min_visibility: float
) -> Margin:
    """The margin of ``methods[0]`` over ``methods[1]``.

    The interval is Newcombe's for paired proportions, with the pieces counted for as many as they are worth: those
    of one scene share its heap and light, which the design effect makes up for (``design_effect``).

    Args:
        records: episodes that did not fail.
        part: name of the pieces' type.
        methods: names of the two localizers.
        min_visibility: pieces less visible are left out, and so are those that bounced out of the bin.
    """
    scenes = [scene for record in records if (scene := _pairs(record, part, methods, min_visibility))]
    pairs = [pair for scene in scenes for pair in scene]
    cells = tuple(pairs.count(cell) for cell in ((True, True), (True, False), (False, True), (False, False)))
    n, (_, first, second, _) = len(pairs), cells
    margin = (first - second) / n if n else None
    interval: tuple[float | None, float | None] = (None, None)
    if len(scenes) > 1:
        effect = design_effect([[a - b for a, b in scene] for scene in scenes])
        interval = newcombe_interval(*(cell / effect for cell in cells))
    return Margin(part, *methods, min_visibility, n, len(scenes), first, second, margin, *interval)


def newcombe_interval(both: float, first: float, second: float, neither: float) -> tuple[float, float]:
    """95 % interval of the difference of two paired proportions.

    R. G. Newcombe, Improved confidence intervals for the difference between binomial proportions based on paired
    data, Statistics in Medicine 17 (1998), method 10: Wilson's intervals of the two rates, joined with regard to
    their correlation. It holds for few disagreements, and for none.

    Args:
        both: how often both succeeded; the four counts need not be whole.
        first: how often the first alone did.
        second: how often the second alone did.
        neither: how often none did.
    """
    n = both + first + second + neither
    rates = ((both + first) / n, (both + second) / n)
    (low1, high1), (low2, high2) = (wilson_interval(rate * n, n) for rate in rates)
    down1, up1, down2, up2 = rates[0] - low1, high1 - rates[0], rates[1] - low2, high2 - rates[1]
    correlation = _corrected_correlation(both, first, second, neither)
    below = math.sqrt(max(down1**2 - 2 * correlation * down1 * up2 + up2**2, 0.0))
    above = math.sqrt(max(up1**2 - 2 * correlation * up1 * down2 + down2**2, 0.0))
    difference = (first - second) / n
    return max(difference - below, -1.0), min(difference + above, 1.0)


def design_effect(scenes: Sequence[Sequence[float]]) -> float:
    """How many clustered values are worth as much as one independent value; at least 1.

    J. N. K. Rao and A. J. Scott, A simple method for the analysis of clustered binary data, Biometrics 48 (1992):
    the variance of the mean with whole scenes as the sampling units, over that of as many independent values.

    Args:
        scenes: the values of each of two or more scenes, none empty.
    """
    n = sum(map(len, scenes))
    mean = math.fsum(value for scene in scenes for value in scene) / n
    independent = math.fsum((value - mean) ** 2 for scene in scenes for value in scene)
    clustered = math.fsum((sum(scene) - len(scene) * mean) ** 2 for scene in scenes)
    clustered *= len(scenes) / (len(scenes) - 1)
    return max(clustered / independent, 1.0) if independent > 0 else 1.0


def _corrected_correlation(both: float, first: float, second: float, neither: float) -> float:
    """Newcombe's phi coefficient with his continuity correction."""
    product = (both + first) * (second + neither) * (both + second) * (first + neither)
    if product <= 0:
        return 0.0
    excess = both * neither - first * second
    if excess > 0:
        excess = max(excess - (both + first + second + neither) / 2, 0.0)
    return excess / math.sqrt(product)


def _pairs(record: EpisodeRecord, part: str, methods: tuple[str, str], min_visibility: float) -> list[Pair]:
    """For each piece of a scene that counts, whether each of the two localizers matched it."""
    counted = [p for p in record.pieces if p.part == part and p.in_bin and p.visibility >= min_visibility]
    results = [[piece.results.get(method) for method in methods] for piece in counted]
    return [(a.matched, b.matched) for a, b in results if a is not None and b is not None]
