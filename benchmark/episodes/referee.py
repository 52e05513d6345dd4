"""Knows the truth, and holds against it what the robot says and does. The robot never hears of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from benchmark.episodes.cells import workspace
from benchmark.episodes.evaluation import TruePiece, Verdict, assign_estimates, judge
from benchmark.localizers.registry import with_single_extractor_answers
from benchmark.records.episode_record import AttemptRecord, PickRecord, vision_stage
from benchmark.tasks.attempt import Attempt
from benchmark.tasks.bench import Witness
from benchmark.tasks.clock import Clock
from benchmark.world.cell import WorkCell
from benchmark.world.drop import DropResult
from benchmark.world.parts import get_part
from benchmark.world.watch import Watched
from vision.geometry.camera import View
from vision.localizer import PRESETS, Localization, Localizer

Array = NDArray[np.float64]
ON_AXIS_M, ON_AXIS_RAD = 0.002, float(np.radians(5))  # more play than any bore leaves a peg that is in it


class Referee(Witness):
    """Beside the workbench: sees every picture, every localisation and every attempt.

    Attributes:
        verdict: on the first localisation, None before there is one.
    """

    def __init__(
        self,
        cell: WorkCell,
        dropped: DropResult,
        models: str | None,
        told: Callable[[Localization, Verdict], None],
        saw: Callable[[int, View], None],
    ) -> None:
        """Watch a cell in which the pieces have come to rest.

        Args:
            cell: the running cell.
            dropped: how the drop ended.
            models: directory of vision models that come before the shipped ones.
            told: is told of the first localisation and the verdict on it.
            saw: is told of every picture of the first look.
        """
        self._cell, self._dropped, self._models = cell, dropped, models
        self._told, self._saw = told, saw
        self._true_views: list[View] = []
        self._visible: list[Array] = []
        self._owner: tuple[int | None, ...] = ()
        self._in_tray = self.in_tray()
        self.verdict: Verdict | None = None

    def judge_for(self, localizer: Localizer, compared: Sequence[Localizer], clock: Clock) -> None:
        """Say whose localisations will be judged.

        Args:
            localizer: the one that the robot follows.
            compared: others, which are shown the first look, too.
            clock: counts their time.
        """
        self._localizer, self._compared, self._clock = localizer, tuple(compared), clock

    def truth(self) -> list[tuple[str, RigidTransform]]:
        """Part and true pose of every piece that lies where a localizer looks for it; for the oracle alone."""
        space = workspace(self._cell.config)
        pieces = zip(self._cell.config.piece_parts, self._cell.truth(), strict=True)
        return [(part, pose) for part, pose in pieces if space.contains(pose.translation[None])[0]]

    def looked(self, view: View) -> None:
        """Note what the first look could see."""
        if self.verdict is not None:
            return
        seen = self._cell.visibility()
        self._visible.append(np.where(seen.total_px > 0, seen.fraction, np.nan))
        self._saw(len(self._true_views), view)
        self._true_views.append(View(view.image, view.camera, self._cell.camera_truth(), view.name))

    def localized(self, views: Sequence[View], localization: Localization) -> None:
        """Judge the first localisation; of the others note which estimate is which piece."""
        pieces = self._pieces()
        if self.verdict is None:
            localization = self._with_single_extractors(views, localization)
            self.verdict = self._judged(self._localizer, localization, pieces)
            for other in self._compared:
                with self._clock.stage(vision_stage(other.name)):
                    answer = other.localize(views, workspace(self._cell.config))
                self.verdict = self.verdict.beside(self._judged(other, answer, pieces))
            self._told(localization, self.verdict)
        pairs = dict(assign_estimates(localization.estimates, pieces).pairs)
        self._owner = tuple(pairs.get(i) for i in range(len(localization.estimates)))

    def _judged(self, localizer: Localizer, localization: Localization, pieces: Sequence[TruePiece]) -> Verdict:
        return judge(localization, localizer.name, pieces, self._true_views, self._models)

    def _with_single_extractors(self, views: Sequence[View], localization: Localization) -> Localization:
        """With what each extractor alone would have said, unless localizers of that kind are compared anyway."""
        if {other.name for other in self._compared} & set(PRESETS):
            return localization
        return with_single_extractor_answers(self._localizer, localization, views, workspace(self._cell.config))

    def attempted(self, attempt: Attempt) -> AttemptRecord:
        """Judge an attempt that has just ended."""
        arrived = [
            i for i, (now, before) in enumerate(zip(self.in_tray(), self._in_tray, strict=True)) if now > before
        ]
        self._in_tray = self.in_tray()
        stage, cause = attempt.stage, attempt.cause
        if stage is None and attempt.goal == "pick" and not arrived:
            stage, cause = "place", "does not lie in the tray"
        depth_mm = self._peg_depth_mm(attempt) if attempt.goal == "insert" else None
        if attempt.goal == "insert" and stage is None and depth_mm is None:
            stage, cause = "seat", "does not sit in the bore"
        worst = attempt.watched
        piece = None if attempt.estimate is None else self._owner[attempt.estimate]
        meant, (stray_body, stray) = _sorted_forces(worst, piece)
        return AttemptRecord(
            goal=attempt.goal,
            piece=piece,
            succeeded=stage is None,
            stage=stage,
            cause=cause,
            grasp=attempt.grasp,
            rejected=dict(attempt.rejected),
            seconds=dict(attempt.seconds),
            stray_force_n=round(stray, 3),
            stray_body=stray_body,
            touch_force_n=round(meant, 3),
            penetration_mm=round(1e3 * worst.penetration_m, 4),
            speed_share=round(worst.speed, 4),
            acceleration_share=round(worst.acceleration, 4),
            jerk_share=round(worst.jerk, 4),
            tries=attempt.tries,
            wrist_n=round(attempt.wrist_n, 3),
            depth_mm=None if depth_mm is None else round(depth_mm, 4),
        )

    def _peg_depth_mm(self, attempt: Attempt) -> float | None:
        """How deep the peg is in the bore that was meant; None where its tip is not on the bore's axis."""
        piece = None if attempt.estimate is None else self._owner[attempt.estimate]
        bore = None if piece is None else get_part(self._cell.config.piece_parts[piece]).bore
        if piece is None or bore is None:
            return None
        T_bore_tip = (self._cell.truth()[piece] * bore.T_part_bore).inv() * self._cell.peg_truth()
        x, y, z = T_bore_tip.translation
        along = float(T_bore_tip.rotation.as_matrix()[2, 2])
        if np.hypot(x, y) > ON_AXIS_M or abs(along) < np.cos(ON_AXIS_RAD):
            return None
        return 1e3 * float(z if along > 0 else bore.depth_m - z)

    def in_tray(self) -> tuple[bool, ...]:
        """For every piece, whether it lies in the tray: its centre between the walls, and low."""
        config = self._cell.config
        half = np.array(config.tray_size_m) / 2
        offsets = [pose.translation - np.array(config.tray_centre_m) for pose in self._cell.truth()]
        return tuple(
            bool((np.abs(offset[:2]) < half).all() and offset[2] < get_part(part).diameter_m)
            for offset, part in zip(offsets, config.piece_parts, strict=True)
        )

    def places(self) -> tuple[str, ...]:
        """Where every piece is: ``tray``, ``bin``, or ``lost``."""
        inside = {i for i, (_, pose) in enumerate(zip(self._cell.config.piece_parts, self._cell.truth(), strict=True))
                  if _within(self._cell, pose)}  # fmt: skip
        return tuple(
            "tray" if placed else "bin" if index in inside else "lost" for index, placed in enumerate(self.in_tray())
        )

    def _pieces(self) -> list[TruePiece]:
        seen = _mean_over_views(np.array(self._visible))
        return [
            TruePiece(part, pose, float(share), inside)
            for part, pose, share, inside in zip(
                self._cell.config.piece_parts, self._cell.truth(), seen, self._dropped.in_bin, strict=True
            )
        ]


