"""Peg in hole: approach, touch, search, seat; with a limit on every force, and a second try when it jams."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from robot.compliance import Admittance, Spiral
from robot.wrist import Wrench

Array = NDArray[np.float64]
Phase = Literal["touch", "search", "seat", "back_off", "seated", "not_found", "jammed"]
_RESISTS = 0.5  # of the pressing force: a face does
ENDED: tuple[Phase, ...] = ("seated", "not_found", "jammed")


@dataclass(frozen=True)
class InsertionParameters:
    """How a peg is inserted.

    Attributes:
        clearance_m: diametral, between peg and bore.
        depth_m: how deep the peg has to get.
        admittance: how the peg gives way.
        touch_m_s: speed until something is touched.
        touch_n: what counts as a touch.
        search_n: pressed with while searching.
        seat_n: pressed with on the way in.
        most_side_n: force across the axis at which the peg gives way alone and does not search on.
        most_n: force at which it backs off.
        found_m: so much deeper than the first touch, the peg has found the bore.
        search_m: radius of the search.
        search: whether to search at all.
        tries: how often to begin.
        stuck_s: without progress for so long, the peg is jammed.
        low_pass_hz: of what the wrist feels.
    """

    clearance_m: float
    depth_m: float
    admittance: Admittance = field(default_factory=Admittance)
    touch_m_s: float = 0.003
    touch_n: float = 3.0
    search_n: float = 6.0
    seat_n: float = 20.0
    most_side_n: float = 12.0
    most_n: float = 35.0
    found_m: float = 0.0003
    search_m: float = 0.0015
    search: bool = True
    tries: int = 3
    stuck_s: float = 1.5
    low_pass_hz: float = 60.0


class Insertion:
    """The state of one insertion; call `step` once in every time step until `phase` is one of `ENDED`.

    Attributes:
        phase: where it is.
        tries: how often it began.
        most_n: largest force that was felt.
    """

    def __init__(self, parameters: InsertionParameters) -> None:
        """Begin above the bore."""
        self._parameters = parameters
        self.phase: Phase = "touch"
        self._reason: Phase = "jammed"
        self.tries, self.most_n = 1, 0.0
        self._seconds = self._stuck_s = self._spiral_s = 0.0
        self._touched_m = self._deepest_m = 0.0
        self._felt = np.zeros(6)

    def step(self, felt: Wrench, depth_m: float, dt_s: float) -> Array:
        """(6,) velocity of the peg's tip in its own frame.

        Args:
            felt: at the tip, in the tool's frame.
            depth_m: of the tip below the entry as it is believed to be.
            dt_s: length of the time step.
        """
        parameters = self._parameters
        share = 1.0 - np.exp(-2 * np.pi * parameters.low_pass_hz * dt_s)
        self._felt += share * (np.concatenate([felt.force, felt.torque]) - self._felt)
        smooth = Wrench(self._felt[:3].copy(), self._felt[3:].copy())
        self.most_n = max(self.most_n, smooth.force_n)
        self._seconds += dt_s
        if self.phase != "back_off" and smooth.force_n > parameters.most_n:
            self._reason = "jammed"
            self._enter("back_off", depth_m)
        return {"touch": self._touch, "search": self._search, "seat": self._seat, "back_off": self._back_off}[
            self.phase
        ](smooth, depth_m, dt_s)

    def _enter(self, phase: Phase, depth_m: float) -> None:
        self.phase, self._deepest_m = phase, depth_m
        self._seconds = self._stuck_s = self._spiral_s = 0.0

    def _touch(self, felt: Wrench, depth_m: float, dt_s: float) -> Array:  # noqa: ARG002
        if depth_m > self._parameters.found_m + 0.002:  # past the entry without having met anything
            self._enter("seat", depth_m)
        elif -felt.force[2] > self._parameters.touch_n:
            self._touched_m = depth_m
            self._enter("search", depth_m)
        return np.array([0.0, 0.0, self._parameters.touch_m_s, 0.0, 0.0, 0.0])

    def _search(self, felt: Wrench, depth_m: float, dt_s: float) -> Array:
        parameters = self._parameters
        twist = parameters.admittance.twist(felt, parameters.search_n)
        if depth_m > self._touched_m + parameters.found_m:
            self._enter("seat", depth_m)
            return twist
        side = float(np.hypot(*felt.force[:2]))
        pitch = max(0.8 * parameters.clearance_m, 5e-5)
        velocity = Spiral(pitch, most_m=parameters.search_m).velocity(self._spiral_s) if parameters.search else None
        if velocity is None:
            if not parameters.search and self._seconds < parameters.stuck_s:
                return twist
            self._again("not_found", depth_m)
        elif side < parameters.most_side_n and -felt.force[2] > _RESISTS * parameters.search_n:
            # Where the face no longer resists, the peg is left to sink in.
            self._spiral_s += dt_s
            twist[:2] += velocity
        return twist

    def _seat(self, felt: Wrench, depth_m: float, dt_s: float) -> Array:
        parameters = self._parameters
        if depth_m >= parameters.depth_m:
            self.phase = "seated"
            return np.zeros(6)
        if depth_m > self._deepest_m + 1e-4:
            self._deepest_m, self._stuck_s = depth_m, 0.0
        else:
            self._stuck_s += dt_s
        if self._stuck_s > parameters.stuck_s:
            self._again("jammed", depth_m)
        return parameters.admittance.twist(felt, parameters.seat_n)

    def _back_off(self, felt: Wrench, depth_m: float, dt_s: float) -> Array:  # noqa: ARG002
        """Straight back for a moment, giving way sideways; then from the beginning."""
        if self._seconds > 0.4:
            self._again(self._reason, depth_m)
        twist = self._parameters.admittance.twist(felt, 0.0)
        twist[2] = -self._parameters.touch_m_s
        return twist

    def _again(self, reason: Phase, depth_m: float) -> None:
        """Begin again, or give up."""
        if self.tries >= self._parameters.tries:
            self.phase = reason
            return
        if self.phase == "back_off":
            self.tries += 1
            self._enter("touch", depth_m)
        else:
            self._reason = reason
            self._enter("back_off", depth_m)
