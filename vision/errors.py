"""The error tree of focalpick: every message says what was got, what was expected and what to do."""

from __future__ import annotations


class FocalpickError(Exception):
    """Base of all errors that a user of focalpick is meant to see as one line."""


class InputError(FocalpickError, ValueError):
    """An argument, image or file that cannot be used."""

    def __init__(self, what: str, *, got: object, expected: object, do: str = "") -> None:
        """Compose the message.

        Args:
            what: the thing that is wrong, for example ``"part"``.
            got: what was received.
            expected: what would have been accepted.
            do: the remedy, as an imperative sentence.
        """
        self.what, self.got, self.expected, self.do = what, got, expected, do
        super().__init__(f"{what}: got {got}; expected {expected}" + (f". {do}" if do else ""))

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the trip from a worker process (keyword-only arguments do not by default)."""
        return (_rebuild, (type(self), self.what, self.got, self.expected, self.do))


class FileFormatError(InputError):
    """A file that is corrupt, of the wrong version, or not what its name says."""


class ResourceError(FocalpickError):
    """Something the machine does not have: OpenGL, a mesh, disk space."""


def _rebuild(cls: type[InputError], what: str, got: object, expected: object, do: str) -> InputError:
    return cls(what, got=got, expected=expected, do=do)
