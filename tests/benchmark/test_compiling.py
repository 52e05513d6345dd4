"""The vision kernels of a fresh install are compiled by one process, while the others wait."""

from __future__ import annotations

import functools
import threading
import time
from pathlib import Path

import pytest

from benchmark.config import EpisodeConfig, SweepConfig
from benchmark.episodes import compiling
from benchmark.episodes.sweep import run_sweep
from benchmark.records.episode_record import EpisodeRecord
from vision import kernel_cache

CONFIG = SweepConfig(parts=("hub",), scenes=4)
BOUND_S = 60


@pytest.fixture(autouse=True)
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a fresh install's kernels."""
    folder = tmp_path / "cache" / "kernels-0123456789ab"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    return folder


def episode(config: EpisodeConfig) -> EpisodeRecord:
    return EpisodeRecord(config.key, config.parts, config.scene, config.seed, config.config_hash)


def compiling_episode(config: EpisodeConfig, kernels: Path) -> EpisodeRecord:
    """Compiles slowly in the first scene; the others find what it has compiled."""
    if config.scene == 0:
        time.sleep(1)
        kernels.mkdir(parents=True, exist_ok=True)
        (kernels / "kernel.nbc").touch()
    elif not (kernels / "kernel.nbc").exists():
        raise RuntimeError("compiled again")
    return episode(config)


def failing_episode(config: EpisodeConfig) -> EpisodeRecord:
    raise ZeroDivisionError


@pytest.mark.parametrize(("workers", "limit_s"), [(1, None), (2, None), (2, 600.0)])
def test_the_first_episode_compiles_alone_and_says_so_once(
    tmp_path: Path, kernels: Path, workers: int, limit_s: float | None
) -> None:
    told: list[str] = []
    run = functools.partial(compiling_episode, kernels=kernels)
    records = run_sweep(CONFIG, tmp_path / "a", run, workers, episode_limit_s=limit_s, tell=told.append)
    assert [record.error for record in records] == [None] * 4
    assert ["may take minutes" in told[0], "are compiled; the first episode took" in told[1]] == [True, True]
    run_sweep(CONFIG, tmp_path / "b", run, workers, episode_limit_s=limit_s, tell=told.append)
    assert len(told) == 2


def test_with_compiled_kernels_nobody_waits_for_the_first_episode(tmp_path: Path) -> None:
    compiling.note_done(CONFIG.localizer)
    run = functools.partial(meeting_episode, directory=tmp_path)
    records = run_sweep(CONFIG, tmp_path / "out", run, workers=2, tell=print)
    assert [record.error for record in records] == [None] * 4


def meeting_episode(config: EpisodeConfig, directory: Path) -> EpisodeRecord:
    """The first one ends when another one has begun."""
    if config.scene > 0:
        (directory / "begun").touch()
    deadline = time.monotonic() + BOUND_S
    while not (directory / "begun").exists():
        if time.monotonic() > deadline:
            raise TimeoutError
        time.sleep(0.05)
    return episode(config)


def test_what_one_localizer_needs_is_not_what_another_one_needs() -> None:
    compiling.note_done("oracle")
    assert compiling.is_done("oracle")
    assert not compiling.is_done("focal")


def test_another_processor_has_to_compile_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    compiling.note_done("focal")
    assert compiling.is_done("focal")
    monkeypatch.delenv("NUMBA_CPU_NAME")
    assert not compiling.is_done("focal")


def test_a_failed_first_episode_has_not_compiled(tmp_path: Path) -> None:
    records = run_sweep(CONFIG, tmp_path / "out", failing_episode, workers=1, tell=print)
    assert len(records) == 4
    assert not compiling.is_done(CONFIG.localizer)


def test_the_first_episode_may_run_longer_than_the_others_where_it_compiles(tmp_path: Path, kernels: Path) -> None:
    run = functools.partial(compiling_episode, kernels=kernels)
    records = run_sweep(CONFIG, tmp_path / "out", run, workers=2, episode_limit_s=0.5, tell=print)
    assert records[0].error is None


def test_of_two_sweeps_one_waits_for_the_other(kernels: Path) -> None:
    waits, entered = threading.Event(), threading.Event()

    def other_sweep() -> None:
        with compiling.alone(waits.set):
            entered.set()

    other = threading.Thread(target=other_sweep)
    with compiling.alone(pytest.fail):
        other.start()
        assert waits.wait(BOUND_S)
        assert not entered.is_set()
    other.join(BOUND_S)
    assert entered.is_set()


def test_without_a_folder_or_locks_nobody_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_locks(*_: object) -> None:
        raise OSError("no locks available")

    monkeypatch.setattr(compiling.fcntl, "flock", no_locks)
    with compiling.alone(pytest.fail):
        pass
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    compiling.note_done("focal")
    with compiling.alone(pytest.fail):
        assert not compiling.is_done("focal")


def test_kernels_that_are_not_kept_are_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "is_kept", lambda: False)
    told: list[str] = []
    run_sweep(CONFIG, tmp_path / "out", episode, workers=1, tell=told.append)
    assert [kernel_cache.ANEW in text for text in told] == [True, False]
