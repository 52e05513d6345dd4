"""The curves of a study: what becomes of matching and accuracy as one quantity is varied."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType

from benchmark.config import SweepConfig, Variant, episodes
from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE, Summary
from benchmark.records.episode_record import EpisodeRecord
from benchmark.report.circle_errors import CircleErrors
from benchmark.report.published import ROW_OF, TABLE_1, PublishedErrors
from benchmark.report.rate import Rate
from benchmark.report.tables import EXTRACTORS, METHODS, Table, build_table


@dataclass(frozen=True)
class CurvePoint:
    """What one part's pieces came to in one variant.

    Attributes:
        variant: the setting.
        half_visible: matching success over pieces at least half visible.
        visible: the same over pieces at least 10 % visible.
        false_poses: share of the reported poses that belong to no piece.
        errors: of the matched pieces at least 10 % visible, as in Table 1, by quantity.
    """

    variant: Variant
    half_visible: Rate
    visible: Rate
    false_poses: Rate
    errors: dict[str, Summary]


@dataclass(frozen=True)
class Crossing:
    """Up to which value of the varied quantity a curve stays at or below a limit.

    Attributes:
        at: by linear interpolation between the points; None where even the first point is above the limit.
        is_beyond: the curve is nowhere above the limit, and ``at`` is merely the last value that was tried.
    """

    at: float | None
    is_beyond: bool = False


@dataclass(frozen=True)
class CalibrationLimit:
    """Which hand-eye error still meets a part's errors in the paper's Table 1.

    Attributes:
        part: its name.
        method: ``focal-region`` and ``focal-group`` are held to their extractor's row, all others to the better one.
        published: the row.
        translation: hand-eye error in mm up to which the mean translation error meets it.
        rotation: the same for the rotation error.
        both: the less of the two.
        matched: share of the pieces at least 10 % visible that is matched there, interpolated; None where nothing
            meets the row.
    """

    part: str
    method: str
    published: PublishedErrors
    translation: Crossing
    rotation: Crossing
    both: Crossing
    matched: float | None


@dataclass(frozen=True, eq=False)
class Study:
    """The results of a sweep with variants.

    Attributes:
        config: of the sweep.
        tables: what is reported of each variant alone.
        refused: why a part could not be taught, by ``VARIANT/PART``.
        circles: how true the taught circles are, by variant and part.
    """

    config: SweepConfig
    tables: Mapping[Variant, Table]
    refused: Mapping[str, str]
    circles: Mapping[tuple[Variant, str], CircleErrors]

    @property
    def is_calibration(self) -> bool:
        """Whether the hand-eye error is what is varied."""
        return all(variant.hand_eye_mm is not None and not variant.is_taught for variant in self.tables)

    @property
    def parts(self) -> tuple[str, ...]:
        """Part names in the order of the tables."""
        return next(iter(self.tables.values())).parts

    @property
    def method(self) -> str:
        """The localizer whose curves are shown: the one that the sweep ran."""
        found = dict.fromkeys(method for table in self.tables.values() for method in table.methods)
        own = [method for method in found if method not in METHODS]
        return self.config.localizer if self.config.localizer in found or not own else own[0]

    def curve(self, part: str, method: str) -> list[CurvePoint]:
        """One part's points in the order of the variants."""
        return [
            CurvePoint(
                variant,
                table.find_success(part, method, "matching", HALF_VISIBLE).rate,
                table.find_success(part, method, "matching", BARELY_VISIBLE).rate,
                table.find_false_poses(part, method),
                table.find_accuracy(part, method, BARELY_VISIBLE).errors,
            )
            for variant, table in self.tables.items()
        ]

    @property
    def calibration_limits(self) -> list[CalibrationLimit]:
        """For each part of the paper, the run's own localizer and each extractor; empty for another study."""
        if not self.is_calibration:
            return []
        methods = dict.fromkeys([self.method, *(EXTRACTORS if self.method == "focal" else ())])
        return [
            _calibration_limit(part, method, published, self.curve(part, method))
            for part in self.parts
            for method in methods
            if (published := _published(part, method)) is not None
        ]


