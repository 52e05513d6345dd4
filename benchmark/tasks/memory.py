"""What the robot believes: which pieces lie where, and where it has put others down.

Vision and the robot's own deeds change it, the simulator never does.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from vision.pose.estimate import PoseEstimate

SAME_PLACE_DIAMETERS = 0.2
"""A piece that is seen again this near to where it was, in diameters, has not moved."""
UNTOUCHED_DIAMETERS = 1.3
"""Pieces whose origins are farther apart than this did not touch each other."""


@dataclass(frozen=True, eq=False)
class Known:
    """A piece that was seen.

    Attributes:
        estimate: where it lies, as far as the pictures tell.
        failures: how often the robot tried to take it from there in vain.
        doubtful: whether it may have moved since it was seen.
        number: of the estimate in the localisation that it comes from.
    """

    estimate: PoseEstimate
    failures: int = 0
    doubtful: bool = False
    number: int = 0


@dataclass(frozen=True, eq=False)
class Placed:
    """A piece that was put down.

    Attributes:
        part: its type.
        T_world_part: where it was let go.
        flat: whether it was laid down flat; otherwise it fell over, to one side or another.
    """

    part: str
    T_world_part: RigidTransform
    flat: bool


@dataclass(frozen=True, eq=False)
class Belief:
    """The state of the cell as the robot sees it.

    Attributes:
        known: the pieces in the bin, as last seen.
        placed: the pieces in the tray, in the order in which they were put down.
        looks: how often the bin was looked at.
    """

    known: tuple[Known, ...] = ()
    placed: tuple[Placed, ...] = field(default=())
    looks: int = 0

    @property
    def estimates(self) -> tuple[PoseEstimate, ...]:
        """Where the known pieces lie."""
        return tuple(known.estimate for known in self.known)

    def seen(self, estimates: tuple[PoseEstimate, ...], diameter_m: float) -> Belief:
        """After a look: what was seen takes the place of what was known; failures stay with what did not move.

        Args:
            estimates: what was localised.
            diameter_m: of the largest part.
        """
        near_m = SAME_PLACE_DIAMETERS * diameter_m
        known = tuple(Known(e, self._failures(e, near_m), number=number) for number, e in enumerate(estimates))
        return replace(self, known=known, looks=self.looks + 1)

    def failed(self, index: int) -> Belief:
        """After an attempt in vain at a known piece, which still lies in the bin; everything may have moved."""
        known = self.known[index]
        changed = replace(known, failures=known.failures + 1)
        every = (*self.known[:index], changed, *self.known[index + 1 :])
        return replace(self, known=tuple(replace(known, doubtful=True) for known in every))

    def taken(self, index: int, diameter_m: float) -> Belief:
        """After a known piece was lifted out of the bin: what lay so near that it may have touched it is in doubt."""
        gone = self.known[index].estimate.T_world_part.translation
        near_m = UNTOUCHED_DIAMETERS * diameter_m
        left = [known for number, known in enumerate(self.known) if number != index]
        apart = [float(np.linalg.norm(known.estimate.T_world_part.translation - gone)) for known in left]
        doubt = (replace(k, doubtful=k.doubtful or d < near_m) for k, d in zip(left, apart, strict=True))
        return replace(self, known=tuple(doubt))

    @property
    def certain(self) -> bool:
        """Whether any known piece certainly lies where it was seen."""
        return any(not known.doubtful for known in self.known)

    def put(self, placed: Placed) -> Belief:
        """After a piece was let go in the tray."""
        return replace(self, placed=(*self.placed, placed))

    def _failures(self, estimate: PoseEstimate, near_m: float) -> int:
        """How often the piece that lay here was tried in vain."""
        here = estimate.T_world_part.translation
        return max(
            (
                known.failures
                for known in self.known
                if np.linalg.norm(known.estimate.T_world_part.translation - here) < near_m
            ),
            default=0,
        )
