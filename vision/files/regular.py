"""Only regular files are read: a pipe without a writer, or a device, would be waited for without end."""

from __future__ import annotations

from pathlib import Path

from vision.errors import InputError


def check_regular(path: Path) -> Path:
    """The path, once it is known not to be a directory, a pipe or a device; a file that is missing is not judged.

    Raises:
        InputError: it is one of these.
    """
    if path.exists() and not path.is_file():
        raise InputError(str(path), got="a directory, a pipe or a device", expected="a regular file")
    return path
