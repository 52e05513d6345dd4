"""What a task is, and which there are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from benchmark.tasks.attempt import Attempt
from benchmark.tasks.bench import Viewpoints, Workbench
from vision.frozen import frozen_arrays


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Looks:
    """Where the bin is photographed from.

    Attributes:
        standard: gives the viewpoints of a first look.
        again: gives other viewpoints, more of them or steeper, for a second look at the same scene.
    """

    standard: Callable[[], Viewpoints]
    again: Callable[[], Viewpoints]


class Task(Protocol):
    """Something to do at a workbench."""

    @property
    def name(self) -> str:
        """As it is called on the command line."""
        ...

    def run(self, bench: Workbench, looks: Looks) -> Iterator[Attempt]:
        """Do it; hands out every attempt when it is over, so that it can be judged before the next begins."""
        ...
