"""Where Numba keeps the compiled kernels: one folder for each state of the sources.

Numba looks for changes in the file of a kernel alone, not in the files of the kernels that it calls. After an update
that touches one of those it would go on with the old machine code, and figures would differ without a word. So the
folder's name holds a digest of all sources, wherever the folder is.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"
_PREFIX = "kernels-"


def settle() -> None:
    """Point Numba to the folder of these sources: where the user says, in the package, or in the user's cache."""
    package = Path(__file__).resolve().parent
    name = f"{_PREFIX}{digest(package)}"
    root = next((root for root in _roots(package) if can_be_written(root)), None)
    if root is None and _temporary() is not None:  # nowhere to keep anything for another time
        root = Path(tempfile.mkdtemp(prefix="focalpick-"))
    if root is None:  # Numba will say so, when the first kernel is needed
        return
    os.environ[_VARIABLE] = str(root / name)
    numba = sys.modules.get("numba")
    if numba is not None:  # it has read its environment already
        numba.config.reload_config()


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
    if (temporary := _temporary()) is not None:
        yield temporary / f"focalpick-{os.getuid() if hasattr(os, 'getuid') else 'user'}"


def _temporary() -> Path | None:
    """Where temporary files go; a container that is read only need not have such a place."""
    try:
        return Path(tempfile.gettempdir())
    except FileNotFoundError:
        return None


def _home() -> Path | None:
    """The user's home; a user without a name, as in a container, need not have one."""
    if "HOME" in os.environ:
        return Path(os.environ["HOME"]) if os.environ["HOME"] else None
    try:
        return Path.home()
    except RuntimeError:
        return None


def can_be_written(folder: Path) -> bool:
    """Whether this user can keep files in a folder; makes it where it is missing.

    In a shared place only a folder of one's own is trusted: nobody should run machine code that another user left.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        mine = not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()
    except OSError:
        return False
    shared = folder.parent == _temporary()
    return os.access(folder, os.W_OK | os.X_OK) and (mine or not shared)