def pick_record(attempt: AttemptRecord) -> PickRecord:
    """The pick of an episode that has only one, as records have held it from the beginning."""
    attempted = attempt.stage != "localize"
    return PickRecord(
        attempted,
        attempt.piece,
        attempt.succeeded,
        attempt.stage if attempted else None,
        attempt.grasp,
        attempt.rejected,
    )


def _sorted_forces(worst: Watched, piece: int | None) -> tuple[float, tuple[str, float]]:
    """The largest force on the piece that was meant, and on another body; a ghost's grasp means what it held."""
    forces = dict(worst.forces_n)
    pieces = [body for body in forces if body.startswith("piece_")]
    meant = f"piece_{piece}" if piece is not None else max(pieces, key=lambda body: forces[body], default="")
    wanted = forces.pop(meant, 0.0)
    return wanted, max(forces.items(), key=lambda item: item[1], default=("", 0.0))


def _within(cell: WorkCell, pose: RigidTransform) -> bool:
    offset = np.abs(pose.translation[:2] - np.array(cell.config.bin_centre_m)[:2])
    return bool((offset < np.array(cell.config.bin_size_m) / 2).all())


def _mean_over_views(visible: Array) -> Array:
    """Mean visible share (N,) over the views (V, N) that show any of a piece's silhouette; 0 where none does."""
    shown = np.isfinite(visible)
    return np.asarray(np.where(shown, visible, 0.0).sum(axis=0) / np.maximum(shown.sum(axis=0), 1))
