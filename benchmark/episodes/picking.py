"""Task: pick one localised piece from the bin and place it in the tray.

Success: after the lift both fingers press on the piece, and at the end it lies in the tray, let go of.
Physics alone holds the piece.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation
from trimesh import load_mesh
from trimesh.sample import sample_surface_even

from benchmark.models import load_model
from benchmark.world.cell import GRIPPER_PREFIX, WorkCell
from benchmark.world.drop import OnStep
from benchmark.world.parts import get_part, vertices
from benchmark.world.scene import CellConfig
from robot.errors import UnreachableError
from robot.grasp_opening import opened_grasps
from robot.grasping import plan_grasp
from robot.grasps import GraspChoice, GraspParameters, GraspPlan, OpenedGrasp, Piece
from robot.gripper import Gripper
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.trajectory import Trajectory, cartesian_line, joint_trajectory
from vision.pose.estimate import PoseEstimate

Array = NDArray[np.float64]

WALL_THICKNESS_M = 0.01
GRIP_FORCE_PER_WEIGHT = 40.0  # friction 0.8 on two edges in a bore, while the arm speeds up and brakes
LEAST_GRIP_FORCE_N = 6.0
GRIP_TIMEOUT_S = 1.2
GRIP_SETTLE_S = 0.05
RELEASE_S = 0.4
LOADED_SPEED = 0.4  # of the arm's limits, so that pieces do not swing or slip
RELEASE_HEIGHT_M = 0.004
RETREAT_M = 0.06
SURFACE_SPACING_M = 0.004
FEWEST_SURFACE_POINTS = 2500
SURE_POSITION_M = 0.0005  # a pose known this well leaves nothing to wish for


@dataclass(frozen=True)
class PickOutcome:
    """How a pick went.

    Attributes:
        estimate: index of the estimate that was to be picked, None when no way was found.
        succeeded: the piece lies in the tray.
        failed_stage: ``plan``, ``grip``, ``lift`` or ``place``; None on success.
        grasp: name of the grasp.
        rejected: where no grasp was found, how many fell for which reason; otherwise empty.
    """

    estimate: int | None
    succeeded: bool
    failed_stage: str | None
    grasp: str | None
    rejected: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Placing:
    carry: Trajectory
    lower: Trajectory
    retreat: Trajectory


class Picker:
    """Plans and carries out picks in one cell."""

    def __init__(self, cell: WorkCell, on_step: OnStep | None = None, models: str | None = None) -> None:
        """Prepare.

        Args:
            cell: the running cell.
            on_step: called after every physics step.
            models: directory of vision models that come before the shipped ones.
        """
        self._cell, self._on_step, self._models = cell, on_step, models
        self._geometry = GripperGeometry.from_mjcf(cell.config.gripper_xml)
        self._gripper = Gripper(cell.model, cell.data, GRIPPER_PREFIX)

    def pick(self, estimates: tuple[PoseEstimate, ...]) -> PickOutcome:
        """Choose a piece and a grasp, take it and place it."""
        choice = self.plan(estimates)
        plan = choice.plan
        if plan is None:
            return PickOutcome(None, False, "plan", None, choice.rejected)
        stage = self._carry_out(plan, estimates[plan.piece].part)
        return PickOutcome(plan.piece, stage is None, stage, plan.taught.name)

    def plan(self, estimates: tuple[PoseEstimate, ...]) -> GraspChoice:
        """The best collision-free grasp of any localised piece that the arm can reach and bring to the tray."""
        config = self._cell.config
        largest = max(get_part(name).diameter_m for name in config.part_names)
        parameters = GraspParameters(approach_m=config.bin_wall_m + 0.03, lift_m=config.bin_wall_m + 0.6 * largest)
        pieces = [
            Piece(
                e.T_world_part,
                opened_grasps_of(e.part, config.gripper_xml, parameters.approach_m, self._models),
                surface_points(e.part),
                _confidence(e),
            )
            for e in estimates
        ]
        return plan_grasp(
            self._cell.kinematics,
            self._geometry,
            pieces,
            bin_boxes(config),
            self._cell.arm.joint_positions,
            parameters,
            lambda plan: self._placing(plan, estimates[plan.piece].part) is not None,
        )

    def _carry_out(self, plan: GraspPlan, part: str) -> str | None:
        """Move; returns the stage that failed, None on success."""
        cell = self._cell
        self._gripper.open_to(plan.grasp.open_width_m)
        cell.move_joints(plan.q_pregrasp, self._on_step)
        cell.follow(plan.approach, self._on_step)
        if self._grip(plan, part) is None:
            return "grip"
        cell.follow(plan.lift, self._on_step)
        body = self._held()
        if body is None:
            return "lift"
        self._place(plan, part)
        return None if self._in_tray(body) else "place"

    def _grip(self, plan: GraspPlan, part: str) -> int | None:
        weight = get_part(part).mass_kg * 9.81
        force = float(np.clip(GRIP_FORCE_PER_WEIGHT * weight, LEAST_GRIP_FORCE_N, self._gripper.max_force_n))
        if plan.taught.kind == "inside":
            self._gripper.expand_with(force)
        else:
            self._gripper.close_with(force)
        for _ in range(self._steps(GRIP_TIMEOUT_S) // 10):
            self._cell.step(10, self._on_step)
            if self._gripper.at_rest and self._held() is not None:
                break
        self._cell.step(self._steps(GRIP_SETTLE_S), self._on_step)
        return self._held()

    def _held(self) -> int | None:
        """Which piece both fingers press on."""
        for index in range(self._cell.config.pieces):
            if self._gripper.holding(f"piece_{index}", min_force_n=0.5):
                return index
        return None

    def _place(self, plan: GraspPlan, part: str) -> None:
        """Carry the piece over the tray, lower it, let go, and draw back."""
        motions = self._placing(plan, part)
        if motions is None:
            return
        for trajectory in (motions.carry, motions.lower):
            self._cell.follow(trajectory, self._on_step)
        self._gripper.open_to(plan.grasp.open_width_m)
        self._cell.step(self._steps(RELEASE_S), self._on_step)
        self._cell.follow(motions.retreat, self._on_step)
        self._cell.step(self._steps(RELEASE_S), self._on_step)

    def _placing(self, plan: GraspPlan, part: str) -> _Placing | None:
        """The motions from the end of the lift to the empty hand over the tray; None where the arm cannot do them.

        The lifted tool turns about the arm's column until it is over the tray, so that the wrist need not turn.
        """
        cell, tcp = self._cell, self._geometry.T_flange_tcp
        start, goal = plan.T_world_lift.translation, np.array(cell.config.tray_centre_m)
        turn = float(np.arctan2(goal[1], goal[0]) - np.arctan2(start[1], start[0]))
        above = RigidTransform.from_components(
            [goal[0], goal[1], start[2]], Rotation.from_euler("z", turn) * plan.T_world_lift.rotation
        )
        bottom = above.translation[2] - _height_below_tcp(plan, part)
        drop = max(bottom - goal[2] - RELEASE_HEIGHT_M, 0.0)
        lowered = RigidTransform.from_translation([0.0, 0.0, -drop]) * above
        retreated = lowered * RigidTransform.from_translation([0.0, 0.0, -RETREAT_M])
        slow = cell.arm.limits.scaled(LOADED_SPEED)
        q_lifted = plan.lift.q[-1]
        try:
            q_above = cell.kinematics.inverse(above * tcp.inv(), q_lifted + turn * np.eye(6)[0])
            carry = joint_trajectory(q_lifted, q_above, slow)
            lower = cartesian_line(cell.kinematics, above, lowered, q_above, T_flange_tool=tcp, limits=slow)
            retreat = cartesian_line(cell.kinematics, lowered, retreated, lower.q[-1], T_flange_tool=tcp)
        except UnreachableError:
            return None
        return _Placing(carry, lower, retreat)

    def _in_tray(self, body: int) -> bool:
        offset = self._cell.truth()[body].translation - np.array(self._cell.config.tray_centre_m)
        half = np.array(self._cell.config.tray_size_m) / 2
        low = offset[2] < get_part(self._cell.config.piece_parts[body]).diameter_m
        return bool((np.abs(offset[:2]) < half).all() and low and not self._gripper.holding(f"piece_{body}"))

    def _steps(self, seconds: float) -> int:
        return round(seconds / self._cell.model.opt.timestep)


def bin_boxes(config: CellConfig) -> Boxes:
    """The bin's floor and walls as boxes in the world frame."""
    (x, y), height, t = config.bin_size_m, config.bin_wall_m, WALL_THICKNESS_M
    centre = np.array(config.bin_centre_m)

    def box(offset: tuple[float, float, float], half: tuple[float, float, float]) -> tuple[RigidTransform, tuple]:
        return RigidTransform.from_translation(centre + offset), half

    return Boxes.of(
        box((0, 0, -t / 2), (x / 2 + t, y / 2 + t, t / 2)),
        *(box((s * (x + t) / 2, 0, height / 2), (t / 2, y / 2 + t, height / 2)) for s in (-1, 1)),
        *(box((0, s * (y + t) / 2, height / 2), (x / 2 + t, t / 2, height / 2)) for s in (-1, 1)),
    )


