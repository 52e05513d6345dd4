"""The task ``pick``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmark.tasks.attempt import Attempt
from benchmark.tasks.bench import Workbench
from benchmark.tasks.memory import Belief
from benchmark.tasks.task import Looks


@dataclass(frozen=True)
class Pick:
    """Take one piece.

    Task:
        Look, localise, pick the piece that is held most safely, and put it down in the tray. Once.
    Randomisations:
        Those of the drop and of the sensor: where the pieces lie, light, marks, calibration.
    Success:
        After the lift both fingers press on the piece, and in the end it lies in the tray, let go of. Physics alone
        holds it.
    """

    name: str = "pick"

    def run(self, bench: Workbench, looks: Looks) -> Iterator[Attempt]:
        """See the class."""
        found = bench.localize(bench.look(looks.standard()))
        belief = Belief().seen(found.estimates, bench.diameter_m)
        yield bench.pick(belief, bench.plan(belief))[0]
