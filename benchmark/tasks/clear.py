"""The task ``clear``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from benchmark.tasks.attempt import Attempt
from benchmark.tasks.bench import Sight, Workbench
from benchmark.tasks.memory import Belief
from benchmark.tasks.task import Looks
from robot.grasps import GraspChoice
from robot.placing import Placing


@dataclass(frozen=True)
class Clear:
    """Empty the bin.

    Task:
        Look, localise, pick a piece, put it down on a free spot in the tray; go on with those that cannot have moved
        meanwhile, and look again when there are none, until nothing is found any more.
        Where nothing is found or nothing can be gripped, look again from other viewpoints and use all pictures
        together. Of what cannot be gripped even then, tip over what stands on edge; leave the rest, with the reasons.
    Randomisations:
        Those of the drop and of the sensor: where the pieces lie, light, marks, calibration.
    Success:
        Every piece lies in the tray, let go of.

    Attributes:
        most_failures: attempts in vain after each other, after which the robot gives up.
        most_pushes: pieces tipped over after each other, after which what cannot be gripped is left.
        most_attempts: attempts in all.
    """

    name: str = "clear"
    most_failures: int = 4
    most_pushes: int = 4
    most_attempts: int = 24

    def run(self, bench: Workbench, looks: Looks) -> Iterator[Attempt]:
        """See the class."""
        belief, failures, pushes = Belief(), 0, 0
        for _ in range(self.most_attempts):
            choice = bench.plan(belief) if belief.certain else None
            if choice is None or choice.plan is None:
                sight = bench.look(looks.standard())
                belief, choice = self._understood(bench, belief, sight)
                if choice.plan is None:
                    sight = sight.and_also(bench.look(looks.again()))
                    belief, choice = self._understood(bench, belief, sight)
            if not belief.known:
                yield bench.attempt("look", None)  # for what is left, and nothing is
                return
            tip = bench.plan_tip(belief, pushes) if choice.plan is None and pushes < self.most_pushes else None
            if tip is not None:
                pushes += 1
                yield bench.tip(belief, tip)
                belief = belief.failed(tip.piece)
                continue
            attempt, belief = bench.pick(belief, choice)
            yield attempt
            failures, pushes = (0, 0) if attempt.stage is None else (failures + 1, pushes)
            if choice.plan is None or failures == self.most_failures:
                return

    def _understood(self, bench: Workbench, belief: Belief, sight: Sight) -> tuple[Belief, GraspChoice[Placing]]:
        belief = belief.seen(bench.localize(sight).estimates, bench.diameter_m)
        return belief, bench.plan(belief)
