"""Processes that run a function on one task after another; any of them can hang or be killed, and is replaced.

Each process has a pipe of its own, so that the loss of one touches no other. What a process runs when it is lost is
given to another one; only what has cost several processes their lives, or ran over the time limit, is given up.
"""

from __future__ import annotations

import contextlib
import errno
import math
import multiprocessing
import os
import pickle
import signal
import socket
import struct
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from types import TracebackType
from typing import Any, Generic, TypeVar

from benchmark.child_process import single_threaded
from vision.errors import ResourceError
from vision.teaching.editor.child_process import begin_child, start_resource_tracker, uninterrupted

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 3
"""So many processes may be lost with one task, or in a row while they start."""
STARTING_LIMIT_S = 600.0
"""For a process to start; on a busy machine the libraries take a while to load."""
_TICK_S = 0.5
_MESSAGE_LIMIT_S = 30
_FEWER = "Use fewer --workers"


@dataclass(frozen=True)
class Lost:
    """Stands for the result of a task that was given up.

    Attributes:
        reason: what became of its processes, in one line.
    """

    reason: str


class Pool(Generic[Task, Result]):
    """Runs one function in several processes. Use it as a context manager: none of its processes outlives it."""

    def __init__(self, function: Callable[[Task], Result], size: int, limit_s: float | None = None) -> None:
        """Prepare; the processes start when there is something to do.

        Args:
            function: of one task; it and the tasks can be pickled.
            size: how many processes at most.
            limit_s: how long a task may run, in seconds; None: for ever.
        """
        self._function = pickle.dumps(function)
        self._size, self._limit_s = size, math.inf if limit_s is None else limit_s
        self._crew: list[_Worker[Task]] = []
        self._waiting: deque[Task] = deque()
        self._losses: Counter[Task] = Counter()
        self._failed_starts = 0

    def __enter__(self) -> Pool[Task, Result]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with uninterrupted():
            for worker in self._crew:
                worker.process.kill()  # also one that was stopped
            for worker in self._crew:
                worker.end()
        self._crew.clear()

    def run(self, tasks: Iterable[Task], grace_s: float = 0.0) -> Generator[tuple[Task, Result | Lost]]:
        """Each task with its result, as they are finished.

        Args:
            tasks: hashable.
            grace_s: added to the time limit, in seconds.

        Raises:
            ResourceError: a process cannot be started.
            Exception: what the function raises; the tasks that are running are lost.
        """
        self._waiting.extend(tasks)
        limit_s = self._limit_s + grace_s
        clock = _Clock()
        while self._waiting or any(worker.task is not None for worker in self._crew):
            self._start_workers()
            for worker in self._crew:
                if worker.is_free and self._waiting:
                    worker.give(self._waiting.popleft())
            wait([thing for worker in self._crew for thing in (worker.connection, worker.process.sentinel)], _TICK_S)
            elapsed_s = clock.tick()
            for worker in list(self._crew):
                worker.spent_s += elapsed_s
                if (done := self._attend(worker, limit_s)) is not None:
                    yield done

    def _start_workers(self) -> None:
        """Have a process for every task that waits, as far as there may be so many."""
        occupied = sum(worker.task is not None for worker in self._crew)
        while len(self._crew) < min(self._size, occupied + len(self._waiting)):
            try:
                start_resource_tracker()
                with uninterrupted():  # a process that nobody knows of would be left
                    self._crew.append(_Worker(self._function))
            except OSError as error:
                remedy = f"{_FEWER}, or more open files: ulimit -n 1024" if error.errno == errno.EMFILE else _FEWER
                what = f"worker {len(self._crew) + 1} of {self._size}"
                raise ResourceError(f"{what}: got {error.strerror}; expected room for it. {remedy}") from error

    def _attend(self, worker: _Worker[Task], limit_s: float) -> tuple[Task, Result | Lost] | None:
        """What a worker has to say, or became of it."""
        try:
            answer = worker.hear()
        except (EOFError, OSError):
            return self._replace(worker)
        if answer is not None:
            return self._receive(worker, *answer)
        if not worker.process.is_alive():
            return self._replace(worker)
        if worker.task is not None and worker.spent_s > limit_s:
            self._crew.remove(worker)
            worker.end()
            return worker.task, Lost(f"it ran longer than {limit_s:g} s, and was stopped")
        if not worker.is_ready and worker.spent_s > max(limit_s, STARTING_LIMIT_S):
            return self._replace(worker)
        return None

    def _receive(self, worker: _Worker[Task], succeeded: bool, value: Any) -> tuple[Task, Result | Lost] | None:
        if not succeeded:
            raise value
        if worker.task is None:
            worker.is_ready = True
            self._failed_starts = 0
            return None
        task, worker.task = worker.task, None
        return task, value

    def _replace(self, worker: _Worker[Task]) -> tuple[Task, Result | Lost] | None:
        """Forget a worker that is lost; its task goes to the end of the queue, or is given up."""
        self._crew.remove(worker)
        how = _ending(worker.end())
        if not worker.is_ready:
            self._failed_starts += 1
            if self._failed_starts >= ATTEMPTS:
                raise ResourceError(f"{ATTEMPTS} workers were lost while they started; the last {how}. {_FEWER}")
        if (task := worker.task) is None:
            return None
        self._losses[task] += 1
        if self._losses[task] >= ATTEMPTS:
            return task, Lost(f"{ATTEMPTS} workers were lost with it; the last {how}")
        self._waiting.append(task)
        return None


