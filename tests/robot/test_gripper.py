from __future__ import annotations

import os

os.environ.setdefault("MUJOCO_GL", "egl")

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.gripper import Gripper
from robot.gripper_geometry import GripperGeometry
from robot.kinematics import HOME_Q, ArmKinematics
from robot.trajectory import cartesian_line
from vision.errors import InputError

DOWN = Rotation.from_euler("x", np.pi)


def cylinder(radius_m: float, half_height_m: float, mass_kg: float, pos: str) -> str:
    return (
        f'<body name="piece" pos="{pos}"><freejoint/>'
        f'<geom type="cylinder" size="{radius_m} {half_height_m}" mass="{mass_kg}"/></body>'
    )


def ring(inner_m: float, outer_m: float, half_height_m: float, mass_kg: float, pos: str, wedges: int = 24) -> str:
    """A free ring with a real bore, made of boxes."""
    middle, half = (inner_m + outer_m) / 2, (outer_m - inner_m) / 2
    width = outer_m * np.tan(np.pi / wedges)
    boxes = "".join(
        f'<geom type="box" size="{half} {width} {half_height_m}" pos="{middle * np.cos(a)} {middle * np.sin(a)} 0"'
        f' euler="0 0 {np.degrees(a)}" mass="{mass_kg / wedges}" condim="4" friction="0.5 0.005 0.0001"/>'
        for a in 2 * np.pi * np.arange(wedges) / wedges
    )
    return f'<body name="piece" pos="{pos}"><freejoint/>{boxes}</body>'


def grip_and_lift(cell: Any, kinematics: ArmKinematics, tool: RigidTransform, kind: str, width: float, force: float):
    """Go down at (0.75, 0), grip, lift by 0.15 m."""
    low = RigidTransform.from_components([0.75, 0.0, 0.015], DOWN)
    high = RigidTransform.from_components([0.75, 0.0, 0.165], DOWN)
    down = cartesian_line(kinematics, high, low, HOME_Q, T_flange_tool=tool)
    cell.arm.place(down.q[0])
    cell.gripper.open_to(width)
    cell.wait(0.4)
    assert cell.gripper.at_rest
    cell.run(down)
    (cell.gripper.close_with if kind == "outside" else cell.gripper.expand_with)(force)
    cell.wait(1.0)
    assert cell.gripper.at_rest
    cell.run(cartesian_line(kinematics, low, high, down.q[-1], T_flange_tool=tool))
    cell.wait(0.3)


@pytest.mark.parametrize(
    ("body", "kind", "width", "force", "measured"),
    [
        (cylinder(0.0325, 0.02, 0.1, "0.75 0.006 0.02"), "outside", 0.085, 40.0, 0.065),
        (cylinder(0.0325, 0.02, 0.1, "0.75 0.006 0.02"), "outside", 0.085, 250.0, 0.065),
        (ring(0.032, 0.12, 0.02, 4.5, "0.75 0.003 0.02"), "inside", 0.02, 250.0, 0.0542),
    ],
    ids=["cover, gently", "cover, hard", "hub by its bore"],
)
def test_a_gripped_piece_is_lifted_and_stays(
    make_cell: Any,
    kinematics: ArmKinematics,
    geometry: GripperGeometry,
    body: str,
    kind: str,
    width: float,
    force: float,
    measured: float,
) -> None:
    cell = make_cell(body)
    grip_and_lift(cell, kinematics, geometry.T_flange_tcp, kind, width, force)
    assert cell.gripper.holding("piece")
    assert cell.gripper.width_m == pytest.approx(measured, abs=2e-3)
    assert abs(cell.gripper.force_n) == pytest.approx(force)
    contacts = cell.gripper.finger_contacts("piece")
    assert contacts.left_n == pytest.approx(force, rel=0.15)
    assert contacts.right_n == pytest.approx(force, rel=0.15)
    assert cell.body("piece").translation[2] == pytest.approx(0.17, abs=2e-3)
    before = cell.site("arm/gripper/tcp").inv() * cell.body("piece")
    cell.wait(1.0)
    slip = before.inv() * cell.site("arm/gripper/tcp").inv() * cell.body("piece")
    assert np.linalg.norm(slip.translation) < 2e-4
    assert slip.rotation.magnitude() < np.radians(0.2)


