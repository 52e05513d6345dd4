"""The running work cell: drop, settle, look, photograph, and the simulator's truth to measure against."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.world import sensor as sensors
from benchmark.world.drop import DropResult, OnStep, drop_pieces
from benchmark.world.errors import PhysicsError
from benchmark.world.rendering import CellRenderer, Visibility
from benchmark.world.scene import CAMERA, CellConfig, build_model
from benchmark.world.sensor import Appearance, SensorConfig
from robot.arm import Arm
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory, joint_trajectory
from vision.errors import InputError
from vision.frozen import read_only
from vision.geometry.camera import Camera, View

Array = NDArray[np.float64]

ARM_PREFIX = "arm/"
GRIPPER_PREFIX = "arm/gripper/"
PEG_TIP = "arm/gripper/peg_tip"
# Clear of the bin, of falling pieces and of the light.
PARK_Q = read_only(np.radians([100.0, -110.0, 35.0, 0.0, 75.0, 0.0]))
_ARM_REST_RAD_S = 2e-4
_SETTLE_STEPS = 10
_SETTLE_ROUNDS = 25


class WorkCell:
    """One arm, one bin, one camera, and the pieces of the configuration.

    Build it once and `drop` as often as there are episodes: each drop starts from the same state, so an episode
    depends on its random generators alone. Holds an OpenGL context: close it, or use it in a `with` block.

    Attributes:
        config: the sizes of the cell.
        sensor: how far camera, light and calibration are from perfect.
        model: the compiled model.
        data: its state.
        arm: the handle on the arm.
        kinematics: what the robot's controller knows of its geometry.
        camera: the intrinsics, as the calibration knows them.
        T_flange_camera: where the camera is mounted, by the drawing.
    """

    def __init__(self, config: CellConfig, sensor: SensorConfig) -> None:
        """Compile the model and open the renderer.

        Raises:
            ResourceError: a mesh or a description is missing, or the machine cannot draw.
        """
        self.config, self.sensor = config, sensor
        self.model = build_model(config)
        self.data = mujoco.MjData(self.model)
        self.arm = Arm(self.model, self.data, ARM_PREFIX)
        self.kinematics = ArmKinematics(config.arm_xml)
        self.camera: Camera = config.camera
        self._camera_id = self.model.camera(CAMERA).id
        self._bodies = [self.model.body(f"piece_{i}").id for i in range(config.pieces)]
        self._renderer = CellRenderer(self.model, config, has_marks=sensor.texture_strength > 0)
        self._appearance: Appearance | None = None
        self._episode_sensor = sensor
        self._hand_eye_error = RigidTransform.identity()
        mujoco.mj_forward(self.model, self.data)
        self.T_flange_camera = self.arm.T_world_flange.inv() * self.camera_truth()

    def __enter__(self) -> WorkCell:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._renderer.close()

    def drop(
        self, rng: np.random.Generator, on_step: OnStep | None = None, sensor: SensorConfig | None = None
    ) -> DropResult:
        """Begin an episode: park the arm, draw light, marks and calibration error, drop the pieces and let them rest.

        Args:
            rng: decides on everything in the episode up to the first picture.
            on_step: called after every physics step.
            sensor: for this episode, instead of the cell's own; with marks on the pieces where that has them.
        """
        sensor = sensor or self.sensor
        mujoco.mj_resetData(self.model, self.data)
        self._set_sleep(False)
        self.arm.place(PARK_Q)
        self._appearance = sensors.sample_appearance(rng, sensor, self.camera)
        self._episode_sensor = sensor
        self._hand_eye_error = sensors.sample_hand_eye_error(rng, sensor)
        self._renderer.apply(self._appearance)
        with self._without_noslip(), self._sound():
            result = drop_pieces(self.model, self.data, self.config, rng, on_step)
        self._set_sleep(True)
        return result

    def step(self, steps: int = 1, on_step: OnStep | None = None) -> None:
        """Let physics run for so many steps, with the controls as they are.

        Raises:
            PhysicsError: the simulation gave up or diverged.
        """
        with self._sound():
            if on_step is None:
                mujoco.mj_step(self.model, self.data, steps)
                return
            for _ in range(steps):
                mujoco.mj_step(self.model, self.data)
                on_step()

    def follow(
        self, trajectory: Trajectory, on_step: OnStep | None = None, until: Callable[[], bool] | None = None
    ) -> bool:
        """Drive the arm along a trajectory, then wait until it rests (at most half a second).

        Args:
            trajectory: from where the arm is.
            on_step: called after every physics step.
            until: asked after every time step of the trajectory; where it says yes, the arm stops at once.

        Returns:
            Whether the arm came to the end.
        """
        steps = max(1, round(trajectory.dt_s / self.model.opt.timestep))
        arrived = True
        for command in trajectory.commands():
            self.arm.command(*command)
            self.step(steps, on_step)
            if until is not None and until():
                self.arm.command(self.arm.joint_positions)
                arrived = False
                break
        for _ in range(_SETTLE_ROUNDS):
            if np.abs(self.arm.joint_velocities).max() < _ARM_REST_RAD_S:
                break
            self.step(_SETTLE_STEPS, on_step)
        return arrived

    def move_joints(self, q: Array, on_step: OnStep | None = None) -> None:
        """Move the empty-handed arm to joint angles q (6,) in rad along a jerk-limited path, and let it settle."""
        with self._without_noslip():
            self.follow(joint_trajectory(self.arm.commanded_positions, q, self.arm.limits), on_step)

    def render(self) -> NDArray[np.uint8]:
        """What the wrist camera sees, uint8 (H, W, 3), before the sensor has its say."""
        return self._renderer.rgb(self.data, CAMERA)

    def capture(self, rng: np.random.Generator, name: str = "view") -> View:
        """Take a picture with the wrist camera.

        The pose in the view is what the robot knows: forward kinematics of the measured joint angles and the drawn
        mounting, off by the episode's hand-eye error and this view's repeatability error.

        Raises:
            InputError: no episode has begun.
        """
        if self._appearance is None:
            raise InputError("work cell", got="a picture before the first drop", expected="a drop", do="Call drop().")
        image = sensors.capture(self.render(), rng, self._episode_sensor, self._appearance, self.camera)
        misplaced = sensors.sample_repeatability_error(rng, self._episode_sensor)
        T_world_flange = misplaced * self.kinematics.forward(self.arm.joint_positions)
        return View(image, self.camera, T_world_flange * self.T_flange_camera * self._hand_eye_error, name)

    def truth(self) -> list[RigidTransform]:
        """The true T_world_part of every piece. For measuring, never for localising."""
        return [
            RigidTransform.from_components(
                self.data.xpos[body], Rotation.from_quat(self.data.xquat[body], scalar_first=True)
            )
            for body in self._bodies
        ]

    def peg_truth(self) -> RigidTransform:
        """The true pose of the peg's tip in the world, z along the peg. For measuring.

        Raises:
            InputError: the cell has no peg.
        """
        if self.config.peg is None:
            raise InputError("work cell", got="no peg", expected="one with a peg on the tool")
        tip = self.data.site(PEG_TIP)
        return RigidTransform.from_components(tip.xpos, Rotation.from_matrix(tip.xmat.reshape(3, 3)))

    def camera_truth(self) -> RigidTransform:
        """The true T_world_camera in OpenCV's axes. For measuring, never for localising."""
        return sensors.opencv_pose(self.data, self._camera_id)

    def visibility(self) -> Visibility:
        """How much of each piece the wrist camera sees from where it is."""
        return self._renderer.visibility(self.data, CAMERA)

    def overview(self, width_px: int = 1280, height_px: int = 960) -> NDArray[np.uint8]:
        """A picture of the whole cell for people, uint8 (height, width, 3)."""
        return self._renderer.overview(self.data, width_px, height_px)

    @contextmanager
    def _sound(self) -> Iterator[None]:
        """Turn what MuJoCo gives up on, or silently starts over from, into an error that says so.

        Raises:
            PhysicsError: the simulation gave up or diverged.
        """
        before = self._resets()
        try:
            yield
        except mujoco.FatalError as error:
            raise PhysicsError("physics", got=f"MuJoCo's {error}", expected="a step that it can make") from error
        if self._resets() > before:
            raise PhysicsError("physics", got="numbers without bounds", expected="a motion that can be followed")

    def _resets(self) -> int:
        """How often MuJoCo found numbers without bounds and went back to the beginning."""
        kinds = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
        return sum(int(self.data.warning[kind].number) for kind in kinds)

    def _set_sleep(self, enabled: bool) -> None:
        """Let pieces at rest sleep until something touches them; they neither creep nor cost time then."""
        flag = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.model.opt.enableflags = self.model.opt.enableflags & ~flag | (flag if enabled else 0)

    @contextmanager
    def _without_noslip(self) -> Iterator[None]:
        """Leave out the solver's slip correction, which only a grasp needs and which a heap makes expensive."""
        iterations = self.model.opt.noslip_iterations
        self.model.opt.noslip_iterations = 0
        try:
            yield
        finally:
            self.model.opt.noslip_iterations = iterations
