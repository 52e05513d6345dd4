"""What a sweep does when its workers are killed, hang or run out of something."""

from __future__ import annotations

import contextlib
import errno
import functools
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest

from benchmark import cli
from benchmark.config import EpisodeConfig, SweepConfig
from benchmark.episodes import pool
from benchmark.episodes.failures import failed_episode
from benchmark.episodes.pool import Pool
from benchmark.episodes.sweep import run_sweep
from benchmark.localizers.errors import LocalizerError
from benchmark.records.episode_record import EpisodeRecord
from benchmark.records.store import read_records
from tests.benchmark.test_child_processes import BOUND_S, started
from vision.errors import ResourceError

ROOT = Path(__file__).resolve().parents[2]
CONFIG = SweepConfig(parts=("hub", "cover1"), scenes=3)
EPISODE = EpisodeConfig(("hub",))
FIRST = "hub/000"


def episode(config: EpisodeConfig) -> EpisodeRecord:
    return EpisodeRecord(config.key, config.parts, config.scene, config.seed, config.config_hash)


def once(config: EpisodeConfig, directory: Path, act: Callable[[], object]) -> EpisodeRecord:
    """Does something bad in the first episode, but not when it is run again."""
    if config.key == FIRST and not (directory / "done").exists():
        (directory / "done").touch()
        act()
    return episode(config)


def kill_myself(number: signal.Signals = signal.SIGKILL) -> None:
    os.kill(os.getpid(), number)


def always(config: EpisodeConfig, act: Callable[[], object]) -> EpisodeRecord:
    if config.key == FIRST:
        act()
    return episode(config)


def slow_episode(config: EpisodeConfig) -> EpisodeRecord:
    time.sleep(0.3)
    return episode(config)


def run_out_of_memory() -> None:
    raise MemoryError("Unable to allocate 3.00 GiB")


def run_out_of_files() -> None:
    raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))


def run(function: Callable[..., EpisodeRecord], out: Path, **arguments: object) -> dict[str, str | None]:
    records = run_sweep(CONFIG, out, functools.partial(function, **arguments), workers=2, episode_limit_s=60)
    return {record.key: record.error for record in records}


def failures(function: Callable[..., EpisodeRecord], out: Path, **arguments: object) -> dict[str, str]:
    errors = run(function, out, **arguments)
    assert len(errors) == 6
    return {key: error for key, error in errors.items() if error is not None}


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_an_episode_whose_worker_was_killed_runs_again(tmp_path: Path, number: signal.Signals) -> None:
    kill = functools.partial(kill_myself, number)
    assert failures(once, tmp_path / "out", directory=tmp_path, act=kill) == {}
    assert (tmp_path / "done").exists()


def test_an_episode_that_costs_too_many_workers_has_failed_and_says_what_helps(tmp_path: Path) -> None:
    failed = failures(always, tmp_path, act=kill_myself)
    assert failed.keys() == {FIRST}
    assert "SIGKILL" in failed[FIRST]
    assert "memory" in failed[FIRST]
    assert failed[FIRST].endswith("Use fewer --workers")
    assert failures(episode, tmp_path) == {}  # it is tried again


@pytest.mark.slow
@pytest.mark.parametrize("act", [functools.partial(kill_myself, signal.SIGSTOP), functools.partial(time.sleep, 600)])
@pytest.mark.parametrize("workers", [1, 2])
def test_a_worker_that_hangs_is_ended_and_the_other_episodes_run(
    tmp_path: Path, act: Callable[[], object], workers: int
) -> None:
    hang = functools.partial(always, act=act)
    records = run_sweep(CONFIG, tmp_path, hang, workers=workers, episode_limit_s=3)
    assert {r.key: r.error for r in records if r.error} == {FIRST: "it ran longer than 3 s, and was stopped"}
    assert len(records) == 6
    assert multiprocessing.active_children() == []
    assert failures(episode, tmp_path) == {}


