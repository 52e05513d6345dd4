"""Where Numba keeps the compiled kernels: one folder for each state of the sources.

Numba looks for changes in the file of a kernel alone, not in the files of the kernels that it calls. After an update
that touches one of those it would go on with the old machine code, and figures would differ without a word.
"""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"


def settle() -> None:
    """Point Numba to the folder of these sources; a folder that the user has named is left alone."""
    package = Path(__file__).resolve().parent
    cache = package / "__pycache__"
    writable = os.access(cache if cache.exists() else package, os.W_OK)
    if _VARIABLE not in os.environ and writable:
        os.environ[_VARIABLE] = str(cache / f"kernels-{digest(package)}")
        numba = sys.modules.get("numba")
        if numba is not None:  # it has read its environment already
            numba.config.reload_config()


def digest(package: Path) -> str:
    """Twelve hexadecimal digits that change with any source file of a package and of the rooms in it."""
    total = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        total.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:12]
