"""Whole tasks, with the true poses: what fails here is the robot's own fault."""

from __future__ import annotations

import pytest

from benchmark.config import EpisodeConfig
from benchmark.episodes.episode import run_episode
from benchmark.records.episode_record import AttemptRecord, EpisodeRecord, from_json, to_json
from benchmark.report.task_rows import task_rows


@pytest.mark.sweep
def test_a_bin_is_cleared_and_the_record_says_how() -> None:
    record = run_episode(EpisodeConfig(("cover2",), 2, seed=10_103, localizer="oracle", task="clear"))
    assert record.places == ("tray", "tray")
    assert record.picks == ()
    *picks, last = record.attempts
    assert {attempt.piece for attempt in picks} == {0, 1}
    assert all(attempt.succeeded and attempt.goal == "pick" for attempt in picks)
    assert last.goal == "look"
    assert max(attempt.jerk_share for attempt in picks) < 1.1
    assert from_json(to_json(record)) == record


@pytest.mark.sweep
def test_a_peg_goes_into_a_bore() -> None:
    config = EpisodeConfig(("cover2",), 1, seed=1, localizer="oracle", task="insert", clearance_mm=0.1)
    (attempt,) = run_episode(config).attempts
    assert attempt.succeeded
    assert attempt.depth_mm == pytest.approx(10, abs=0.5)
    assert attempt.wrist_n < 60


def test_rows_count_what_was_tried_and_say_when_a_limit_was_not_kept() -> None:
    attempts = (
        AttemptRecord("pick", 0, succeeded=True, seconds={"look": 4.0, "move": 6.0}),
        AttemptRecord("pick", 1, succeeded=False, stage="grip", cause="nothing", stray_force_n=41.0),
        AttemptRecord("pick", None, succeeded=False, stage="plan", cause="no way"),
        AttemptRecord("look", None, succeeded=True, seconds={"look": 10.0}),
    )
    record = EpisodeRecord("hub/000", ("hub",), 0, 0, "", attempts=attempts, places=("tray", "bin", "lost"))
    (row,) = task_rows([record], ["hub", "cover1"])
    assert (row.succeeded.successes, row.succeeded.n) == (1, 2)
    assert (row.in_tray.successes, row.in_tray.n, row.lost) == (1, 3, 1)
    assert row.per_hour == pytest.approx(180)
    assert row.failures == {"grip: nothing": 1, "plan: no way": 1}
    assert not row.kept
