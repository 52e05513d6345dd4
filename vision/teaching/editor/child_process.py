"""Ties a process to the one that started it, so that none is left when that one is killed.

A pool's process waits for work at a pipe of which it holds both ends itself, so it does not notice that nobody will
ever send any. ``multiprocessing`` also gives each child one end of a pipe whose other end only the parent holds; the
system closes that other end however the parent ends, SIGKILL included.

Linux's PR_SET_PDEATHSIG is no substitute: it acts when the parent's thread ends that started the child.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
from multiprocessing.connection import wait

EXIT_ORPHANED = 1


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
    threading.Thread(target=_outlive, args=(parent.sentinel,), name="end with parent", daemon=True).start()


def _outlive(sentinel: int) -> None:
    wait([sentinel])
    # sys.exit would only end this thread, and a clean end could wait for the parent's pipes for ever.
    os._exit(EXIT_ORPHANED)
