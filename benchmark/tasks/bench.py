"""The workbench: the few steps that all tasks are made of. It hands on everything but the truth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.models import load_model
from benchmark.tasks.attempt import Attempt, Stage
from benchmark.tasks.clock import Clock
from benchmark.tasks.hand import Hand
from benchmark.tasks.memory import Belief, Placed
from benchmark.tasks.part_shape import opened_grasps_of, surface_points
from benchmark.world.boards import boards
from benchmark.world.cell import WorkCell
from benchmark.world.drop import OnStep
from benchmark.world.fixtures import TIP_BELOW_TCP_M
from benchmark.world.parts import get_part
from benchmark.world.watch import StepWatch, Watched
from robot.bore_approach import BoreApproach, approach_bore
from robot.grasping import plan_grasp
from robot.grasps import GraspChoice, GraspParameters, GraspPlan, Piece
from robot.insertion import InsertionParameters
from robot.placing import PlaceParameters, Placing, Tray, plan_placing
from robot.tipping import Tip, plan_tip
from robot.viewpoints import Viewpoint
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import Localization, Localizer
from vision.pose.estimate import PoseEstimate

FREE_OVER_WALL_M = 0.03
SURE_POSITION_M = 0.0005  # a pose known this well leaves nothing to wish for
_TRUST_AFTER_FAILURE = 0.4  # in a pose at which a grasp failed, as a share of before
_FALLEN_RING = 24
DEEP_M, DEEP_SHARE = 0.010, 0.9  # how deep a peg has to get, and the most of a bore
FIRMER_M = 0.0008  # lower with every push in vain

Viewpoints = list[Viewpoint]


class Witness:
    """Is told what the robot does, to hold it against the truth; does nothing by itself."""

    def looked(self, view: View) -> None:
        """A picture was taken, and the arm still stands where it was taken from."""

    def localized(self, views: Sequence[View], localization: Localization) -> None:
        """Pictures were understood."""


@dataclass(frozen=True, eq=False)
class Sight:
    """Pictures of a scene in which nothing has moved meanwhile.

    Attributes:
        views: in the order in which they were taken.
    """

    views: tuple[View, ...]

    def and_also(self, other: Sight) -> Sight:
        """All pictures together."""
        return Sight((*self.views, *other.views))


class Workbench:
    """The robot's own side of a cell: look, localise, plan, act.

    Attributes:
        hand: moves arm and gripper.
        clock: what took how long.
        clearance_m: diametral, between peg and bore.
    """

    def __init__(
        self,
        cell: WorkCell,
        localizer: Localizer,
        space: Workspace,
        rng: np.random.Generator,
        clock: Clock,
        witness: Witness | None = None,
        on_step: OnStep | None = None,
        models: str | None = None,
        watch: StepWatch | None = None,
        clearance_m: float = 0.0005,
    ) -> None:
        """Take over a cell in which pieces have come to rest.

        Args:
            cell: the running cell.
            localizer: finds the poses.
            space: where pieces can lie.
            rng: of the camera.
            clock: keeps time.
            witness: is told about looks and localisations.
            on_step: called after every physics step.
            models: directory of vision models that come before the shipped ones.
            watch: looks at every physics step.
            clearance_m: diametral, between peg and bore.
        """
        self._cell, self._localizer, self._space, self._rng = cell, localizer, space, rng
        self._witness, self._models, self._watch = witness or Witness(), models, watch
        self.clock, self.clearance_m = clock, clearance_m
        self.hand = Hand(cell, clock, _both(on_step, watch))
        self.diameter_m = max(get_part(name).diameter_m for name in cell.config.part_names)
        self._bin, self._tray = boards(cell.model, "bin"), boards(cell.model, "tray")
        self._views_taken = 0
        self._not_placed: Counter[str] = Counter()
        self._left_at: RigidTransform | None = None

    def look(self, viewpoints: Viewpoints) -> Sight:
        """Photograph the bin from every viewpoint."""
        views = []
        for viewpoint in viewpoints:
            with self.clock.stage("motion"), self.clock.doing("look"):
                self.hand.move_joints(viewpoint.q)
            with self.clock.stage("render"):
                self._views_taken += 1
                views.append(self._cell.capture(self._rng, f"view {self._views_taken}"))
                self._witness.looked(views[-1])
        return Sight(tuple(views))

    def localize(self, sight: Sight) -> Localization:
        """Where the pieces are, as far as the pictures tell."""
        with self.clock.stage("vision"):
            localization = self._localizer.localize(sight.views, self._space)
        self._witness.localized(sight.views, localization)
        return localization

    def plan(self, belief: Belief, parameters: PlaceParameters | None = None) -> GraspChoice[Placing]:
        """The best way to take a known piece and to put it down on a free spot in the tray."""
        grasping = GraspParameters(
            free_height_m=self.free_height_m, lift_m=self._cell.config.bin_wall_m + 0.6 * self.diameter_m
        )
        pieces, tray = self._pieces(belief), self.tray(belief)

        def finish(plan: GraspPlan) -> Placing | None:
            points = surface_points(belief.known[plan.piece].estimate.part)
            chosen = plan_placing(
                self._cell.kinematics, self.hand.geometry, plan, points, tray, parameters or PlaceParameters()
            )
            self._not_placed.update({f"placing, {why}": count for why, count in chosen.rejected.items()})
            return chosen.placing

        self._not_placed = Counter()

        with self.clock.stage("motion"):
            return plan_grasp(
                self._cell.kinematics,
                self.hand.geometry,
                pieces,
                self._bin,
                self.hand.joint_positions,
                grasping,
                finish,
            )

    def plan_tip(self, belief: Belief, pushes: int = 0) -> Tip | None:
        """A way to tip over a known piece that stands on edge; firmer after pushes in vain."""
        with self.clock.stage("motion"):
            return plan_tip(
                self._cell.kinematics,
                self.hand.geometry,
                self._pieces(belief),
                self._bin,
                self.hand.joint_positions,
                self.free_height_m,
                FIRMER_M * pushes,
            )

    def tip(self, belief: Belief, tip: Tip) -> Attempt:
        """Tip a piece over; where it lies then, only a look can tell."""
        with self.clock.stage("motion"):
            failed = self.hand.tip(tip)
        return self.attempt("push", belief.known[tip.piece].number, failed)

    @property
    def free_height_m(self) -> float:
        """Where the tool centre point is this high over the bin, the arm moves freely."""
        config = self._cell.config
        return config.bin_centre_m[2] + config.bin_wall_m + FREE_OVER_WALL_M

    def _pieces(self, belief: Belief) -> list[Piece]:
        """The known pieces as the planner takes them."""
        config = self._cell.config
        longest_approach_m = config.bin_wall_m + FREE_OVER_WALL_M
        return [
            Piece(
                known.estimate.T_world_part,
                ()
                if known.doubtful
                else opened_grasps_of(known.estimate.part, config.gripper_xml, longest_approach_m, self._models),
                surface_points(known.estimate.part),
                _confidence(known.estimate) * _TRUST_AFTER_FAILURE**known.failures,
            )
            for known in belief.known
        ]

    def tray(self, belief: Belief) -> Tray:
        """The tray with what is believed to lie in it."""
        config = self._cell.config
        taken = [np.zeros((0, 3)), *(_footprint(p.part, p.T_world_part.as_matrix(), p.flat) for p in belief.placed)]
        return Tray(np.array(config.tray_centre_m), np.array(config.tray_size_m), self._tray, np.concatenate(taken))

    def pick(self, belief: Belief, choice: GraspChoice[Placing]) -> tuple[Attempt, Belief]:
        """Take a piece as planned and put it down; returns how it went and what is believed then."""
        plan, placing = choice.plan, choice.rest
        if not belief.known:
            return self.attempt("pick", None, ("localize", "nothing was localised")), belief
        if plan is None or placing is None:
            return self.attempt("pick", None, ("plan", "none of the grasps was possible"), choice=choice), belief
        known, name = belief.known[plan.piece], plan.taught.name
        part = known.estimate.part
        with self.clock.stage("motion"):
            failed = self.hand.take(plan, part)
            if failed is not None:
                return self.attempt("pick", known.number, failed, name), belief.failed(plan.piece)
            belief = belief.taken(plan.piece, self.diameter_m)
            failed = self.hand.put(plan, placing, part)
        if failed is None:
            belief = belief.put(Placed(part, placing.T_world_part, placing.flat))
        return self.attempt("pick", known.number, failed, name), belief

    def insert(self, belief: Belief) -> Attempt:
        """Put the peg into the most upright bore that is known."""
        ways = ((index, way, depth) for index, bore, depth in self._bores(belief) if (way := self._way_to(bore)))
        with self.clock.stage("motion"):
            index, way, depth_m = next(ways, (None, None, 0.0))
            if index is None or way is None:
                stage: Stage = "plan" if belief.known else "localize"
                return self.attempt("insert", None, (stage, "no bore that the peg can come to"))
            self._left_at = way.T_world_start
            failed, tries, most_n = self.hand.insert(
                way, InsertionParameters(self.clearance_m, min(DEEP_M, DEEP_SHARE * depth_m)), TIP_BELOW_TCP_M
            )
        attempt = self.attempt("insert", belief.known[index].number, failed)
        return replace(attempt, tries=tries, wrist_n=most_n)

    def withdraw(self) -> None:
        """Take the peg out again, or away."""
        if self._left_at is not None:
            self.hand.draw_back(self._left_at)
            self._left_at = None

    def _way_to(self, T_world_bore: RigidTransform) -> BoreApproach | None:
        return approach_bore(
            self._cell.kinematics,
            self.hand.geometry,
            T_world_bore,
            TIP_BELOW_TCP_M,
            self._bin,
            self.hand.joint_positions,
            self.free_height_m,
        )

    def _bores(self, belief: Belief) -> list[tuple[int, RigidTransform, float]]:
        """Entries of all bores, from either side, with their depths; the most upright first."""
        bores = []
        for index, known in enumerate(belief.known):
            bore = load_model(known.estimate.part, self._models).bore
            if bore is not None:
                front = known.estimate.T_world_part * bore.T_part_bore
                back = front * RigidTransform.from_components(
                    [0.0, 0.0, bore.depth_m], Rotation.from_euler("x", np.pi)
                )
                bores += [(index, front, bore.depth_m), (index, back, bore.depth_m)]
        return sorted(bores, key=lambda entry: float(entry[1].rotation.as_matrix()[2, 2]))

    def attempt(
        self,
        goal: str,
        estimate: int | None,
        failed: tuple[Stage, str] | None = None,
        grasp: str | None = None,
        choice: GraspChoice[Placing] | None = None,
    ) -> Attempt:
        """What has been done since the last attempt, as an attempt."""
        stage, cause = failed or (None, "")
        worst = Watched() if self._watch is None else self._watch.worst
        if self._watch is not None:
            self._watch.restart()
        rejected = {} if choice is None or choice.plan is not None else {**choice.rejected, **self._not_placed}
        return Attempt(goal, estimate, stage, cause, grasp, rejected, self.clock.take_simulated_s(), worst)


def _footprint(part: str, pose: np.ndarray, flat: bool) -> np.ndarray:
    """Points (N, 3) on a piece in the tray; all around, for one that fell over to one side or another."""
    points = surface_points(part)[::4] @ pose[:3, :3].T + pose[:3, 3]
    if flat:
        return points
    turns = 2 * np.pi * np.arange(_FALLEN_RING) / _FALLEN_RING
    reach = 0.75 * get_part(part).diameter_m
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    ring = middle + reach * np.column_stack([np.cos(turns), np.sin(turns), np.zeros(_FALLEN_RING)])
    return np.concatenate([points, ring])


def _confidence(estimate: PoseEstimate) -> float:
    """How sure a pose is, 0 to 1: by the support of its edges, and by its standard deviation."""
    sigma = float(np.sqrt(np.trace(estimate.covariance[:3, :3])))
    return estimate.score * min(1.0, SURE_POSITION_M / max(sigma, 1e-9))


def _both(one: OnStep | None, other: Callable[[], None] | None) -> OnStep | None:
    """Calls both after a step; None where there is neither."""
    calls = [call for call in (one, other) if call is not None]
    if len(calls) < 2:
        return calls[0] if calls else None

    def call() -> None:
        for each in calls:
            each()

    return call