def build_study(
    config: SweepConfig,
    records: Sequence[EpisodeRecord],
    refused: Mapping[str, str] = MappingProxyType({}),
    circles: Mapping[tuple[Variant, str], CircleErrors] = MappingProxyType({}),
) -> Study:
    """The study of a sweep with variants.

    Args:
        config: of the sweep.
        records: its records so far, in any order.
        refused: why parts could not be taught, and
        circles: how true the others are: of ``benchmark.report.circle_errors.read_taught``.
    """
    variant_of = {episode.key: episode.variant for episode in episodes(config)}
    grouped: dict[Variant | None, list[EpisodeRecord]] = defaultdict(list)
    for record in records:
        grouped[variant_of.get(record.key)].append(record)
    tables = {v: build_table(replace(config, variants=(v,)), grouped[v], (HALF_VISIBLE,)) for v in config.variants}
    return Study(config, tables, refused, circles)


def study_to_dict(study: Study) -> dict[str, object]:
    """The study as plain values for JSON."""
    methods = dict.fromkeys(method for table in study.tables.values() for method in table.shown)
    return {
        "curves": [
            {"part": part, "method": method, **asdict(point)}
            for part in study.parts
            for method in methods
            for point in study.curve(part, method)
        ],
        "calibration_limits": [asdict(limit) for limit in study.calibration_limits],
        "taught_circles": [
            {"part": part, "variant": asdict(variant), **asdict(errors)}
            for (variant, part), errors in study.circles.items()
        ],
        "refused": dict(study.refused),
        "episodes": {
            "planned": sum(table.planned for table in study.tables.values()),
            "recorded": sum(table.recorded for table in study.tables.values()),
            "failed": {key: error for table in study.tables.values() for key, error in table.failed.items()},
        },
        "config_hash": study.config.config_hash,
    }


def last_within(x: Sequence[float], y: Sequence[float | None], limit: float) -> Crossing:
    """Where a curve first rises above a limit.

    Args:
        x: increasing values of the varied quantity.
        y: the curve; it ends before the first None, where nothing was matched.
        limit: what it must not exceed.
    """
    if not y or y[0] is None or y[0] > limit:
        return Crossing(None)
    for i in range(1, len(y)):
        before, after = y[i - 1], y[i]
        if before is None or after is None:
            return Crossing(x[i - 1])
        if after > limit:
            return Crossing(x[i - 1] + (x[i] - x[i - 1]) * (limit - before) / (after - before))
    return Crossing(x[-1], is_beyond=True)


def _published(part: str, method: str) -> PublishedErrors | None:
    """The row of Table 1 that a method is held to."""
    if method in EXTRACTORS:
        return TABLE_1.get((part, ROW_OF[method]))
    rows = [row for (name, _), row in TABLE_1.items() if name == part]
    return min(rows, key=lambda row: row.translation_mm_mean, default=None)


def _calibration_limit(
    part: str, method: str, published: PublishedErrors, curve: Sequence[CurvePoint]
) -> CalibrationLimit:
    ordered = sorted(curve, key=lambda point: point.variant.hand_eye_mm or 0.0)
    x = [point.variant.hand_eye_mm or 0.0 for point in ordered]
    translation = last_within(
        x, [point.errors["translation_mm"].mean for point in ordered], published.translation_mm_mean
    )
    rotation = last_within(x, [point.errors["rotation_deg"].mean for point in ordered], published.rotation_deg_mean)
    both = min(translation, rotation, key=lambda crossing: -1.0 if crossing.at is None else crossing.at)
    rates = [point.visible.rate for point in ordered]
    matched = None if both.at is None else _interpolated(x, rates, both.at)
    return CalibrationLimit(part, method, published, translation, rotation, both, matched)


def _interpolated(x: Sequence[float], y: Sequence[float | None], at: float) -> float | None:
    """The curve's value at a place among its points."""
    for i, value in enumerate(x):
        if value >= at:
            before, after = y[max(i - 1, 0)], y[i]
            if i == 0 or value == at or before is None or after is None:
                return after
            return before + (after - before) * (at - x[i - 1]) / (value - x[i - 1])
    return None
