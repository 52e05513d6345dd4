"""What can go wrong in the simulated world."""

from __future__ import annotations

from vision.errors import InputError


class PhysicsError(InputError):
    """The simulation cannot go on: the episode fails, the next one may not."""
