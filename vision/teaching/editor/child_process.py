"""Ties a process to the one that started it, so that none is left when that one is killed, or when it is interrupted.

A pool's process waits for work at a pipe of which it holds both ends itself, so it does not notice that nobody will
ever send any. ``multiprocessing`` also gives each child one end of a pipe whose other end only the parent holds; the
system closes that other end however the parent ends, SIGKILL included. A child that is stopped does not notice even
that; Linux can be asked to kill it.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import wait
from pathlib import Path

EXIT_ORPHANED = 1
_STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PR_SET_PDEATHSIG = 1
_QUIETLY = "ignore:resource_tracker"


def start_resource_tracker() -> None:
    """Start multiprocessing's resource tracker before the first child would, which may be while signals are blocked.

    It unblocks them. It says nothing of what it removes after a program that was killed: nobody need do anything.
    """
    sys.warnoptions.append(_QUIETLY)
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.remove(_QUIETLY)


def begin_child() -> None:
    """Settle this process, a child of ``multiprocessing``: it ends with its parent, and leaves Ctrl-C to it.

    A terminal sends Ctrl-C to all processes, but only the parent is to answer it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _STOPPING)  # the parent started it in `uninterrupted`
    end_with_parent()


def end_with_parent() -> None:
    """Make this process, a child of ``multiprocessing``, end at once when its parent has ended; call it first.

    What is running is cut off, without clean-up: its result has no receiver. ``multiprocessing``'s resource tracker
    ends by itself after the last process that it serves, and removes what they leave.

    Raises:
        RuntimeError: ``multiprocessing`` did not start this process.
    """
    parent = multiprocessing.parent_process()
    if parent is None:
        raise RuntimeError("this process has no parent in multiprocessing")
    if _is_of_main_thread():
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
    threading.Thread(target=_outlive, args=(parent.sentinel,), name="end with parent", daemon=True).start()


def _is_of_main_thread() -> bool:
    """Whether the parent's main thread has started this process; only Linux knows.

    PR_SET_PDEATHSIG acts when the thread ends that started the child, and of others than the main one that does not
    mean the end of the parent.
    """
    parent = os.getppid()
    with contextlib.suppress(OSError):
        return str(os.getpid()) in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return False


def _outlive(sentinel: int) -> None:
    wait([sentinel])
    # sys.exit would only end this thread, and a clean end could wait for the parent's pipes for ever.
    os._exit(EXIT_ORPHANED)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off Ctrl-C, SIGTERM and SIGHUP until the block is left.

    A process that is started in it does not hear them before it unblocks them, so that none ends with a traceback
    because it was interrupted while it starts: it calls :func:`begin_child`. Call
    :func:`start_resource_tracker` before. Does nothing outside the main thread.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[int] = []
    before = {number: signal.getsignal(number) for number in _STOPPING}
    for number, handler in before.items():
        if handler not in (signal.SIG_IGN, None):  # blocking alone is not enough: another thread may hear it
            signal.signal(number, lambda heard_number, _: heard.append(heard_number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, _STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        for put_off in heard:
            signal.raise_signal(put_off)
