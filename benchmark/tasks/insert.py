"""The task ``insert``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmark.tasks.attempt import Attempt
from benchmark.tasks.bench import Workbench
from benchmark.tasks.memory import Belief
from benchmark.tasks.task import Looks


@dataclass(frozen=True)
class Insert:
    """Put a peg into the bore of a piece in the bin.

    Task:
        Look, localise, take the piece whose bore is most upright, come to a few millimetres above it, feel for the
        face, search in a spiral and press the peg in, always giving way to forces. After a failure look again, from
        more sides, and try once more.
    Randomisations:
        Those of the drop and of the sensor: where the pieces lie, light, marks, calibration. The pieces are free.
    Success:
        The peg's tip is as deep in the bore as asked for, on its axis within the clearance, and no force that the
        wrist felt was above the limit.

    Attributes:
        most_looks: how often to look and try.
    """

    name: str = "insert"
    most_looks: int = 2

    def run(self, bench: Workbench, looks: Looks) -> Iterator[Attempt]:
        """See the class."""
        belief = Belief()
        for number in range(self.most_looks):
            sight = bench.look(looks.standard())
            if number:
                sight = sight.and_also(bench.look(looks.again()))
            belief = belief.seen(bench.localize(sight).estimates, bench.diameter_m)
            attempt = bench.insert(belief)
            yield attempt
            bench.withdraw()
            if attempt.stage is None:
                return
