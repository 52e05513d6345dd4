from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import PUMA_761, JointLimits
from robot.errors import UnreachableError
from robot.gripper_geometry import PARALLEL_GRIPPER
from robot.kinematics import HOME_Q, POSITION_TOLERANCE_M, ROTATION_TOLERANCE_RAD, ArmKinematics
from vision.errors import FocalpickError, InputError

# The published numbers of the Unimate PUMA 761, and this project's shoulder height.
A2, D2, D4, D6, SHOULDER = 0.650, 0.190, 0.850, 0.125, 1.35


def denavit_hartenberg(q: np.ndarray) -> np.ndarray:
    rows = [(-90, 0, SHOULDER), (0, A2, D2), (-90, 0, 0), (90, 0, D4), (-90, 0, 0), (0, 0, D6)]
    pose = np.eye(4)
    for theta, (alpha_deg, a, d) in zip(q, rows, strict=True):
        alpha = np.radians(alpha_deg)
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        pose = pose @ [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
    return pose


def poses(limits: JointLimits, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(limits.lower, limits.upper, (count, 6))


def test_forward_is_the_published_arm(kinematics: ArmKinematics) -> None:
    for q in [np.zeros(6), np.radians([0, -90, -90, 0, 0, 0]), *poses(kinematics.limits, 40)]:
        np.testing.assert_allclose(kinematics.forward(q).as_matrix(), denavit_hartenberg(q), atol=1e-9)


def test_reach_is_1_5_m_to_the_wrist(kinematics: ArmKinematics) -> None:
    wrist = kinematics.forward(np.radians([0, -90, -90, 0, 0, 0])) * RigidTransform.from_translation([0, 0, -D6])
    np.testing.assert_allclose(wrist.translation, [0, D2, SHOULDER + 1.5], atol=1e-9)


def test_limits_are_the_published_ones(kinematics: ArmKinematics) -> None:
    np.testing.assert_allclose(np.degrees(kinematics.limits.lower), [-160, -200, -225, -266, -100, -266])
    np.testing.assert_allclose(np.degrees(kinematics.limits.upper), [160, 20, 45, 266, 100, 266])


def test_inverse_from_home_meets_the_pose_within_the_limits(kinematics: ArmKinematics) -> None:
    for q in poses(kinematics.limits, 40, seed=1):
        wanted = kinematics.forward(q)
        found = kinematics.inverse(wanted)
        miss = wanted.inv() * kinematics.forward(found)
        assert np.linalg.norm(miss.translation) < POSITION_TOLERANCE_M
        assert miss.rotation.magnitude() < ROTATION_TOLERANCE_RAD
        assert kinematics.limits.contain(found)


def test_inverse_from_nearby_comes_back(kinematics: ArmKinematics) -> None:
    """Near the seed there is one solution, unless the wrist is straight."""
    q = np.radians([20, -60, 10, 15, 50, -30])
    offset = np.radians([5, -4, 6, 8, -5, 7])
    np.testing.assert_allclose(kinematics.inverse(kinematics.forward(q), q + offset), q, atol=1e-6)


def test_inverse_does_not_unwind_the_wrist(kinematics: ArmKinematics) -> None:
    q = np.radians([20, -60, 10, 15, 50, 240])
    np.testing.assert_allclose(kinematics.inverse(kinematics.forward(q), q), q, atol=1e-9)
    np.testing.assert_allclose(
        kinematics.inverse(kinematics.forward(q), q - [0, 0, 0, 0, 0, 4.0])[5], q[5] - 2 * np.pi
    )


def test_solutions_are_distinct_branches_nearest_first(kinematics: ArmKinematics) -> None:
    wanted = kinematics.forward(HOME_Q)
    found = kinematics.solutions(wanted, HOME_Q)
    distances = [np.linalg.norm(q - HOME_Q) for q in found]
    assert len(found) >= 4
    assert distances[0] < 1e-9
    assert distances == sorted(distances)
    for q in found:
        np.testing.assert_allclose(kinematics.forward(q).as_matrix(), wanted.as_matrix(), atol=1e-5)


def test_same_question_same_answer(kinematics: ArmKinematics) -> None:
    wanted = RigidTransform.from_components([0.8, 0.2, 0.4], Rotation.from_euler("xz", [170, 40], degrees=True))
    first = kinematics.inverse(wanted)
    kinematics.forward(np.ones(6) * 0.1)
    np.testing.assert_array_equal(kinematics.inverse(wanted), first)
    np.testing.assert_array_equal(ArmKinematics().inverse(wanted), first)


@pytest.mark.parametrize("position", [(3.0, 0.0, 1.0), (0.05, 0.0, 1.35), (0.75, 0.0, -0.6)])
def test_out_of_reach_is_said(kinematics: ArmKinematics, position: tuple[float, float, float]) -> None:
    with pytest.raises(UnreachableError, match="flange pose") as caught:
        kinematics.inverse(RigidTransform.from_components(position, Rotation.from_euler("x", np.pi)))
    assert isinstance(caught.value, FocalpickError)


def test_bad_input(kinematics: ArmKinematics) -> None:
    with pytest.raises(InputError, match="finite"):
        kinematics.forward([0, 0, 0, np.nan, 0, 0])
    with pytest.raises(InputError, match="6 finite numbers"):
        kinematics.forward([0, 0])
    with pytest.raises(InputError, match="finite"):
        kinematics.inverse(RigidTransform.from_translation([np.nan, 0, 0]))
    with pytest.raises(InputError, match="existing file"):
        ArmKinematics("no_such_arm.xml")
    with pytest.raises(InputError, match="arm alone"):
        ArmKinematics(PARALLEL_GRIPPER)


def test_an_arm_whose_wrist_axes_do_not_meet_is_solved_step_by_step(kinematics: ArmKinematics) -> None:
    arm = mujoco.MjSpec.from_file(str(PUMA_761))
    arm.body("wrist_flange").pos = [0.003, 0.0, 0.0]
    other = ArmKinematics(arm.compile())
    goal = other.forward(HOME_Q + 0.3)
    reached = other.forward(other.inverse(goal, HOME_Q))
    assert np.linalg.norm(reached.translation - goal.translation) < POSITION_TOLERANCE_M
    # The other arm's closed form would miss by the three millimetres.
    missed = other.forward(kinematics.inverse(goal, HOME_Q))
    assert np.linalg.norm(missed.translation - goal.translation) > 1e-3
