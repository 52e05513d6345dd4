"""Arm and gripper at work: take a piece as planned, put it down as planned, and feel when something is in the way."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from benchmark.tasks.attempt import Stage
from benchmark.tasks.clock import Clock
from benchmark.world.boards import boards
from benchmark.world.cell import GRIPPER_PREFIX, WorkCell
from benchmark.world.drop import OnStep
from benchmark.world.parts import get_part
from robot.bore_approach import BoreApproach
from robot.clearance import boxes_clearance
from robot.compliance import at_tip
from robot.errors import UnreachableError
from robot.grasps import GraspPlan
from robot.gripper import Gripper
from robot.gripper_geometry import GripperGeometry
from robot.insertion import ENDED, Insertion, InsertionParameters
from robot.placing import Placing
from robot.servo import CartesianServo
from robot.tipping import Tip, drag_along
from robot.trajectory import DEFAULT_DT_S, Trajectory, cartesian_path
from robot.wrist import WristSensor

Array = NDArray[np.float64]
Failure = tuple[Stage, str]

GRIP_FORCE_PER_WEIGHT = 40.0  # friction 0.8 on two edges in a bore, while the arm speeds up and brakes
LEAST_GRIP_FORCE_N = 6.0
GRIP_TIMEOUT_S = 1.2
GRIP_SETTLE_S = 0.05
RELEASE_TIMEOUT_S = 0.4
RETREAT_M = 0.06
MOVE_CLEARANCE_M = 0.005
RISES_M = (0.1, 0.2, 0.3)
INSERT_TIMEOUT_S = 40.0
GUARD_N = 30.0  # felt on the way to a piece, it means that something is in the way
PRESSING_GUARD_N = 5.0
DRAGGING_GUARD_N = 40.0
LOWERING_GUARD_N = 15.0
LOWERING_GUARD_WEIGHTS = 0.5


@dataclass(frozen=True)
class Way:
    """How a guarded move ended.

    Attributes:
        arrived: nothing stopped it.
        force_n: what was felt when it was stopped.
    """

    arrived: bool
    force_n: float = 0.0


class Hand:
    """Moves the arm and the gripper of one cell.

    Attributes:
        geometry: of the gripper.
        gripper: its handle.
        wrist: the force sensor.
    """

    def __init__(self, cell: WorkCell, clock: Clock, on_step: OnStep | None = None) -> None:
        """Take the arm of a cell.

        Args:
            cell: the running cell.
            clock: keeps simulated time.
            on_step: called after every physics step.
        """
        self._cell, self._clock, self._on_step = cell, clock, on_step
        self.geometry = GripperGeometry.from_mjcf(cell.config.gripper_xml)
        self.gripper = Gripper(cell.model, cell.data, GRIPPER_PREFIX)
        self._boards = boards(cell.model, "bin").joined(boards(cell.model, "tray"))
        self.wrist = WristSensor(cell.model, cell.data, GRIPPER_PREFIX)

    @property
    def joint_positions(self) -> Array:
        """(6,) measured joint angles in rad."""
        return self._cell.arm.joint_positions

    def move_joints(self, q: Array) -> None:
        """Move the empty hand to joint angles q (6,) in rad through the air, over walls that are in the way."""
        for stop in self._stops(q):
            self._cell.move_joints(stop, self._on_step)

    def _stops(self, q: Array) -> list[Array]:
        """Where to stop on the way: nowhere, where the direct way is free; else above the start and the goal."""
        cell, start = self._cell, self._cell.arm.commanded_positions
        if self._free(start, q):
            return [q]
        for rise in RISES_M:
            up = RigidTransform.from_translation([0.0, 0.0, rise])
            try:
                above = [cell.kinematics.inverse(up * cell.kinematics.forward(end), end) for end in (start, q)]
            except UnreachableError:
                continue
            if self._free(above[0], above[1]) and self._free(above[1], q):
                return [*above, q]
        return [q]

    def _free(self, start: Array, goal: Array) -> bool:
        """Whether the gripper stays off the boards on a joint move."""
        shares = np.linspace(0.0, 1.0, 40)[:, None]
        tool = self.geometry.T_flange_tcp
        poses = [self._cell.kinematics.forward(q) * tool for q in start + shares * (goal - start)]
        turns, places = np.array([p.rotation.as_matrix() for p in poses]), np.array([p.translation for p in poses])
        gripper = self.geometry.boxes(self.gripper.width_m)
        return bool(
            boxes_clearance(gripper, turns, places, self._boards, 2 * MOVE_CLEARANCE_M).min() > MOVE_CLEARANCE_M
        )

    def follow(self, trajectory: Trajectory, guard_n: float | None = None) -> Way:
        """Follow a trajectory; stop where a force above the guard is felt that was not there at the start."""
        if guard_n is None:
            self._cell.follow(trajectory, self._on_step)
            return Way(True)
        self.wrist.tare()
        felt = 0.0

        def in_the_way() -> bool:
            nonlocal felt
            felt = self.wrist.force_n()
            return felt > guard_n

        arrived = self._cell.follow(trajectory, self._on_step, in_the_way)
        return Way(arrived, 0.0 if arrived else felt)

    def wait(self, seconds: float) -> None:
        """Let the world go on for a while."""
        self._cell.step(max(1, round(seconds / self._cell.model.opt.timestep)), self._on_step)

    def wait_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for something, for a while at most; returns whether it came."""
        for _ in range(max(1, round(timeout_s / self._cell.model.opt.timestep / 10))):
            self._cell.step(10, self._on_step)
            if done():
                return True
        return False

    def take(self, plan: GraspPlan, part: str) -> Failure | None:
        """Open, go there, grip and lift; returns where and why it failed, None where the piece is held."""
        doing = self._clock.doing
        self.gripper.open_to(plan.grasp.open_width_m)
        with doing("move"):
            self.move_joints(plan.q_pregrasp)
        with doing("approach"):
            way = self.follow(plan.approach, GUARD_N)
        if not way.arrived:
            self.draw_back(plan.T_world_pregrasp)
            return "approach", f"met something with {way.force_n:.0f} N"
        with doing("grip"):
            self.grip(plan, part)
        if not self.gripper.holding(min_force_n=0.5):
            self.let_go(plan)
            self.draw_back(plan.T_world_pregrasp)
            return "grip", "nothing between the fingers"
        with doing("lift"):
            self.follow(plan.lift)
        if not self.gripper.holding(min_force_n=0.5):
            self.let_go(plan)
            return "lift", "slipped out of the fingers"
        return None

    def put(self, plan: GraspPlan, placing: Placing, part: str) -> Failure | None:
        """Carry, lower, let go and draw back; returns where and why it failed."""
        doing = self._clock.doing
        with doing("carry"):
            for trajectory in placing.carry:
                self.follow(trajectory)
        if not self.gripper.holding(min_force_n=0.5):
            self.let_go(plan)
            return "carry", "slipped out of the fingers"
        weight = get_part(part).mass_kg * 9.81
        with doing("lower"):
            way = self.follow(placing.lower, LOWERING_GUARD_N + LOWERING_GUARD_WEIGHTS * weight)
        with doing("release"):
            self.let_go(plan)
        if way.arrived:
            with doing("retreat"):
                self.follow(placing.retreat)
        else:  # it touched down a little early
            here = self.T_world_commanded
            back = here * RigidTransform.from_translation([0.0, 0.0, -RETREAT_M])
            rise = max(float(placing.T_world_above.translation[2] - back.translation[2]), 0.0)
            self.draw_back(back, RigidTransform.from_translation([0.0, 0.0, rise]) * back)
        return None

    def tip(self, tip: Tip) -> Failure | None:
        """Press closed fingers on the edge of a piece and drag it over; returns where and why it failed."""
        self.gripper.close_with(LEAST_GRIP_FORCE_N)
        with self._clock.doing("move"):
            self.move_joints(np.array(tip.approach.q[0]))
        with self._clock.doing("push"):
            way = self.follow(tip.approach, GUARD_N)
            failed = None if way.arrived else f"met something with {way.force_n:.0f} N"
            if way.arrived and self.follow(tip.press, PRESSING_GUARD_N).arrived:
                failed = "felt nothing"
            elif way.arrived:
                self.follow(self._drag(tip), DRAGGING_GUARD_N)
        self.draw_back(tip.T_world_start)
        return None if failed is None else ("push", failed)

    def _drag(self, tip: Tip) -> Trajectory:
        """From where the edge was felt."""
        cell = self._cell
        try:
            return drag_along(
                cell.kinematics, self.geometry, self.T_world_commanded, cell.arm.commanded_positions, tip.arc
            )
        except UnreachableError:
            q = cell.arm.commanded_positions
            return Trajectory(q[None], np.zeros((1, 6)), DEFAULT_DT_S)

    def grip(self, plan: GraspPlan, part: str) -> None:
        """Press the fingers on the piece, as hard as its weight asks for."""
        weight = get_part(part).mass_kg * 9.81
        force = float(np.clip(GRIP_FORCE_PER_WEIGHT * weight, LEAST_GRIP_FORCE_N, self.gripper.max_force_n))
        press = self.gripper.expand_with if plan.taught.kind == "inside" else self.gripper.close_with
        press(force)
        self.wait_until(lambda: self.gripper.at_rest and self.gripper.holding(min_force_n=0.5), GRIP_TIMEOUT_S)
        self.wait(GRIP_SETTLE_S)

    def let_go(self, plan: GraspPlan) -> None:
        """Open the fingers as wide as they were on the way to the piece."""
        self.gripper.open_to(plan.grasp.open_width_m)
        self.wait_until(lambda: self.gripper.at_rest, RELEASE_TIMEOUT_S)

    def insert(
        self, way: BoreApproach, parameters: InsertionParameters, tip_m: float
    ) -> tuple[Failure | None, int, float]:
        """Put the peg in; returns where and why it failed, how often it began, and the largest force felt."""
        cell, doing = self._cell, self._clock.doing
        self.gripper.close_with(LEAST_GRIP_FORCE_N)
        with doing("move"):
            self.move_joints(np.array(way.approach.q[0]))
        with doing("approach"):
            arrived = self.follow(way.approach, GUARD_N)
        if not arrived.arrived:
            return ("approach", f"met something with {arrived.force_n:.0f} N"), 1, arrived.force_n
        self.wrist.tare()
        T_flange_tip = self.geometry.T_flange_tcp * RigidTransform.from_translation([0.0, 0.0, tip_m])
        servo = CartesianServo(cell.kinematics, cell.arm.commanded_positions, T_flange_tip)
        insertion, dt_s = Insertion(parameters), float(cell.model.opt.timestep)
        T_bore_world, reach_m = way.T_world_bore.inv(), float(T_flange_tip.translation[2])
        with doing("insert"):
            for _ in range(round(INSERT_TIMEOUT_S / dt_s)):
                tip = cell.kinematics.forward(self.joint_positions) * T_flange_tip
                depth_m = float((T_bore_world * tip).translation[2])
                twist = insertion.step(at_tip(self.wrist.wrench(), reach_m), depth_m, dt_s)
                if insertion.phase in ENDED:
                    break
                cell.arm.command(*servo.step(twist, dt_s))
                cell.step(1, self._on_step)
            cell.arm.command(cell.arm.joint_positions)
        if insertion.phase == "seated":
            return None, insertion.tries, insertion.most_n
        stage: Stage = "search" if insertion.phase in ("touch", "search", "not_found") else "seat"
        return (stage, insertion.phase.replace("_", " ")), insertion.tries, insertion.most_n

    @property
    def T_world_commanded(self) -> RigidTransform:  # noqa: N802
        """The tool centre point, where the arm was last told to stand."""
        cell = self._cell
        return cell.kinematics.forward(cell.arm.commanded_positions) * self.geometry.T_flange_tcp

    def draw_back(self, *waypoints: RigidTransform) -> None:
        """Leave along straight lines, after something stopped the arm."""
        cell = self._cell
        try:
            back = cartesian_path(
                cell.kinematics,
                (self.T_world_commanded, *waypoints),
                cell.arm.commanded_positions,
                T_flange_tool=self.geometry.T_flange_tcp,
            )
        except UnreachableError:
            return
        with self._clock.doing("retreat"):
            self.follow(back)
