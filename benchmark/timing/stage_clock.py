"""Times the stages of a computation where it runs: their functions keep time while the clock is on."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType

Place = tuple[object, str]
"""A module or a class, and the name of a function in it."""


@dataclass(frozen=True)
class Call:
    """One call of a stage's function: when it began, by ``time.perf_counter``, and how long it took."""

    stage: str
    start_s: float
    seconds: float


class StageClock:
    """A context in which calls of some functions are timed; outside it they are what they were.

    Attributes:
        calls: in the order in which they ended; a call within another one counts in both.
    """

    def __init__(self, stages: Mapping[str, Sequence[Place]]) -> None:
        """Prepare.

        Args:
            stages: by name, the functions that a stage is made of, where their callers look them up.
        """
        self.calls: list[Call] = []
        self._stages = stages
        self._replaced: list[tuple[object, str, object]] = []

    def __enter__(self) -> StageClock:
        """Put timed functions in place of the stages' own."""
        for stage, places in self._stages.items():
            for owner, name in places:
                original = vars(owner)[name]
                self._replaced.append((owner, name, original))
                setattr(owner, name, self._timed(stage, original))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put the stages' own functions back."""
        while self._replaced:
            owner, name, original = self._replaced.pop()
            setattr(owner, name, original)

    def seconds(self, stage: str, before_s: float = float("inf")) -> float:
        """Time spent in the calls of a stage, of those that began before some time."""
        return sum(call.seconds for call in self.calls if call.stage == stage and call.start_s < before_s)

    def _timed(self, stage: str, original: object) -> object:
        """The function, class method or static method with a clock around it."""
        if isinstance(original, (classmethod, staticmethod)):
            return type(original)(self._timed_function(stage, original.__func__))
        if not callable(original):
            raise TypeError(f"stage {stage}: {original!r} is no function")
        return self._timed_function(stage, original)

    def _timed_function(self, stage: str, function: Callable[..., object]) -> Callable[..., object]:
        @functools.wraps(function)
        def timed(*arguments: object, **options: object) -> object:
            start = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                self.calls.append(Call(stage, start, time.perf_counter() - start))

        return timed
