"""Task: pick one localised piece from the bin and place it in the tray.

Success: after the lift both fingers press on the piece, and at the end it lies in the tray, let go of.
Physics alone holds the piece.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.localizers import load_model
from benchmark.world.cell import GRIPPER_PREFIX, WorkCell
from benchmark.world.drop import OnStep
from benchmark.world.parts import get_part, vertices
from benchmark.world.scene import CellConfig
from robot.errors import UnreachableError
from robot.grasping import GraspPlan, GraspSettings, Piece, TaughtGrasp, plan_grasp
from robot.gripper import Gripper
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.trajectory import cartesian_line, joint_trajectory
from vision.pose import PoseEstimate

Array = NDArray[np.float64]

WALL_THICKNESS_M = 0.01
GRIP_FORCE_PER_WEIGHT = 12.0  # friction 0.8 on two fingers, and accelerations
LEAST_GRIP_FORCE_N = 6.0
GRIP_TIMEOUT_S = 0.8
RELEASE_S = 0.5
LOADED_SPEED = 0.5  # of the arm's limits, so that heavy pieces do not swing
RELEASE_HEIGHT_M = 0.008
SURFACE_POINTS = 1500


@dataclass(frozen=True)
class PickOutcome:
    """How a pick went.

    Attributes:
        estimate: index of the estimate that was to be picked, None when no way was found.
        succeeded: the piece lies in the tray.
        failed_stage: ``plan``, ``approach``, ``grip``, ``lift`` or ``place``; None on success.
        grasp: name of the grasp.
        body: index of the piece that was held after the lift, None for none.
    """

    estimate: int | None
    succeeded: bool
    failed_stage: str | None
    grasp: str | None
    body: int | None = None


class Picker:
    """Plans and carries out picks in one cell."""

    def __init__(self, cell: WorkCell, on_step: OnStep | None = None) -> None:
        """Prepare.

        Args:
            cell: the running cell.
            on_step: called after every physics step.
        """
        self._cell, self._on_step = cell, on_step
        self._geometry = GripperGeometry.from_mjcf(cell.config.gripper_xml)
        self._gripper = Gripper(cell.model, cell.data, GRIPPER_PREFIX)

    def pick(self, estimates: tuple[PoseEstimate, ...]) -> PickOutcome:
        """Choose a piece and a grasp, take it and place it."""
        plan = self.plan(estimates)
        if plan is None:
            return PickOutcome(None, False, "plan", None)
        stage, body = self._carry_out(plan, estimates[plan.piece].part)
        return PickOutcome(plan.piece, stage is None, stage, plan.grasp.name, body)

    def plan(self, estimates: tuple[PoseEstimate, ...]) -> GraspPlan | None:
        """The best collision-free reachable grasp of any localised piece."""
        config = self._cell.config
        pieces = [Piece(e.T_world_part, _taught_grasps(e.part), surface_points(e.part)) for e in estimates]
        largest = max(get_part(name).diameter_m for name in config.part_names)
        settings = GraspSettings(
            approach_m=config.bin_wall_m + 0.03,
            lift_m=config.bin_wall_m + 0.6 * largest,
        )
        choice = plan_grasp(
            self._cell.kinematics,
            self._geometry,
            pieces,
            bin_boxes(config),
            self._cell.arm.joint_positions,
            settings,
        )
        return choice.plan

    def _carry_out(self, plan: GraspPlan, part: str) -> tuple[str | None, int | None]:
        """Move; returns the stage that failed, None on success, and the piece that was held."""
        cell = self._cell
        try:
            self._gripper.open_to(plan.open_width_m)
            cell.move_joints(plan.q_pregrasp, self._on_step)
            cell.follow(plan.approach, self._on_step)
        except UnreachableError:
            return "approach", None
        if self._grip(plan, part) is None:
            return "grip", None
        cell.follow(plan.lift, self._on_step)
        body = self._held()
        if body is None:
            return "lift", None
        try:
            self._place(plan, part)
        except UnreachableError:
            return "place", body
        return (None if self._in_tray(body) else "place"), body

    def _grip(self, plan: GraspPlan, part: str) -> int | None:
        weight = get_part(part).mass_kg * 9.81
        force = float(np.clip(GRIP_FORCE_PER_WEIGHT * weight, LEAST_GRIP_FORCE_N, self._gripper.max_force_n))
        if plan.grasp.kind == "inside":
            self._gripper.expand_with(force)
        else:
            self._gripper.close_with(force)
        steps = round(GRIP_TIMEOUT_S / self._cell.model.opt.timestep / 10)
        for _ in range(steps):
            self._cell.step(10, self._on_step)
            if self._gripper.at_rest and (held := self._held()) is not None:
                self._cell.step(25, self._on_step)
                return held
        return self._held()

    def _held(self) -> int | None:
        """Which piece both fingers press on."""
        for index in range(self._cell.config.pieces):
            if self._gripper.holding(f"piece_{index}", min_force_n=0.5):
                return index
        return None

    def _place(self, plan: GraspPlan, part: str) -> None:
        """Carry the piece over the tray, lower it and let go."""
        cell, tcp = self._cell, self._geometry.T_flange_tcp
        part_drop = _height_below_tcp(plan, part)
        above = self._tray_pose(plan)
        q_above = cell.kinematics.inverse(above * tcp.inv(), cell.arm.joint_positions)
        limits = cell.arm.limits.scaled(LOADED_SPEED)
        cell.follow(joint_trajectory(cell.arm.joint_positions, q_above, limits), self._on_step)
        drop = above.translation[2] - part_drop - cell.config.tray_centre_m[2] - RELEASE_HEIGHT_M
        lowered = RigidTransform.from_translation([0.0, 0.0, -max(drop, 0.0)]) * above
        down = cartesian_line(cell.kinematics, above, lowered, q_above, T_flange_tool=tcp)
        cell.follow(down, self._on_step)
        self._gripper.open_to(plan.open_width_m)
        cell.step(round(RELEASE_S / cell.model.opt.timestep), self._on_step)
        retreat = lowered * RigidTransform.from_translation([0.0, 0.0, -0.06])
        cell.follow(
            cartesian_line(cell.kinematics, lowered, retreat, down.q[-1], T_flange_tool=tcp), self._on_step
        )
        cell.step(round(RELEASE_S / cell.model.opt.timestep), self._on_step)

    def _tray_pose(self, plan: GraspPlan) -> RigidTransform:
        """The lifted tool turned about the arm's column until it is over the tray: the wrist need not turn."""
        start, goal = plan.T_world_lift.translation, np.array(self._cell.config.tray_centre_m)
        turn = np.arctan2(goal[1], goal[0]) - np.arctan2(start[1], start[0])
        rotation = Rotation.from_euler("z", turn) * plan.T_world_lift.rotation
        return RigidTransform.from_components([goal[0], goal[1], start[2]], rotation)

    def _in_tray(self, body: int) -> bool:
        offset = self._cell.truth()[body].translation - np.array(self._cell.config.tray_centre_m)
        half = np.array(self._cell.config.tray_size_m) / 2
        low = offset[2] < get_part(self._cell.config.piece_parts[body]).diameter_m
        return bool((np.abs(offset[:2]) < half).all() and low and not self._gripper.holding(f"piece_{body}"))


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
    """Points (N, 3) spread over a part's surface, in its frame: what the gripper may not run into."""
    from trimesh import load_mesh
    from trimesh.sample import sample_surface_even

    mesh = load_mesh(get_part(part).visual_mesh, process=False)
    points, _ = sample_surface_even(mesh, SURFACE_POINTS, seed=0)
    return np.vstack([points, vertices(get_part(part))[::40]])


def _taught_grasps(part: str) -> tuple[TaughtGrasp, ...]:
    return tuple(
        TaughtGrasp(g.name, g.T_part_tcp, g.width_m, g.kind, g.copies) for g in load_model(part).grasps
    )


def _height_below_tcp(plan: GraspPlan, part: str) -> float:
    """How far the held piece reaches below the tool centre point, by the plan."""
    T_world_part = plan.T_world_tcp * plan.grasp.T_part_tcp.inv()
    return float(plan.T_world_tcp.translation[2] - T_world_part.apply(surface_points(part))[:, 2].min())