def test_a_worker_that_is_killed_while_it_starts_is_replaced(tmp_path: Path) -> None:
    kill = functools.partial(Kills, tmp_path / "starts")
    with Pool(kill(1), 1) as started:
        assert [*started.run([1, 2])] == [(1, 1), (2, 2)]
    with Pool(kill(99), 2) as never_started, pytest.raises(ResourceError, match="Use fewer --workers"):
        next(never_started.run([1, 2]))
    assert multiprocessing.active_children() == []


class Kills:
    """A function that kills the first processes that unpickle it."""

    def __init__(self, starts: Path, how_many: int) -> None:
        self.starts, self.how_many = starts, how_many

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state)
        with open(self.starts, "a") as file:
            file.write(".")
        if self.starts.stat().st_size <= self.how_many:
            kill_myself()

    def __call__(self, task: int) -> int:
        return task


@pytest.mark.slow
def test_workers_killed_at_random_change_no_record(tmp_path: Path) -> None:
    ended, chance, killed = threading.Event(), random.Random(1), []

    def kill_workers() -> None:
        while not ended.wait(chance.uniform(0.1, 0.8)):
            with contextlib.suppress(psutil.NoSuchProcess, IndexError):
                workers = [c for c in psutil.Process().children() if "spawn_main" in " ".join(c.cmdline())]
                chance.choice(workers).send_signal(chance.choice([signal.SIGKILL, signal.SIGTERM]))
                killed.append(True)

    killer = threading.Thread(target=kill_workers)
    killer.start()
    try:
        with contextlib.suppress(ResourceError):  # three may be killed in a row while they start
            run(slow_episode, tmp_path / "out")
    finally:
        ended.set()
        killer.join()
    assert killed
    assert failures(episode, tmp_path / "out") == {}
    undisturbed = run_sweep(CONFIG, tmp_path / "undisturbed", episode, workers=1)
    assert read_records(tmp_path / "out") == undisturbed


INTERRUPTED = """
import functools, os, signal, sys, time
from pathlib import Path
from tests.benchmark.test_sweep_deaths import CONFIG, always, kill_myself
from benchmark.episodes.sweep import run_sweep

def note(done, total, record):
    if done:
        print("ready", flush=True)

def stop_or_wait(config):
    if config.key != "cover1/000":
        kill_myself(signal.SIGSTOP)
    return always(config, int)

if __name__ == "__main__":
    run_sweep(CONFIG, Path(sys.argv[1]), stop_or_wait, workers=2, on_progress=note)
"""


@pytest.mark.slow
@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_ends_stopped_workers_too(tmp_path: Path, presses: int) -> None:
    with started(INTERRUPTED, tmp_path) as (process, children):
        for _ in range(presses):
            process.send_signal(signal.SIGINT)
        process.wait(BOUND_S)
        _, left = psutil.wait_procs(children, BOUND_S)
        assert [child.cmdline() for child in left] == []
    assert [record.key for record in read_records(tmp_path / "out")] == ["cover1/000"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_sweep_that_is_ended_says_what_is_recorded(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def end(done: int, total: int, record: EpisodeRecord | None) -> None:
        if done == 1:
            signal.raise_signal(number)

    def command() -> int:
        """Example."""
        run_sweep(CONFIG, tmp_path, episode, workers=2, on_progress=end)
        return 0

    monkeypatch.setattr(cli, "_load", lambda _: command)
    assert cli.main(["sweep"]) == 128 + number
    told = f"1 of 6 episodes are recorded in {tmp_path}. The same command goes on from there"
    assert capsys.readouterr().err == f"focalpick: stopped; {told}\n"


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        np._core._exceptions._ArrayMemoryError((9, 9), np.dtype(float)),
        cv2.error("OpenCV(5.0.0) alloc.cpp:73: error: (-4:Insufficient memory) Failed to allocate 480000000 bytes"),
        OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)),
    ],
    ids=lambda error: type(error).__name__,
)
def test_want_of_memory_is_a_failure_with_advice(error: Exception) -> None:
    assert failed_episode(EPISODE, error).error.endswith("The memory ran out: use fewer --workers")
    with pytest.raises(LocalizerError) as blamed:
        blame_localizer(error)
    assert "use fewer --workers" in failed_episode(EPISODE, blamed.value).error


