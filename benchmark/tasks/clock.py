"""Time: what the computer takes, and what the robot takes in the simulated world."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class Clock:
    """Adds up wall time by stage of the episode, and simulated time by what the robot does.

    Attributes:
        wall_s: wall time in s by stage.
    """

    def __init__(self) -> None:
        """Begin at zero; simulated time is counted from `follow` on."""
        self.wall_s: dict[str, float] = {}
        self._simulated_s: dict[str, float] = {}
        self._now: Callable[[], float] = lambda: 0.0

    def follow(self, now: Callable[[], float]) -> None:
        """Take simulated time from there."""
        self._now = now

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the wall time of a block to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.wall_s[name] = self.wall_s.get(name, 0.0) + time.perf_counter() - start

    @contextmanager
    def doing(self, name: str) -> Iterator[None]:
        """Add the simulated time of a block to what the robot does in it."""
        start = self._now()
        try:
            yield
        finally:
            self._simulated_s[name] = self._simulated_s.get(name, 0.0) + self._now() - start

    def take_simulated_s(self) -> dict[str, float]:
        """Simulated time in s by what was done since the last call."""
        taken, self._simulated_s = self._simulated_s, {}
        return {name: round(seconds, 6) for name, seconds in taken.items()}
