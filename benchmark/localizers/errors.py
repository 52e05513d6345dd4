"""The error of code that is the user's and not focalpick's; apart from that code, so that it is quickly imported."""

from __future__ import annotations

from vision.errors import InputError


class LocalizerError(InputError):
    """A user's localizer that cannot be used; its cause, where there is one, is what the user's code raised."""
