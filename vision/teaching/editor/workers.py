"""Runs what is slow in processes of its own, so that a click is answered at once meanwhile."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from typing import Any, TypeVar

from vision.errors import ResourceError
from vision.teaching.editor.child_process import begin_child, start_resource_tracker, uninterrupted

T = TypeVar("T")
Report = Callable[[Any], object]
Message = tuple[bool, Any]
"""Whether the function has ended; if not, what it reports."""


class StoppedError(Exception):
    """The person stopped what was running."""


class Worker:
    """One process that runs one function at a time, reports on its progress, and can be stopped between reports."""

    def __init__(self) -> None:
        """The process starts with the first task."""
        start_resource_tracker()
        self._context = multiprocessing.get_context("spawn")
        self._messages: Queue[Message | None] = self._context.Queue()
        self._stop, self._end = self._context.Event(), self._context.Event()
        self._executor = self._start()
        self._hear: Callable[[Message], object] | None = None
        threading.Thread(target=self._listen, name="reports", daemon=True).start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, self._context, _begin, (self._messages, self._stop, self._end))

    async def run(self, function: Callable[..., T], *arguments: Any, on_report: Report | None = None) -> T:
        """Run ``function(*arguments)`` there; with a listener also ``report=``, to be called with any value.

        Args:
            function: importable by name.
            arguments: that can be pickled.
            on_report: called in this event loop with what the function reports, and no more once this returns.

        Raises:
            StoppedError: when :meth:`stop` or :meth:`close` was called.
            ResourceError: when the process was ended from outside, as for want of memory.
            Exception: what the function raises.
        """
        loop = asyncio.get_running_loop()
        ended = asyncio.Event()

        def hear(message: Message) -> None:
            done, value = message
            if done:
                ended.set()
            elif on_report is not None:
                on_report(value)

        self._stop.clear()
        self._hear = lambda message: loop.call_soon_threadsafe(hear, message)
        try:
            with uninterrupted():  # the first task starts the process
                answer = loop.run_in_executor(self._executor, _call, function, arguments, on_report is not None)
            result = await answer
        except BrokenProcessPool:
            if self._end.is_set():
                raise StoppedError from None
            self._executor = self._start()
            raise ResourceError("background process: got ended from outside; expected enough memory") from None
        except Exception:
            await ended.wait()
            raise
        await ended.wait()
        return result

    def stop(self) -> None:
        """Make the running function end at its next report."""
        self._stop.set()

    def close(self) -> None:
        """End the process at once, whatever it is doing: Ctrl-C must not wait for a kernel to be compiled."""
        self._end.set()
        self._hear = None
        self._executor.shutdown(wait=False, cancel_futures=True)
        self._messages.put(None)

    def _listen(self) -> None:
        while (message := self._messages.get()) is not None:
            hear = self._hear
            if hear is not None:
                hear(message)


_messages: Queue[Message | None]
_stop: Event


def _begin(messages: Queue[Message | None], stop: Event, end: Event) -> None:
    """Settle the new process: it ends with its parent or when it is told to, and leaves Ctrl-C to the parent."""
    global _messages, _stop
    begin_child()
    threading.Thread(target=_end_when_told, args=(end,), name="end", daemon=True).start()
    _messages, _stop = messages, stop
    import cv2

    cv2.setNumThreads(1)


def _end_when_told(end: Event) -> None:
    end.wait()
    os._exit(0)


def _call(function: Callable[..., T], arguments: tuple[Any, ...], reporting: bool) -> T:
    try:
        return function(*arguments, report=_report) if reporting else function(*arguments)
    finally:
        _messages.put((True, None))


def _report(value: Any) -> None:
    if _stop.is_set():
        raise StoppedError
    _messages.put((False, value))