@cache
def surface_points(part: str) -> Array:
    """Points (N, 3) spread evenly over a part's surface, in its frame: what the gripper may not run into."""
    mesh = load_mesh(get_part(part).visual_mesh, process=False)
    count = max(FEWEST_SURFACE_POINTS, round(mesh.area / SURFACE_SPACING_M**2))
    points, _ = sample_surface_even(mesh, count, seed=0)
    return np.asarray(np.vstack([points, vertices(get_part(part))[::8]]))


@cache
def opened_grasps_of(
    part: str, gripper_xml: Path, approach_m: float, models: str | None = None
) -> tuple[OpenedGrasp, ...]:
    """The taught grasps of a part that the gripper can reach past the part itself; see `opened_grasps`."""
    taught = load_model(part, models).grasps
    return opened_grasps(GripperGeometry.from_mjcf(gripper_xml), taught, surface_points(part), approach_m)


def _confidence(estimate: PoseEstimate) -> float:
    """How sure a pose is, 0 to 1: by the support of its edges, and by its standard deviation."""
    sigma = float(np.sqrt(np.trace(estimate.covariance[:3, :3])))
    return estimate.score * min(1.0, SURE_POSITION_M / max(sigma, 1e-9))


def _height_below_tcp(plan: GraspPlan, part: str) -> float:
    """How far the held piece reaches below the tool centre point, by the plan."""
    T_world_part = plan.T_world_tcp * plan.taught.T_part_tcp.inv()
    heights = surface_points(part) @ T_world_part.as_matrix()[2, :3] + T_world_part.translation[2]
    return float(plan.T_world_tcp.translation[2] - heights.min())
