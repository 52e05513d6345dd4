"""Table 1 and Fig. 10 from the records of a sweep, beside the published figures.

Everything here is a pure function of the configuration and the records (sorted by key, without timings), so that two
runs of one sweep give the same table to the last digit.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from benchmark.config import SweepConfig
from benchmark.episodes.metrics import BARELY_VISIBLE, HALF_VISIBLE, Summary, is_inside_ellipsoid, summarise
from benchmark.records.episode_record import EpisodeRecord, PieceRecord, PoseErrors
from benchmark.report.margins import Margin, paired_margin
from benchmark.report.published import FIGURE_10, ROW_OF, TABLE_1, PublishedErrors, paper_order
from benchmark.report.rate import Rate
from benchmark.report.recovered import Recovered, recovered
from benchmark.report.reliability import ReliabilityRow, reliability
from benchmark.report.task_rows import TaskRow, task_rows

EXTRACTORS = ("focal-region", "focal-group")
OF_THE_PAPER = ("previous", "paper")
METHODS = (*OF_THE_PAPER, *EXTRACTORS, "focal")
COMPARED = ("focal", "focal-region")
STAGES = ("extraction", "matching")
QUANTITIES = ("translation_mm", "rotation_deg", "tilt_deg", "inplane_deg", "mssd_mm")
LEVELS = (HALF_VISIBLE, BARELY_VISIBLE)


@dataclass(frozen=True)
class AccuracyRow:
    """Pose errors of one part's matched pieces.

    Attributes:
        part: its name.
        method: the localizer.
        min_visibility: pieces less visible are left out.
        errors: one summary for each of ``QUANTITIES``; its n is less where a quantity is undefined for the part.
        coverage: the share of true poses inside the 95 % ellipsoids of the poses' covariances; its n is less where
            a covariance is not known, as in records of older versions.
        published: the paper's row, where it has one.
    """

    part: str
    method: str
    min_visibility: float
    errors: dict[str, Summary]
    coverage: Rate
    published: PublishedErrors | None

    @property
    def n(self) -> int:
        """Number of matched pieces."""
        return self.errors["translation_mm"].n


@dataclass(frozen=True)
class SuccessRow:
    """A bar of Fig. 10.

    Attributes:
        part: its name.
        method: the localizer; ``previous`` is the paper's previous method, ``paper`` the one it proposes.
        stage: ``extraction`` (Fig. 10a) or ``matching`` (Fig. 10b).
        min_visibility: pieces less visible are left out.
        rate: over the pieces that are visible enough and in the bin.
        published: the paper's rate, over all its pieces, where it prints one.
    """

    part: str
    method: str
    stage: str
    min_visibility: float
    rate: Rate
    published: float | None


@dataclass(frozen=True)
class FalsePosesRow:
    """How many of the poses that a localizer reported belong to no piece.

    Attributes:
        part: the scenes' only part.
        method: the localizer.
        share: of all poses reported, whatever the visibility of the pieces.
    """

    part: str
    method: str
    share: Rate


@dataclass(frozen=True)
class PartCount:
    """Where one part's pieces went before any rate was taken.

    Attributes:
        part: its name.
        pieces: all pieces that were dropped.
        out_of_bin: those that bounced out of the bin; in no rate.
        barely_visible: those in the bin less than 10 % visible; in no rate.
        false_positives: by localizer, poses that belong to no piece, in scenes of this part alone.
        lost_at: pieces by the stage at which the run's localizer lost them.
    """

    part: str
    pieces: int
    out_of_bin: int
    barely_visible: int
    false_positives: dict[str, int]
    lost_at: dict[str, int]


@dataclass(frozen=True)
class Table:
    """All that is reported about a sweep.

    Attributes:
        config_hash: of the sweep.
        planned: number of episodes of the sweep.
        recorded: how many are recorded.
        failed: key and error of those that did not finish; their pieces are in no rate.
        accuracy: for each part, method and visibility level.
        success: for each part, method, stage and visibility level.
        false_poses: for each part and method.
        reliability: how right poses are that say so, by method, for those that do.
        margins: of focal over region growing alone in matching, for each part and visibility level.
        recovered: what focal matched of what one extractor lost, for each part and visibility level.
        picks: success rate of attempted picks by part.
        counts: by part.
        tasks: for each part and goal of the robot's attempts.
    """

    config_hash: str
    planned: int
    recorded: int
    failed: dict[str, str]
    accuracy: tuple[AccuracyRow, ...]
    success: tuple[SuccessRow, ...]
    false_poses: tuple[FalsePosesRow, ...]
    reliability: dict[str, tuple[ReliabilityRow, ...]]
    margins: tuple[Margin, ...]
    recovered: tuple[Recovered, ...]
    picks: dict[str, Rate]
    counts: tuple[PartCount, ...]
    tasks: tuple[TaskRow, ...] = ()

    @property
    def parts(self) -> tuple[str, ...]:
        """Part names in the order of the table."""
        return tuple(count.part for count in self.counts)

    @property
    def methods(self) -> tuple[str, ...]:
        """Localizers in the order of the table."""
        return tuple(dict.fromkeys(row.method for row in self.success))

    @property
    def shown(self) -> tuple[str, ...]:
        """The localizers that have results; ours where none has."""
        ran = tuple(m for m in self.methods if any(row.method == m and row.rate.n for row in self.success))
        return ran or METHODS[-1:]

    @property
    def table1(self) -> list[AccuracyRow]:
        """The predecessor, the paper's system and ours for each part, over all pieces at least 10 % visible."""
        methods = (*OF_THE_PAPER, "focal")
        return [self.find_accuracy(part, method, BARELY_VISIBLE) for part in self.parts for method in methods]

    def find_accuracy(self, part: str, method: str, min_visibility: float) -> AccuracyRow:
        """One row of ``accuracy``; KeyError where there is none."""
        wanted = (part, method, min_visibility)
        return {(r.part, r.method, r.min_visibility): r for r in self.accuracy}[wanted]

    def find_success(self, part: str, method: str, stage: str, min_visibility: float) -> SuccessRow:
        """One row of ``success``; KeyError where there is none."""
        wanted = (part, method, stage, min_visibility)
        return {(r.part, r.method, r.stage, r.min_visibility): r for r in self.success}[wanted]

    def find_false_poses(self, part: str, method: str) -> Rate:
        """The share of one row of ``false_poses``; KeyError where there is none."""
        return {(row.part, row.method): row.share for row in self.false_poses}[part, method]


