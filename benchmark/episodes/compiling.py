"""Lets one process compile the vision kernels of a fresh install, so that the others find them in the cache.

Which kernels an episode needs nobody has to list: the first episode runs alone. A note in the folder of the kernels
then says that this has been done, for this version of the sources, this Numba and this processor.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import BinaryIO

from vision import kernel_cache

LIMIT_S = 1200.0
"""How long compiling may take, in seconds; on a busy machine it takes many times the usual minute."""
_LOCK = "compiling.lock"
_PAUSE_S = 0.5


def is_done(localizer: str) -> bool:
    """Whether what a localizer needs has been compiled; a kernel that is missing nevertheless costs time alone."""
    folder = kernel_cache.folder()
    return folder is not None and (folder / _note(localizer)).exists()


def note_done(localizer: str) -> None:
    """Note that what a localizer needs is compiled."""
    if (folder := kernel_cache.folder()) is not None:
        with contextlib.suppress(OSError):  # it is compiled all the same
            folder.mkdir(parents=True, exist_ok=True)
            (folder / _note(localizer)).touch()


@contextlib.contextmanager
def alone(on_wait: Callable[[], None]) -> Iterator[None]:
    """Wait until no other process is in this block, but no longer than compiling may take.

    Args:
        on_wait: called once where there is another one.
    """
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            _lock(stack.enter_context(_open_lock()), on_wait)
        yield


def _open_lock() -> BinaryIO:
    if (folder := kernel_cache.folder()) is None:
        raise FileNotFoundError
    folder.mkdir(parents=True, exist_ok=True)
    return open(folder / _LOCK, "wb")


def _lock(file: BinaryIO, on_wait: Callable[[], None]) -> None:
    """Wait for a lock.

    Raises:
        OSError: the file system has none.
    """
    deadline = time.monotonic() + LIMIT_S
    told = False
    while time.monotonic() < deadline:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise
        else:
            return
        if not told:
            on_wait()
        told = True
        time.sleep(_PAUSE_S)


def _note(localizer: str) -> str:
    import llvmlite.binding
    import numba

    machine = [numba.__version__, sys.version, llvmlite.binding.get_host_cpu_name()]
    asked = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith("NUMBA_CPU_")]
    return "compiled-" + hashlib.sha256("\0".join([localizer, *machine, *asked]).encode()).hexdigest()[:12]
