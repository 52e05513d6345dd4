"""Where Numba keeps the compiled kernels: one folder for each state of the sources.

Numba looks for changes in the file of a kernel alone, not in the files of the kernels that it calls. After an update
that touches one of those it would go on with the old machine code, and figures would differ without a word. So the
folder's name holds a digest of all sources, wherever the folder is.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from vision.errors import ResourceError

_VARIABLE = "NUMBA_CACHE_DIR"
_PREFIX = "kernels-"
_WITHOUT_COMPILER = "NUMBA_DISABLE_JIT"
_THREADS = "NUMBA_NUM_THREADS"

ANEW = f"no folder can keep compiled kernels, so that every run compiles them anew: set {_VARIABLE} to one"
"""What to tell the user where :func:`is_kept` is False."""


def settle() -> None:
    """Point Numba to the folder of these sources: where the user says, in the package, or in the user's cache.

    Where none of them can be written it is a temporary one, which this process and its children share.
    """
    for variable in (_WITHOUT_COMPILER, _THREADS):
        if _whole_number(variable) is None:  # Numba would print a traceback of that in every process, and go on
            os.environ.pop(variable, None)
    package = Path(__file__).resolve().parent
    name = f"{_PREFIX}{digest(package)}"
    root = next((root for root in _roots(package) if can_be_written(root)), None) or _lent()
    if root is None:  # which matters as soon as somebody needs a kernel: see `require`
        os.environ.pop(_VARIABLE, None)
        return
    os.environ[_VARIABLE] = str(root / name)
    numba = sys.modules.get("numba")
    if numba is not None:  # it has read its environment already
        numba.config.reload_config()


def require() -> None:
    """Make sure that kernels can be compiled; call it before any module with kernels is imported.

    Raises:
        ResourceError: the user has told Numba not to compile or to use no thread, or no folder can be written.
    """
    if _whole_number(_WITHOUT_COMPILER):
        raise ResourceError(
            f"compiler of the vision kernels: got {_WITHOUT_COMPILER}={os.environ[_WITHOUT_COMPILER]}; expected one "
            f"that is not switched off. Run: unset {_WITHOUT_COMPILER}"
        )
    threads = _whole_number(_THREADS)
    if threads is not None and threads < 1:
        raise ResourceError(
            f"threads for the vision kernels: got {_THREADS}={threads}; expected 1 or more. Run: unset {_THREADS}"
        )
    if folder() is None:
        raise ResourceError(
            f"folder for compiled kernels: got none that can be written, in the package, below HOME or for temporary "
            f"files; expected one. Set {_VARIABLE} to a folder that you may write to"
        )


def _whole_number(variable: str) -> int | None:
    """What Numba reads in a variable; None where it goes on as if that were not set."""
    try:
        return int(os.environ[variable])
    except (KeyError, ValueError):
        return None


def is_kept() -> bool:
    """Whether what this process compiles is there for the next one, too."""
    return not _temporary_roots


def folder() -> Path | None:
    """Where :func:`settle` has pointed Numba to."""
    asked = os.environ.get(_VARIABLE)
    return Path(asked) if asked and Path(asked).name.startswith(_PREFIX) else None


def digest(package: Path) -> str:
    """Twelve hexadecimal digits that change with any source file of a package and of the rooms in it."""
    total = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        total.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:12]


def _roots(package: Path) -> Iterator[Path]:
    """Folders to keep kernels in, best first."""
    if asked := os.environ.get(_VARIABLE):
        # A parent process has settled already; its folder's name is the one to replace, not to add to.
        yield Path(asked).parent if Path(asked).name.startswith(_PREFIX) else Path(asked)
    yield package / "__pycache__"
    yield from user_folders()


def user_folders() -> Iterator[Path]:
    """Folders for what this user can make again, best first: in the user's cache, else beside the temporary files."""
    if cache := os.environ.get("XDG_CACHE_HOME"):
        yield Path(cache) / "focalpick"
    if (home := _home()) is not None:
        yield home / ".cache" / "focalpick"
    if (temporary := _temporary_directory()) is not None:
        yield temporary / f"focalpick-{os.getuid() if hasattr(os, 'getuid') else 'user'}"


def _home() -> Path | None:
    """The user's home; a user without a name, as in a container, need not have one."""
    if "HOME" in os.environ:
        return Path(os.environ["HOME"]) if os.environ["HOME"] else None
    try:
        return Path.home()
    except RuntimeError:
        return None


def can_be_written(root: Path) -> bool:
    """Whether this user can keep files in a folder; makes it where it is missing.

    In a shared place only a folder of one's own is trusted: nobody should run machine code that another user left.
    """
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        mine = not hasattr(os, "getuid") or root.stat().st_uid == os.getuid()
    except OSError:
        return False
    shared = root.parent == _temporary_directory()
    return os.access(root, os.W_OK | os.X_OK) and (mine or not shared)


_temporary_roots: list[Path] = []


def _lent() -> Path | None:
    """A folder that is gone after this process; None where there is no place for temporary files."""
    try:
        root = Path(tempfile.mkdtemp(prefix="focalpick-"))
    except OSError:
        return None
    _temporary_roots.append(root)
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return root


def _temporary_directory() -> Path | None:
    try:
        return Path(tempfile.gettempdir())
    except OSError:  # not even the working directory can be written
        return None
