"""What came of tasks with several attempts: how much was done, how fast, how gently, and what failed where."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from benchmark.records.episode_record import AttemptRecord, EpisodeRecord
from benchmark.report.grid import NOTHING, Grid, part_title, rate_text
from benchmark.report.rate import Rate

MOST_STRAY_N = 40.0
MOST_SHARE = 1.1


@dataclass(frozen=True)
class TaskRow:
    """One goal with one part.

    Attributes:
        goal: of the attempts: ``pick``, ``push`` or ``insert``.
        part: the kind of scene.
        succeeded: attempts, of those that had something to do.
        in_tray: pieces that lay in the tray in the end; for picks.
        lost: pieces that lay neither in the bin nor in the tray.
        per_hour: successes in an hour of simulated time, the looks included.
        failures: attempts that failed, by stage and cause.
        wrist_n: largest force that the wrist felt in an insertion.
        stray_n: largest force on anything that was not to be touched.
        shares: largest measured speed, acceleration and jerk in free air over their limits.
        penetration_mm: deepest contact of the robot.
    """

    goal: str
    part: str
    succeeded: Rate
    in_tray: Rate
    lost: int
    per_hour: float
    failures: dict[str, int]
    wrist_n: float
    stray_n: float
    shares: tuple[float, float, float]
    penetration_mm: float

    @property
    def kept(self) -> bool:
        """Whether all limits were kept that hold for every step."""
        return self.stray_n <= MOST_STRAY_N and max(self.shares) <= MOST_SHARE


def task_rows(records: Sequence[EpisodeRecord], parts: Sequence[str]) -> tuple[TaskRow, ...]:
    """A row for each part and goal that occurs in finished episodes with the records of a task."""
    rows = []
    for part in parts:
        mine = [record for record in records if record.attempts and record.parts == (part,)]
        goals = dict.fromkeys(
            attempt.goal for record in mine for attempt in record.attempts if attempt.goal != "look"
        )
        rows += [_row(goal, part, mine) for goal in goals]
    return tuple(rows)


def _row(goal: str, part: str, records: Sequence[EpisodeRecord]) -> TaskRow:
    attempts = [a for record in records for a in record.attempts if a.goal == goal]
    tried = [a for a in attempts if a.stage not in ("localize", "plan")]
    places = [place for record in records for place in record.places]
    seconds = sum(sum(a.seconds.values()) for record in records for a in record.attempts)
    successes = sum(a.succeeded for a in attempts)
    return TaskRow(
        goal=goal,
        part=part,
        succeeded=Rate.of([a.succeeded for a in tried]),
        in_tray=Rate.of([place == "tray" for place in places] if goal == "pick" else []),
        lost=places.count("lost"),
        per_hour=3600 * successes / seconds if seconds else 0.0,
        failures=dict(Counter(_failure(a) for a in attempts if not a.succeeded)),
        wrist_n=max((a.wrist_n for a in attempts), default=0.0),
        stray_n=max((a.stray_force_n for a in attempts), default=0.0),
        shares=tuple(_most(attempts, name) for name in ("speed_share", "acceleration_share", "jerk_share")),  # type: ignore[arg-type]
        penetration_mm=_most(attempts, "penetration_mm"),
    )


def _failure(attempt: AttemptRecord) -> str:
    return f"{attempt.stage}: {attempt.cause}" if attempt.cause else str(attempt.stage)


def _most(attempts: Sequence[AttemptRecord], name: str) -> float:
    return max((float(getattr(attempt, name)) for attempt in attempts), default=0.0)


def task_grids(rows: Sequence[TaskRow]) -> list[Grid]:
    """The grids of the tasks: what was done, what failed, and whether the limits were kept."""
    if not rows:
        return []
    done = Grid(
        "Tasks",
        ("Object", "Goal", "n", "Succeeded", "In the tray", "Lost", "Per hour"),
        tuple(
            (
                part_title(r.part),
                r.goal,
                str(r.succeeded.n),
                rate_text(r.succeeded),
                rate_text(r.in_tray) if r.in_tray.n else NOTHING,
                str(r.lost),
                f"{r.per_hour:.0f}",
            )
            for r in rows
        ),
        note="Attempts for which a way was found; all pieces; successes per hour of simulated time, looks included.",
    )
    failures = [(part_title(r.part), r.goal, why, str(count)) for r in rows for why, count in r.failures.items()]
    steps = Grid(
        "Every physics step",
        ("Object", "Goal", "Speed", "Acceleration", "Jerk", "Stray force (N)", "Wrist (N)", "Deepest (mm)", "Kept"),
        tuple(
            (
                part_title(r.part),
                r.goal,
                *(f"{share:.3f}" for share in r.shares),
                f"{r.stray_n:.1f}",
                f"{r.wrist_n:.1f}",
                f"{r.penetration_mm:.2f}",
                "yes" if r.kept else "NO",
            )
            for r in rows
        ),
        note="Measured joint rates in free air over their limits; force on what was not to be touched.",
    )
    if not any(max(row.shares) for row in rows):
        return [done, *([_failed(failures)] if failures else [])]
    return [done, *([_failed(failures)] if failures else []), steps]


def _failed(rows: Sequence[tuple[str, ...]]) -> Grid:
    return Grid("Attempts that failed", ("Object", "Goal", "Where and why", "n"), tuple(rows))