class _Worker(Generic[Task]):
    """One process and what it is doing.

    Attributes:
        process: itself.
        connection: the pipe to it.
        is_ready: it has started.
        task: what it is running; None when nothing.
        spent_s: since it was started, or given the task, in seconds.
    """

    def __init__(self, function: bytes) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.is_ready, self.spent_s = False, 0.0
        self.task: Task | None = None
        self.process = context.Process(target=_work, args=(theirs, function), daemon=True)
        try:
            _bound_reading(self.connection)
            with single_threaded():
                self.process.start()
        except BaseException:
            self.connection.close()
            raise
        finally:
            theirs.close()

    @property
    def is_free(self) -> bool:
        return self.is_ready and self.task is None

    def give(self, task: Task) -> None:
        self.task, self.spent_s = task, 0.0
        with contextlib.suppress(OSError):  # it has just died, which shows when it is next looked at
            self.connection.send(task)

    def hear(self) -> tuple[bool, Any] | None:
        """Whether it succeeded, and with what; None when there is nothing new.

        Raises:
            EOFError, OSError: it has ended, or stopped in the middle of a message.
        """
        return self.connection.recv() if self.connection.poll() else None

    def end(self) -> int | None:
        """End it; its exit code."""
        self.process.kill()
        self.process.join(timeout=5)  # a process that waits for a dead file server does not even end now
        self.connection.close()
        return self.process.exitcode


class _Clock:
    """Tells the time in which this process was running: where it was stopped (Ctrl-Z), so were its workers."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def tick(self) -> float:
        """Seconds since the last tick, as far as they were not slept through."""
        now = time.monotonic()
        elapsed, self._last = now - self._last, now
        return min(elapsed, 4 * _TICK_S)


def _bound_reading(connection: Connection) -> None:
    """Let nobody wait for ever for the rest of a message whose sender was stopped in the middle of it."""
    with socket.socket(fileno=os.dup(connection.fileno())) as end:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", _MESSAGE_LIMIT_S, 0))


def _ending(code: int | None) -> str:
    """How a process ended, from its exit code."""
    if code == -signal.SIGKILL:
        return f"was killed (SIGKILL), as the system does when the memory runs out. {_FEWER}"
    if code is None:
        return "did not end even when it was killed"
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


def _work(connection: Connection, pickled: bytes) -> None:
    """The life of a worker: says that it is ready, and answers each task until nobody sends any more."""
    begin_child()
    with contextlib.suppress(EOFError, ConnectionError):
        try:
            function = pickle.loads(pickled)
        except Exception as error:
            connection.send((False, _portable(error)))
            return
        connection.send((True, None))
        while True:
            connection.send(_answer(function, connection.recv()))


def _answer(function: Callable[[Any], Any], task: Any) -> tuple[bool, Any]:
    try:
        return True, function(task)
    except Exception as error:
        return False, _portable(error)


def _portable(error: Exception) -> Exception:
    """The error, or its text where it would not survive the trip to the other process."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
