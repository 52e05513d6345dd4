"""How far the poses of two sweeps lie apart: of the same episodes, played on two machines or by two versions.

Both sweeps saw the same heaps, so a pose is compared by the way that leads to it from the true one
(``benchmark.records.episode_record.PoseOffset``); a heap that itself came to lie a little differently does not count.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmark.records.episode_record import EpisodeRecord, PieceRecord, PoseOffset
from vision.errors import InputError

NEAR_MM = 0.05
"""Two poses agree when they lie nearer to each other than this ..."""

NEAR_DEG = 0.1
"""... and are turned by less than this. Machines differ in the last digits of a pixel or of a sum, which moves a sure
pose by less than a micrometre; a doubtful one, such as that of a piece of which little is seen, by up to tenths."""


@dataclass(frozen=True)
class Spread:
    """Middle and end of what was measured."""

    median: float
    largest: float


@dataclass(frozen=True)
class Comparison:
    """Two answers of one localizer for the pieces of one part.

    Attributes:
        part: name of the pieces' type.
        method: the localizer.
        both: pieces that both sweeps matched and whose poses both records hold.
        first_only: pieces that only the first sweep matched.
        second_only: pieces that only the second sweep matched.
        far: pieces of ``both`` whose poses are farther apart than ``NEAR_MM`` or ``NEAR_DEG``.
        position_mm: distance of the two positions; None for an empty sample.
        rotation_deg: angle between the two rotations; None for an empty sample.
    """

    part: str
    method: str
    both: int
    first_only: int
    second_only: int
    far: int
    position_mm: Spread | None
    rotation_deg: Spread | None

    @property
    def matched(self) -> int:
        """Pieces that at least one of the sweeps matched."""
        return self.both + self.first_only + self.second_only

    @property
    def different(self) -> int:
        """Those of them that the other sweep did not match, or found elsewhere."""
        return self.far + self.first_only + self.second_only


@dataclass(frozen=True)
class Apart:
    """What two sweeps of the same episodes have not in common.

    Attributes:
        episodes: number of episodes that both finished.
        comparisons: one for each part and localizer.
        stamps: by entry of the environment's stamp, its values in either sweep where they differ; empty text where a
            record does not have the entry.
    """

    episodes: int
    comparisons: tuple[Comparison, ...]
    stamps: dict[str, tuple[str, str]]

    @property
    def matched(self) -> int:
        """Poses of all parts and localizers."""
        return sum(c.matched for c in self.comparisons)

    @property
    def different(self) -> int:
        """Those of them that differ."""
        return sum(c.different for c in self.comparisons)


def compare(first: Sequence[EpisodeRecord], second: Sequence[EpisodeRecord]) -> Apart:
    """Compare the episodes that two sweeps have in common.

    Raises:
        InputError: they have none, or a record is from before poses were kept.
    """
    pairs = _common(first, second)
    if not pairs:
        do = "Sweep twice with the same options, apart from --out."
        raise InputError("two sweeps", got="no episode that both finished", expected="the same episodes", do=do)
    pieces = [pair for a, b in pairs for pair in zip(a.pieces, b.pieces, strict=False)]
    groups = dict.fromkeys((a.part, method) for a, b in pieces for method in a.results if method in b.results)
    comparisons = tuple(_compare(part, method, [p for p in pieces if p[0].part == part]) for part, method in groups)
    return Apart(len(pairs), comparisons, _differing_stamps(pairs))


def _common(
    first: Sequence[EpisodeRecord], second: Sequence[EpisodeRecord]
) -> list[tuple[EpisodeRecord, EpisodeRecord]]:
    theirs = {(record.key, record.config_hash): record for record in second if record.error is None}
    mine = ((record, theirs.get((record.key, record.config_hash))) for record in first if record.error is None)
    return [(a, b) for a, b in mine if b is not None]


def _compare(part: str, method: str, pieces: Sequence[tuple[PieceRecord, PieceRecord]]) -> Comparison:
    results = [
        (a.results[method], b.results[method]) for a, b in pieces if method in a.results and method in b.results
    ]
    both = [(a, b) for a, b in results if a.matched and b.matched]
    distances = [_distance(_offset(a.offset), _offset(b.offset)) for a, b in both]
    return Comparison(
        part,
        method,
        both=len(both),
        first_only=sum(a.matched and not b.matched for a, b in results),
        second_only=sum(b.matched and not a.matched for a, b in results),
        far=sum(mm > NEAR_MM or deg > NEAR_DEG for mm, deg in distances),
        position_mm=_spread([mm for mm, _ in distances]),
        rotation_deg=_spread([deg for _, deg in distances]),
    )


def _offset(offset: PoseOffset | None) -> PoseOffset:
    if offset is None:
        do = "Run the sweep again into a new directory."
        raise InputError("record of a matched piece", got="one from before poses were kept", expected="a pose", do=do)
    return offset


def _distance(a: PoseOffset, b: PoseOffset) -> tuple[float, float]:
    """How far two poses lie apart, in mm, and the angle between them, in degrees."""
    turns = Rotation.from_rotvec([a.rotation_deg, b.rotation_deg], degrees=True)
    angle = (turns[0].inv() * turns[1]).magnitude()
    return math.dist(a.translation_mm, b.translation_mm), float(np.degrees(angle))


def _spread(values: Sequence[float]) -> Spread | None:
    return Spread(statistics.median(values), max(values)) if values else None


def _differing_stamps(pairs: Sequence[tuple[EpisodeRecord, EpisodeRecord]]) -> dict[str, tuple[str, str]]:
    def values(index: int, name: str) -> str:
        return " / ".join(sorted({pair[index].environment.get(name, "") for pair in pairs}))

    names: Iterator[str] = (name for pair in pairs for record in pair for name in record.environment)
    stamps = {name: (values(0, name), values(1, name)) for name in dict.fromkeys(names)}
    return {name: (a, b) for name, (a, b) in stamps.items() if a != b}