def test_too_weak_a_grip_drops_the_hub(make_cell: Any, kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    """4.5 kg need 44 N of friction; two pads of 0.8 with 10 N each give 16 N."""
    cell = make_cell(ring(0.032, 0.12, 0.02, 4.5, "0.75 0 0.02"))
    grip_and_lift(cell, kinematics, geometry.T_flange_tcp, "inside", 0.02, 10.0)
    assert not cell.gripper.holding("piece")
    assert cell.body("piece").translation[2] < 0.03


def test_an_empty_gripper_holds_nothing(make_cell: Any) -> None:
    cell = make_cell()
    cell.arm.place(HOME_Q)
    for act in (cell.gripper.close_with, cell.gripper.expand_with):
        act(100.0)
        cell.wait(1.0)
        assert not cell.gripper.holding()
    cell.gripper.open_to(0.03)
    cell.wait(1.0)
    assert cell.gripper.width_m == pytest.approx(0.03, abs=1e-4)
    left, right = (cell.data.joint(f"arm/gripper/finger_{side}").qpos[0] for side in ("left", "right"))
    assert left == pytest.approx(right, abs=1e-5)


def test_the_camera_sees_neither_the_fingers_nor_itself(make_cell: Any) -> None:
    cell = make_cell()
    cell.arm.place(HOME_Q)
    with mujoco.Renderer(cell.model, 480, 640) as renderer:
        renderer.enable_segmentation_rendering()
        for width in (0.0, 0.11):
            cell.data.qpos[6:8] = width / 2
            mujoco.mj_forward(cell.model, cell.data)
            renderer.update_scene(cell.data, "arm/gripper/wrist_camera")
            seen = np.unique(renderer.render()[..., 0])
            assert {cell.model.geom(g).name for g in seen if g >= 0} <= {"floor"}


def test_mount_and_camera_agree(make_cell: Any, geometry: GripperGeometry, kinematics: ArmKinematics) -> None:
    cell = make_cell()
    cell.arm.place(HOME_Q)
    cell.wait(0.002)
    mount = kinematics.forward(HOME_Q) * geometry.T_flange_camera
    camera = cell.data.camera("arm/gripper/wrist_camera")
    np.testing.assert_allclose(camera.xpos, mount.translation, atol=1e-6)
    np.testing.assert_allclose(
        camera.xmat.reshape(3, 3) @ np.diag([1, -1, -1]), mount.rotation.as_matrix(), atol=1e-6
    )


def test_geometry_is_the_models(geometry: GripperGeometry) -> None:
    assert geometry.max_width_m == pytest.approx(0.11)
    assert geometry.finger_thickness_m == pytest.approx(0.004)
    np.testing.assert_allclose(geometry.T_flange_tcp.translation, [0, 0, 0.155])
    boxes = geometry.boxes(0.05)
    tips = boxes.half_sizes[:, 0].round(9) == 0.002
    np.testing.assert_allclose(np.sort(boxes.centres[tips, 0]), [-0.027, 0.027], atol=1e-9)


def test_bad_input(make_cell: Any) -> None:
    cell = make_cell()
    with pytest.raises(InputError, match="gap"):
        cell.gripper.open_to(0.2)
    with pytest.raises(InputError, match="force"):
        cell.gripper.close_with(1000.0)
    with pytest.raises(InputError, match="no 'hub'"):
        cell.gripper.holding("hub")
    with pytest.raises(InputError, match="no 'gripper'"):
        Gripper(cell.model, cell.data)
    with pytest.raises(InputError, match="existing file"):
        GripperGeometry.from_mjcf("no_such_gripper.xml")
