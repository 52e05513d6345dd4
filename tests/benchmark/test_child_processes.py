from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from benchmark.child_process import ended_by_signals

TESTS = Path(__file__).parent
BOUND_S = 60

TEACHING = """
import asyncio, time
from vision.teaching.editor.workers import Worker

def work(seconds):
    time.sleep(seconds)

async def main():
    idle, busy = Worker(), Worker()
    await asyncio.gather(idle.run(work, 0), busy.run(work, 0))
    print("ready", flush=True)
    if {busy}:
        await busy.run(work, 600)
    await asyncio.sleep(600)

if __name__ == "__main__":
    asyncio.run(main())
"""

SWEEP = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_sweep import CONFIG, fake_episode
from benchmark.episodes.sweep import run_sweep

def episode(config):
    time.sleep(600 if config.scene else 0)
    return fake_episode(config)

def note(done, total, record):
    if done:
        print("ready", flush=True)

if __name__ == "__main__":
    run_sweep(CONFIG, Path(sys.argv[1]), episode, workers=2, on_progress=note)
"""

PROGRAMS = {
    "teaching, idle": TEACHING.format(busy=False),
    "teaching, busy": TEACHING.format(busy=True),
    "sweep": SWEEP.format(tests=str(TESTS)),
}


@contextmanager
def started(text: str, directory: Path) -> Iterator[tuple[subprocess.Popen[str], list[psutil.Process]]]:
    """A program that is ready, and all its descendants; none of them is left afterwards, whatever fails."""
    script = directory / "program.py"
    script.write_text(text)
    command = [sys.executable, str(script), str(directory / "out")]
    environment = os.environ | {"PYTHONPATH": str(TESTS.parents[1])}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment
    ) as process:
        children = []
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            children = psutil.Process(process.pid).children(recursive=True)
            yield process, children
        finally:
            process.kill()
            for child in children:
                if child.is_running():
                    child.kill()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
@pytest.mark.parametrize("program", PROGRAMS)
def test_children_end_with_their_parent(program: str, number: signal.Signals, tmp_path: Path) -> None:
    with started(PROGRAMS[program], tmp_path) as (process, children):
        assert len(children) >= 2
        process.send_signal(number)
        code = process.wait(BOUND_S)
        _, left = psutil.wait_procs(children, BOUND_S)
        assert [child.cmdline() for child in left] == []
        clean = program == "sweep" and number != signal.SIGKILL
        assert code == (128 + number if clean else -number)


ONE_WORKER = """
import time
from benchmark.episodes.pool import Pool

if __name__ == "__main__":
    with Pool(time.sleep, 1) as pool:
        for _ in pool.run([0, 600]):
            print("ready", flush=True)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux kills a stopped process when its parent ends")
@pytest.mark.parametrize("program", [PROGRAMS["teaching, idle"], ONE_WORKER], ids=["teaching", "pool"])
def test_a_stopped_child_ends_with_its_killed_parent(program: str, tmp_path: Path) -> None:
    with started(program, tmp_path) as (process, children):
        workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
        for worker in workers:
            worker.suspend()
        process.kill()
        process.wait(BOUND_S)
        _, left = psutil.wait_procs(workers, BOUND_S)
        assert workers
        assert left == []


MASK = """
import asyncio, signal
from benchmark.episodes.pool import Pool
from vision.teaching.editor.workers import Worker

def mask(_):
    return signal.pthread_sigmask(signal.SIG_BLOCK, [])

starting = mask(0)

def masks(_):
    return starting, mask(0)

def sweep():
    with Pool(masks, 1) as pool:
        return next(pool.run([0]))[1]

def teach():
    return asyncio.run(Worker().run(masks, 0))

if __name__ == "__main__":
    starting, running = {start}()
    print(sorted(map(int, starting)), sorted(map(int, running)))
"""


@pytest.mark.parametrize("start", ["sweep", "teach"])
def test_the_first_child_hears_no_signal_before_it_can_answer_one(start: str, tmp_path: Path) -> None:
    script = tmp_path / "program.py"
    script.write_text(MASK.replace("{start}", start))
    environment = os.environ | {"PYTHONPATH": str(TESTS.parents[1])}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=True)
    blocked = sorted(map(int, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)))
    assert done.stdout == f"{blocked} []\n"


KILLED = """
import os, signal
from vision.teaching.editor.workers import Worker

if __name__ == "__main__":
    worker = Worker()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_nobody_is_told_what_is_removed_after_a_killed_program(tmp_path: Path) -> None:
    script = tmp_path / "program.py"
    script.write_text(KILLED)
    environment = os.environ | {"PYTHONPATH": str(TESTS.parents[1])}
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (-signal.SIGKILL, "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signal_leaves_the_block_with_the_exit_code_of_a_shell(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(SystemExit) as end, ended_by_signals():
        signal.raise_signal(number)
    assert end.value.code == 128 + number
    assert signal.getsignal(number) is before


def test_server_that_answers_sigterm_ends_in_order_on_sighup_too() -> None:
    heard = []
    with ended_by_signals():
        ours = signal.signal(signal.SIGTERM, lambda number, _: heard.append(number))
        signal.raise_signal(signal.SIGHUP)
        assert heard == [signal.SIGTERM]
        signal.signal(signal.SIGTERM, ours)  # as uvicorn does when it has ended
        with pytest.raises(SystemExit) as end:
            signal.raise_signal(signal.SIGTERM)
    assert end.value.code == 128 + signal.SIGHUP


def test_ignored_hangup_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with ended_by_signals():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
