"""How an attempt of the robot's went, as far as it knows itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from benchmark.world.watch import Watched

Stage = Literal["look", "localize", "plan", "approach", "grip", "lift", "carry", "place", "push", "search", "seat"]
"""Where an attempt can end. ``place`` is only found out by who knows where the piece lies in the end."""


@dataclass(frozen=True)
class Attempt:
    """One attempt.

    Attributes:
        goal: what was attempted: ``pick``, ``push``, ``insert``, or ``look`` for a last look that finds nothing.
        estimate: number of the localised piece that it was about, None where there was none.
        stage: where it ended, None where the robot believes that it succeeded.
        cause: why, in a few words; empty where it succeeded.
        grasp: name of the grasp.
        rejected: where no way was found, how many candidates fell for which reason.
        seconds: simulated time by what the robot did, since the attempt before.
        watched: the worst of all physics steps since the attempt before.
        tries: how often an insertion began.
        wrist_n: largest force that the wrist felt during an insertion.
    """

    goal: str
    estimate: int | None
    stage: Stage | None
    cause: str = ""
    grasp: str | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    watched: Watched = field(default_factory=Watched)
    tries: int = 1
    wrist_n: float = 0.0
