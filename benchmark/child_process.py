"""What a program with child processes does so that they end with it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from vision.teaching.editor.child_process import end_with_parent

EXIT_BY_SIGNAL = 128
"""Plus the signal's number: what a shell reports of a process that a signal ended."""

_ENDING = (signal.SIGTERM, signal.SIGHUP)


def begin_worker() -> None:
    """Settle a worker of a sweep.

    It ends with its parent. A terminal sends Ctrl-C to all processes, but only the sweep itself is to answer it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()


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
