"""How a program answers Ctrl-C: at once, or in order where there is something to finish; never not at all.

Python raises KeyboardInterrupt wherever it happens to be. In the middle of an import that leaves a library half
loaded, which then fails in its own words, or the library swallows it and the program goes on.
"""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import CodeType, FrameType

EXIT_INTERRUPTED = 130
"""What a shell reports of a program that Ctrl-C ended."""

_RETRY_S = 0.05
_PATIENCE_S = 1.0
_FAREWELL = b"focalpick: stopped\n"
_SWALLOWING = ("<frozen importlib._bootstrap>", *(f"{os.sep}{name}{os.sep}" for name in ("numba", "llvmlite")))
"""Whose code may not be left by such an exception: an import is left half done, or swallows it, and Numba and LLVM
call back from C, where it is only printed, or becomes a SystemError."""


def end_at_once() -> None:
    """Let Ctrl-C end the process from now on, without clean-up: there is nothing to lose, and nobody to swallow it.

    Where Ctrl-C is ignored, as in a background job, or answered by somebody else, it stays so. Does nothing outside
    the main thread, where Python forbids it.
    """
    main = threading.current_thread() is threading.main_thread()
    if main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)


@contextmanager
def ended_in_order() -> Iterator[None]:
    """Let Ctrl-C leave this block as a KeyboardInterrupt, though not where that would be swallowed.

    When it has had its time and is pressed again, it ends the process at once. What comes sooner is impatience.
    Does nothing without :func:`end_at_once`: whoever calls from a program of his own has his own answer.
    """
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is not _end:
        yield
        return

    pressed_at: float | None = None

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal pressed_at
        again = frame is not None and frame.f_code is _send_again.__code__
        if pressed_at is not None and not again:
            if time.monotonic() > pressed_at + _PATIENCE_S:
                _end()
            return
        pressed_at = pressed_at or time.monotonic()
        if not put_off(number, frame):
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, _end)


def ignore_interrupts() -> None:
    """Let an impatient second Ctrl-C not disturb the way out, which would print a traceback."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def put_off(number: int, frame: FrameType | None) -> bool:
    """Whether a signal came where an exception would be swallowed; then it comes again a little later.

    That is in the middle of an import, while a kernel is compiled, and in a ``__del__``.

    Args:
        number: the signal.
        frame: what it has interrupted.
    """
    while frame is not None and not _swallows(frame.f_code):
        frame = frame.f_back
    if frame is None:
        return False
    signal.signal(signal.SIGALRM, functools.partial(_send_again, number))
    signal.setitimer(signal.ITIMER_REAL, _RETRY_S)
    return True


def _send_again(number: int, *_: object) -> None:
    signal.raise_signal(number)


def _swallows(code: CodeType) -> bool:
    return code.co_name == "__del__" or any(part in code.co_filename for part in _SWALLOWING)


def _end(*_: object) -> None:
    with contextlib.suppress(OSError):  # not `print`, in the middle of which this may be
        os.write(2, _FAREWELL)
    os._exit(EXIT_INTERRUPTED)
