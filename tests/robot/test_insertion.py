"""Peg in hole against a plain model of contact: a face with a bore somewhere in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from robot.compliance import Admittance, Spiral, at_tip
from robot.insertion import ENDED, Insertion, InsertionParameters
from robot.wrist import Wrench

DT_S = 0.002
STIFFNESS_N_M = 5e4
FACE_M = 0.001  # what gives way before it counts as a bore's wall


@dataclass
class Face:
    """A stiff face at depth zero with a bore beside the place where it is believed to be."""

    offset_m: tuple[float, float]
    clearance_m: float
    blocked_at_m: float = np.inf

    def wrench(self, tip: np.ndarray) -> Wrench:
        """What the peg feels with its tip at (x, y, depth)."""
        away = tip[:2] - np.array(self.offset_m)
        distance = float(np.hypot(*away))
        play = self.clearance_m / 2
        force = np.zeros(3)
        if tip[2] > 0 and distance > play and tip[2] < FACE_M:
            force[2] = -STIFFNESS_N_M * tip[2]
        elif tip[2] > 0 and distance > play:
            force[:2] = -STIFFNESS_N_M * (distance - play) * away / distance
        if tip[2] > self.blocked_at_m:
            force[2] = -STIFFNESS_N_M * (tip[2] - self.blocked_at_m)
        return Wrench(force, np.zeros(3))


def insert(face: Face, seconds: float = 60.0, **changes: object) -> Insertion:
    parameters = InsertionParameters(clearance_m=face.clearance_m, depth_m=0.01, **changes)  # type: ignore[arg-type]
    insertion, tip = Insertion(parameters), np.array([0.0, 0.0, -0.002])
    for _ in range(round(seconds / DT_S)):
        tip += DT_S * insertion.step(face.wrench(tip), float(tip[2]), DT_S)[:3]
        if insertion.phase in ENDED:
            break
    return insertion


def test_right_above_the_bore_nothing_is_felt() -> None:
    done = insert(Face((0, 0), 5e-4))
    assert (done.phase, done.tries) == ("seated", 1)
    assert done.most_n < 1


@pytest.mark.parametrize("offset", [(4e-4, 0.0), (-3e-4, 6e-4)])
def test_beside_the_bore_the_spiral_finds_it_with_little_force(offset: tuple[float, float]) -> None:
    done = insert(Face(offset, 2e-4))
    assert done.phase == "seated"
    assert 1 < done.most_n < 60


def test_without_a_search_it_is_not_found() -> None:
    assert insert(Face((4e-4, 0.0), 2e-4), search=False).phase == "not_found"


def test_a_bore_out_of_the_search_is_not_found() -> None:
    assert insert(Face((4e-3, 0.0), 2e-4), seconds=200).phase == "not_found"


def test_a_blocked_bore_jams_after_all_tries_and_with_limited_force() -> None:
    done = insert(Face((0, 0), 5e-4, blocked_at_m=0.004))
    assert (done.phase, done.tries) == ("jammed", InsertionParameters(1e-3, 0.01).tries)
    assert done.most_n < 60


def test_the_turns_of_a_spiral_lie_a_pitch_apart() -> None:
    spiral, place, places = Spiral(pitch_m=1e-4, most_m=1e-3), np.zeros(2), []
    for step in range(100_000):
        velocity = spiral.velocity(step * DT_S)
        if velocity is None:
            break
        assert np.linalg.norm(velocity) == pytest.approx(spiral.speed_m_s)
        place = place + DT_S * velocity
        places.append(place)
    grid = np.random.default_rng(0).uniform(-6e-4, 6e-4, (200, 2))
    nearest = [np.linalg.norm(np.array(places) - point, axis=1).min() for point in grid]
    assert max(nearest) < 0.75 * spiral.pitch_m


def test_the_tool_gives_way_and_presses() -> None:
    twist = Admittance().twist(Wrench(np.array([10.0, 0, -5.0]), np.array([0, 2.0, 3.0])), press_n=5.0)
    assert twist[0] > 0
    assert twist[2] == pytest.approx(0)
    assert twist[4] > 0
    assert twist[5] == 0  # the peg is round


def test_torque_is_taken_at_the_tip() -> None:
    felt = Wrench(np.array([1.0, 0, 0]), np.cross([0, 0, 0.2], [1.0, 0, 0]))
    np.testing.assert_allclose(at_tip(felt, 0.2).torque, 0, atol=1e-12)
