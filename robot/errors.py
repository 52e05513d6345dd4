"""What can go wrong when poses become motion."""

from __future__ import annotations

from vision.errors import InputError


class UnreachableError(InputError):
    """A pose that the arm cannot take, or a path that it cannot follow."""