def blame_localizer(error: Exception) -> None:
    raise LocalizerError("localizer mine:make", got=str(error), expected="none") from error


def test_other_errors_do_not_speak_of_memory() -> None:
    assert "memory" not in failed_episode(EPISODE, ZeroDivisionError("division by zero")).error


def test_an_episode_without_memory_is_tried_again_when_the_sweep_is_resumed(tmp_path: Path) -> None:
    assert "use fewer --workers" in failures(always, tmp_path, act=run_out_of_memory)[FIRST]
    assert failures(episode, tmp_path) == {}


@pytest.mark.parametrize("workers", [1, 2])
def test_want_of_open_files_in_an_episode_ends_the_sweep_with_advice(tmp_path: Path, workers: int) -> None:
    with pytest.raises(ResourceError, match=r"Too many open files.*ulimit -n.*the same command again"):
        run_sweep(CONFIG, tmp_path, functools.partial(always, act=run_out_of_files), workers=workers)
    assert FIRST not in {record.key for record in read_records(tmp_path)}


def test_an_error_of_the_users_localizer_is_not_taken_for_one_of_the_machine(tmp_path: Path) -> None:
    records = run_sweep(CONFIG, tmp_path, functools.partial(always, act=leak_files), workers=1)
    assert [record.key for record in records if record.error] == [FIRST]


def leak_files() -> None:
    blame_localizer(OSError(errno.EMFILE, os.strerror(errno.EMFILE)))


FEW_FILES = """
import os, resource, sys
from pathlib import Path
from tests.benchmark.test_sweep_deaths import CONFIG, episode
from benchmark.episodes.sweep import run_sweep
from vision.errors import ResourceError

if __name__ == "__main__":
    least = max(map(int, os.listdir("/proc/self/fd")))
    resource.setrlimit(resource.RLIMIT_NOFILE, (least + 7, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    try:
        run_sweep(CONFIG, Path(sys.argv[1]), episode, workers=6)
    except ResourceError as error:
        print(error)
"""

NO_TEMPORARY_FILES = """
import sys, tempfile

def no_place():
    raise FileNotFoundError("No usable temporary directory")

tempfile.gettempdir = no_place
from pathlib import Path
from tests.benchmark.test_sweep_deaths import CONFIG, episode
from benchmark.episodes.sweep import run_sweep

if __name__ == "__main__":
    print(len(run_sweep(CONFIG, Path(sys.argv[1]), episode, workers=2)))
"""


def output(program: str, directory: Path) -> str:
    script = directory / "program.py"
    script.write_text(program)
    command = [sys.executable, str(script), str(directory / "out")]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=True,
        timeout=BOUND_S,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert done.stderr == ""
    return done.stdout.strip()


def test_a_low_limit_of_open_files_ends_the_sweep_with_advice(tmp_path: Path) -> None:
    text = output(FEW_FILES, tmp_path)
    assert "of 6: got Too many open files" in text
    assert "ulimit -n 1024" in text


def test_workers_need_no_place_for_temporary_files(tmp_path: Path) -> None:
    assert output(NO_TEMPORARY_FILES, tmp_path) == "6"


def test_time_that_the_sweep_itself_was_stopped_is_no_time_of_its_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(pool.time, "monotonic", lambda: now[0])
    clock = pool._Clock()
    now[0] = 0.5
    assert clock.tick() == 0.5
    now[0] = 3600.5  # Ctrl-Z, and an hour later fg
    assert clock.tick() <= 5
