"""What the robot believes, and how looks and deeds change it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmark.tasks.memory import Belief, Placed
from vision.pose.estimate import PoseEstimate

DIAMETER_M = 0.065


def estimate(x: float) -> PoseEstimate:
    return PoseEstimate(
        "cover2", RigidTransform.from_translation([x, 0.0, 0.1]), np.eye(6), 1.0, "oracle", 0.0, 3, True
    )


def test_failures_stay_with_a_piece_that_did_not_move() -> None:
    belief = Belief().seen((estimate(0.0), estimate(0.2)), DIAMETER_M).failed(1).failed(1)
    again = belief.seen((estimate(0.201), estimate(0.0), estimate(0.4)), DIAMETER_M)
    assert [known.failures for known in again.known] == [2, 0, 0]
    assert again.looks == 2
    moved = belief.seen((estimate(0.23),), DIAMETER_M)
    assert [known.failures for known in moved.known] == [0]


def test_what_is_taken_is_no_longer_in_the_bin_and_what_is_put_stays() -> None:
    before = Belief().seen((estimate(0.0), estimate(0.2)), DIAMETER_M)
    placed = Placed("cover2", RigidTransform.from_translation([0.4, -0.7, 0.1]), flat=True)
    after = before.taken(0, DIAMETER_M).put(placed)
    assert [e.T_world_part.translation[0] for e in after.estimates] == [0.2]
    assert after.placed == (placed,)
    assert len(before.known) == 2
    assert after.seen((), DIAMETER_M).placed == (placed,)


def test_what_lay_beside_a_taken_piece_is_in_doubt_until_it_is_seen_again() -> None:
    belief = Belief().seen((estimate(0.0), estimate(0.06), estimate(0.2)), DIAMETER_M).taken(0, DIAMETER_M)
    assert [known.doubtful for known in belief.known] == [True, False]
    assert belief.certain
    last = belief.taken(1, DIAMETER_M)
    assert not last.certain
    assert last.seen(last.estimates, DIAMETER_M).certain
    assert not belief.failed(1).certain  # the hand may have pushed anything
