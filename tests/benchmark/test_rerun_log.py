from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmark.config import EpisodeConfig
from benchmark.episodes.evaluation import Verdict
from benchmark.records.episode_record import EpisodeRecord, LocalizerResult, PickRecord, PieceRecord, PoseErrors
from benchmark.report.rerun_blueprint import LAYERS, stage_entity, view_entity
from benchmark.report.rerun_log import errors_text, outcome_text, record_episode, summary
from vision.drawing.explain import PANELS
from vision.errors import InputError

CONFIG = EpisodeConfig(("cover2",), pieces=2, seed=3, views=2)


def rerun(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rerun_cli", "rrd", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, EpisodeRecord]:
    path = tmp_path_factory.mktemp("recording") / "cover2.rrd"
    return path, record_episode(CONFIG, path)


@pytest.mark.sweep
def test_a_recording_verifies_and_holds_everything(recorded: tuple[Path, EpisodeRecord]) -> None:
    path, record = recorded
    assert path.stat().st_size < 30e6
    verified = rerun("verify", path)
    assert verified.returncode == 0, verified.stderr
    printed = rerun("print", path).stdout
    layers = [layer for layers in LAYERS.values() for layer in layers]
    entities = [f"{view_entity(i)}/{layer}" for i in range(CONFIG.views) for layer in ("image", *layers)]
    entities += [stage_entity(i, panel) for i in range(CONFIG.views) for panel in PANELS]
    entities += ["world/cell/arm_forearm", "world/cell/arm_gripper_finger_left", "world/pieces/cover2"]
    entities += [f"world/localized/truth/{i}" for i in range(CONFIG.pieces)]
    entities += ["outcome", "errors", "events"]
    assert [entity for entity in entities if f"/{entity}" not in printed] == []
    assert any(piece.failed_stage is None for piece in record.pieces)


@pytest.mark.sweep
def test_recording_changes_neither_the_episode_nor_from_one_time_to_the_next(
    recorded: tuple[Path, EpisodeRecord], tmp_path: Path
) -> None:
    path, record = recorded
    again = tmp_path / "again.rrd"
    second = record_episode(CONFIG, again)
    assert (second.pieces, second.picks) == (record.pieces, record.picks)
    compared = rerun("compare", "--unordered", path, again)
    assert compared.returncode == 0, compared.stderr
    from benchmark.episodes.episode import run_episode

    assert run_episode(CONFIG).pieces == record.pieces


def test_a_file_that_cannot_be_written_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--rrd"):
        record_episode(CONFIG, tmp_path / "missing" / "a.rrd")


def test_texts_tell_how_it_went() -> None:
    good = LocalizerResult(True, True, PoseErrors(0.5, 0.25, None, 0.25, 1.0))
    missed = LocalizerResult(True, False)
    pieces = (
        PieceRecord(0, "hub", 0.9, True, {"focal": good}),
        PieceRecord(1, "hub", 0.4, True, {"focal": missed}, "matching"),
        PieceRecord(2, "hub", 0.0, False, {"focal": LocalizerResult(False, False)}, "drop"),
    )
    errors = errors_text(Verdict(pieces, {"focal": 2}, (0, None, None)))
    assert "| 0 | hub | 90% | 0.50 mm, 0.25° |" in errors
    assert "| 1 | hub | 40% | not matched |" in errors
    assert "| 2 | hub | fell out | not found |" in errors
    assert "focal 2" in errors
    picks = (PickRecord(True, 0, False, "lift", "bore_front"),)
    record = EpisodeRecord("hub/000", ("hub",), 0, 7, "", pieces=pieces, picks=picks)
    assert summary(record) == "1 of 3 pieces localised, 0 of 1 picked"
    text = outcome_text(record, [("view 1 taken", 4.32)])
    assert "Pick by bore_front: failed at lift" in text
    assert "| 4.32 s | view 1 taken |" in text


def test_a_sample_of_motion_is_kept_where_something_moves() -> None:
    from benchmark.report.rerun_scene import _changes

    rows = np.array([0.0, 0.0, 0.0, 1.0, 2.0, 2.0, 2.0])[:, None]
    assert _changes(rows).tolist() == [0, 2, 3, 4]