def build_table(config: SweepConfig, records: Sequence[EpisodeRecord], levels: Sequence[float] = LEVELS) -> Table:
    """Everything that is reported about a sweep.

    Args:
        config: of the sweep.
        records: its records so far, in any order.
        levels: the least visibilities over which success rates are taken; 10 % is always among them.
    """
    records = sorted(records, key=lambda record: record.key)
    finished = [record for record in records if record.error is None]
    pieces = [piece for record in finished for piece in record.pieces]
    parts = paper_order(config.part_names)
    levels = tuple(dict.fromkeys([*levels, BARELY_VISIBLE]))
    found = dict.fromkeys(name for piece in pieces for name in sorted(piece.results))
    methods = tuple(dict.fromkeys([*METHODS, *config.compared, *found]))
    cells = [(part, method, level) for level in levels for part in parts for method in methods]
    return Table(
        config_hash=config.config_hash,
        planned=config.planned,
        recorded=len(records),
        failed={record.key: record.error for record in records if record.error is not None},
        accuracy=tuple(_accuracy(pieces, *cell) for cell in cells),
        success=tuple(_success(pieces, *cell, stage) for stage in STAGES for cell in cells),
        false_poses=tuple(FalsePosesRow(p, m, _false_poses(finished, p, m)) for p in parts for m in methods),
        reliability=_reliabilities(finished, methods),
        margins=tuple(paired_margin(finished, part, COMPARED, level) for level in levels for part in parts),
        recovered=tuple(recovered(finished, part, level) for level in levels for part in parts),
        picks={part: _picks(finished, part) for part in parts},
        counts=tuple(_count(finished, part) for part in parts),
        tasks=() if config.task == "pick" else task_rows(finished, parts),
    )


def to_dict(table: Table) -> dict[str, object]:
    """The table as plain values for JSON."""
    return {
        "table1": [_flat(row) for row in table.table1],
        "fig10": [_flat_success(row) for row in table.success],
        "false_poses": [{"part": row.part, "method": row.method, **asdict(row.share)} for row in table.false_poses],
        "reliability": {method: [asdict(row) for row in rows] for method, rows in table.reliability.items()},
        "margins": [{**asdict(margin), "excludes_zero": margin.excludes_zero} for margin in table.margins],
        "recovered": [asdict(row) for row in table.recovered],
        "picks": [{"part": part, **asdict(rate)} for part, rate in table.picks.items()],
        "tasks": [{**asdict(row), "kept": row.kept} for row in table.tasks],
        "accuracy": [_flat(row) for row in table.accuracy],
        "counts": [asdict(count) for count in table.counts],
        "episodes": {"planned": table.planned, "recorded": table.recorded, "failed": table.failed},
        "config_hash": table.config_hash,
    }


