"""A sweep and the files that its results depend on: meshes, vision models, the user's localizer."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmark.config import EpisodeConfig, SweepConfig
from benchmark.episodes.sweep import run_sweep
from benchmark.records.episode_record import EpisodeRecord
from benchmark.records.store import INPUTS_FILE, read_inputs, read_records
from benchmark.study.taught_models import MODELS
from vision.errors import FileFormatError, InputError

FILES = ("pulley.stl", "taught/pulley.json", "mine_of_sweep.py")


def episode(config: EpisodeConfig) -> EpisodeRecord:
    return EpisodeRecord(config.key, config.parts, config.scene, config.seed, config.config_hash)


def failing_episode(config: EpisodeConfig) -> EpisodeRecord:
    raise ZeroDivisionError


def failing_second_episode(config: EpisodeConfig) -> EpisodeRecord:
    return failing_episode(config) if config.scene == 1 else episode(config)


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SweepConfig:
    """A sweep with a mesh, a taught model and a localizer of the user's, all in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    Path("taught").mkdir()
    for name in FILES:
        Path(name).write_text("first = 1\n")
    return SweepConfig(parts=("pulley.stl",), scenes=2, localizer="mine_of_sweep:make", models="taught")


@pytest.mark.parametrize("name", FILES)
def test_a_sweep_whose_file_has_changed_is_refused_until_the_file_is_back(config: SweepConfig, name: str) -> None:
    run_sweep(config, Path("out"), failing_second_episode)
    Path(name).write_text("second = 2\n")
    word = {"pulley.stl": "mesh pulley.stl", "mine_of_sweep.py": "in mine_of_sweep.py"}.get(name, "vision model of")
    with pytest.raises(InputError, match=f"sweep in out: got .*{re.escape(word)}.*SHA-256.*Put the file back, or"):
        run_sweep(config, Path("out"), episode)
    assert [record.error is None for record in read_records(Path("out"))] == [True, False]
    Path(name).write_text("first = 1\n")
    assert all(record.error is None for record in run_sweep(config, Path("out"), episode))


def test_what_a_localizer_imports_belongs_to_it(config: SweepConfig) -> None:
    Path("mine_of_sweep.py").write_text("import mine_beside\n")
    Path("mine_beside.py").write_text("import mine_farther, os\n")
    Path("mine_farther.py").write_text("first = 1\n")
    Path("not_mine.py").write_text("first = 1\n")
    run_sweep(config, Path("out"), failing_second_episode)
    Path("not_mine.py").write_text("second = 2\n")
    Path("mine_farther.py").write_text("second = 2\n")
    with pytest.raises(InputError, match=r"mine_farther\.py of localizer") as refusal:
        run_sweep(config, Path("out"), episode)
    assert "not_mine" not in str(refusal.value)


def test_only_the_file_that_has_changed_is_named(config: SweepConfig) -> None:
    run_sweep(config, Path("out"), episode)
    Path("pulley.stl").write_text("second = 2\n")
    with pytest.raises(InputError) as refusal:
        run_sweep(config, Path("out"), episode)
    assert "model" not in str(refusal.value)
    assert "localizer" not in str(refusal.value)


def test_a_model_that_takes_the_place_of_the_shipped_one_is_a_change(tmp_path: Path) -> None:
    config = SweepConfig(parts=("hub",), scenes=1, models=str(tmp_path))
    run_sweep(config, tmp_path / "out", episode)
    (tmp_path / "hub.json").write_text("{}")
    with pytest.raises(InputError, match="vision model of hub"):
        run_sweep(config, tmp_path / "out", episode)


def test_files_may_be_mended_as_long_as_no_episode_was_finished(config: SweepConfig) -> None:
    run_sweep(config, Path("out"), failing_episode)
    Path("mine_of_sweep.py").write_text("second = 2\n")
    assert all(record.error is None for record in run_sweep(config, Path("out"), episode))
    Path("mine_of_sweep.py").write_text("first = 1\n")
    with pytest.raises(InputError, match="mine_of_sweep"):
        run_sweep(config, Path("out"), episode)


def test_what_was_taught_from_a_mesh_is_not_mixed_with_another_mesh(config: SweepConfig) -> None:
    def teach_and_die() -> None:
        Path("out", MODELS).mkdir()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(config, Path("out"), episode, prepare=teach_and_die)
    Path("pulley.stl").write_text("second = 2\n")
    with pytest.raises(InputError, match=r"mesh pulley\.stl"):
        run_sweep(config, Path("out"), episode)


def test_a_directory_of_an_older_version_is_resumed_and_stays_as_it_is(config: SweepConfig) -> None:
    run_sweep(config, Path("out"), failing_second_episode)
    Path("out", INPUTS_FILE).unlink()
    Path("pulley.stl").write_text("second = 2\n")
    assert all(record.error is None for record in run_sweep(config, Path("out"), episode))
    assert not Path("out", INPUTS_FILE).exists()


def test_shipped_parts_and_localizers_need_no_file_of_the_users(tmp_path: Path) -> None:
    run_sweep(SweepConfig(parts=("hub+cover1", "hub"), scenes=1), tmp_path, episode)
    assert set(read_inputs(tmp_path)) == {"vision model of hub", "vision model of cover1"}


def test_a_corrupt_note_is_named(config: SweepConfig) -> None:
    run_sweep(config, Path("out"), episode)
    Path("out", INPUTS_FILE).write_text('{"schema": 1, "sha256": {"mesh pulley.stl": 3}}')
    with pytest.raises(FileFormatError, match=r"inputs\.json"):
        run_sweep(config, Path("out"), episode)
