"""Runs what is slow in processes of its own, so that a click is answered at once meanwhile."""

from __future__ import annotations

import asyncio
import multiprocessing
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

T = TypeVar("T")
Report = Callable[[Any], object]


class StoppedError(Exception):
    """The person stopped what was running."""


class Worker:
    """One process that runs one function at a time, reports on its progress, and can be stopped between reports."""

    def __init__(self) -> None:
        """The process starts with the first task."""
        context = multiprocessing.get_context("spawn")
        self._reports: Queue[Any] = context.Queue()
        self._stop = context.Event()
        self._executor = ProcessPoolExecutor(1, context, _begin, (self._reports, self._stop))
        self._on_report: Callable[[Any], object] | None = None
        self._listener = threading.Thread(target=self._listen, name="reports", daemon=True)
        self._listener.start()

    async def run(self, function: Callable[..., T], *arguments: Any, on_report: Report | None = None) -> T:
        """Run ``function(*arguments)`` there; with a listener also ``report=``, to be called with any value.

        Args:
            function: importable by name.
            arguments: that can be pickled.
            on_report: called in this event loop with what the function reports.

        Raises:
            StoppedError: when :meth:`stop` was called.
            Exception: what the function raises.
        """
        loop = asyncio.get_running_loop()
        self._stop.clear()
        self._on_report = None if on_report is None else lambda value: loop.call_soon_threadsafe(on_report, value)
        return await loop.run_in_executor(self._executor, _call, function, arguments, on_report is not None)

    def stop(self) -> None:
        """Make the running function end at its next report."""
        self._stop.set()

    def close(self) -> None:
        """End the process; a running function ends at its next report."""
        self._stop.set()
        self._executor.shutdown(wait=False, cancel_futures=True)
        self._reports.put(None)

    def _listen(self) -> None:
        while (value := self._reports.get()) is not None:
            if self._on_report:
                self._on_report(value)


_reports: Queue[Any]
_stop: Event


def _begin(reports: Queue[Any], stop: Event) -> None:
    """Settle the new process: it leaves Ctrl-C to its parent."""
    global _reports, _stop
    _reports, _stop = reports, stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    import cv2

    cv2.setNumThreads(1)


def _call(function: Callable[..., T], arguments: tuple[Any, ...], reporting: bool) -> T:
    return function(*arguments, report=_report) if reporting else function(*arguments)


def _report(value: Any) -> None:
    if _stop.is_set():
        raise StoppedError
    _reports.put(value)