def _accuracy(pieces: Sequence[PieceRecord], part: str, method: str, min_visibility: float) -> AccuracyRow:
    matched = [
        result
        for piece in _counted(pieces, part, min_visibility)
        if (result := piece.results.get(method)) is not None and result.matched
    ]
    errors = [result.errors for result in matched if result.errors is not None]
    summaries = {quantity: summarise(_values(errors, quantity)) for quantity in QUANTITIES}
    coverage = Rate.of([is_inside_ellipsoid(r.normalized) for r in matched if r.normalized is not None])
    return AccuracyRow(part, method, min_visibility, summaries, coverage, TABLE_1.get((part, ROW_OF.get(method, ""))))


def _values(errors: Sequence[PoseErrors], quantity: str) -> list[float]:
    values = (getattr(error, quantity) for error in errors)
    return [value for value in values if value is not None]


def _success(pieces: Sequence[PieceRecord], part: str, method: str, min_visibility: float, stage: str) -> SuccessRow:
    results = [piece.results.get(method) for piece in _counted(pieces, part, min_visibility)]
    outcomes = [r.extracted if stage == "extraction" else r.matched for r in results if r is not None]
    published = FIGURE_10.get((part, method, stage))
    return SuccessRow(part, method, stage, min_visibility, Rate.of(outcomes), published)


def _counted(pieces: Sequence[PieceRecord], part: str, min_visibility: float) -> list[PieceRecord]:
    return [p for p in pieces if p.part == part and p.in_bin and p.visibility >= min_visibility]


def _false_poses(records: Sequence[EpisodeRecord], part: str, method: str) -> Rate:
    """Of the poses reported in scenes of this part alone; the others are those of the matched pieces."""
    scenes = [record for record in records if record.parts == (part,)]
    results = (piece.results.get(method) for record in scenes for piece in record.pieces)
    right = sum(result is not None and result.matched for result in results)
    wrong = sum(record.false_positives.get(method, 0) for record in scenes)
    return Rate.of([True] * wrong + [False] * right)


def _reliabilities(records: Sequence[EpisodeRecord], methods: Sequence[str]) -> dict[str, tuple[ReliabilityRow, ...]]:
    found = {method: _reliability(records, method) for method in methods}
    return {method: rows for method, rows in found.items() if any(row.right.n for row in rows)}


def _reliability(records: Sequence[EpisodeRecord], method: str) -> tuple[ReliabilityRow, ...]:
    results = (piece.results.get(method) for record in records for piece in record.pieces)
    right = [r.probability for r in results if r is not None and r.probability is not None]
    wrong = [p for record in records for p in record.false_probabilities.get(method, ())]
    return reliability([*right, *wrong], [True] * len(right) + [False] * len(wrong))


def _picks(records: Sequence[EpisodeRecord], part: str) -> Rate:
    """Attempted picks of a part; a pick at a pose that belongs to no piece counts where the scene has one type."""
    outcomes = []
    for record in records:
        part_of = {piece.index: piece.part for piece in record.pieces}
        sole = record.parts[0] if len(record.parts) == 1 else None
        attempted = [pick for pick in record.picks if pick.attempted]
        outcomes += [pick.succeeded for pick in attempted if part_of.get(pick.piece, sole) == part]  # type: ignore[arg-type]
    return Rate.of(outcomes)


def _count(records: Sequence[EpisodeRecord], part: str) -> PartCount:
    pieces = [piece for record in records for piece in record.pieces if piece.part == part]
    inside = [piece for piece in pieces if piece.in_bin]
    false_positives: Counter[str] = Counter()
    for record in records:
        if record.parts == (part,):
            false_positives.update(record.false_positives)
    lost_at = Counter(piece.failed_stage for piece in pieces if piece.failed_stage is not None)
    return PartCount(
        part=part,
        pieces=len(pieces),
        out_of_bin=len(pieces) - len(inside),
        barely_visible=sum(piece.visibility < BARELY_VISIBLE for piece in inside),
        false_positives=dict(sorted(false_positives.items())),
        lost_at=dict(sorted(lost_at.items())),
    )


def _flat(row: AccuracyRow) -> dict[str, object]:
    statistics = {
        f"{quantity}_{name}": getattr(summary, name)
        for quantity, summary in row.errors.items()
        for name in ("mean", "std", "median")
    }
    fields = {"part": row.part, "method": row.method, "min_visibility": row.min_visibility, "n": row.n}
    published = asdict(row.published) if row.published else None
    return {**fields, **statistics, "coverage": asdict(row.coverage), "published": published}


def _flat_success(row: SuccessRow) -> dict[str, object]:
    fields = {"part": row.part, "method": row.method, "stage": row.stage, "min_visibility": row.min_visibility}
    return {**fields, **asdict(row.rate), "published": row.published}
