"""What a program with child processes does so that they end with it."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

EXIT_BY_SIGNAL = 128
"""Plus the signal's number: what a shell reports of a process that a signal ended."""

SINGLE_THREADED = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS"), "1")
"""One thread for each process: the sweep itself fills the cores, and sums do not depend on the number of threads.
``LP_NUM_THREADS`` is that of Mesa's software renderer."""

_ENDING = (signal.SIGTERM, signal.SIGHUP)


@contextmanager
def single_threaded() -> Iterator[None]:
    """Give the processes that are started in this block one thread each, unless the user has said how many."""
    added = SINGLE_THREADED.keys() - os.environ.keys()
    os.environ.update((name, SINGLE_THREADED[name]) for name in added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Make SIGTERM and SIGHUP leave the block as an exception, so that children are ended and files closed.

    A second signal ends the process at once; then its children notice by themselves. A signal that is ignored, as
    SIGHUP under ``nohup``, stays so. Does nothing outside the main thread, where Python forbids it.

    Raises:
        SystemExit: with 143 on SIGTERM and 129 on SIGHUP.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in _ENDING}
    end = _Ending()
    for number, handler in before.items():
        if handler is signal.SIG_DFL:
            signal.signal(number, end)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Ending:
    """Answers the signals: raises, or lets a server end in order that answers SIGTERM by itself."""

    def __init__(self) -> None:
        self._first: int | None = None

    def __call__(self, number: int, _: FrameType | None) -> None:
        self._first = self._first or number
        server = signal.getsignal(signal.SIGTERM)
        if callable(server) and server is not self:
            signal.raise_signal(signal.SIGTERM)  # uvicorn knows no SIGHUP; it sends SIGTERM here when it is done
            return
        for ending in _ENDING:
            signal.signal(ending, signal.SIG_DFL)
        raise SystemExit(EXIT_BY_SIGNAL + self._first)
