"""The task ``none``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmark.tasks.attempt import Attempt
from benchmark.tasks.bench import Workbench
from benchmark.tasks.task import Looks


@dataclass(frozen=True)
class LookOnly:
    """Localise and touch nothing.

    Task:
        Look and localise.
    Randomisations:
        Those of the drop and of the sensor.
    Success:
        None is asked for: the poses are held against the truth.
    """

    name: str = "none"

    def run(self, bench: Workbench, looks: Looks) -> Iterator[Attempt]:
        """See the class."""
        bench.localize(bench.look(looks.standard()))
        yield from ()
