"""One episode: drop, look, localise, judge, pick.

A seed determines it to the last bit where the stamp of the environment (``benchmark.records.environment``) is equal.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmark.config import EpisodeConfig
from benchmark.episodes.cells import CellPool, Viewpoints, workspace
from benchmark.episodes.evaluation import TruePiece, Verdict, judge
from benchmark.episodes.picking import Picker, PickOutcome
from benchmark.localizers.oracle import Truth
from benchmark.localizers.registry import make_localizer, with_single_extractor_answers
from benchmark.models import load_model
from benchmark.records.environment import environment_stamp
from benchmark.records.episode_record import EpisodeRecord, PickRecord, vision_stage
from benchmark.study.taught_models import NothingTaught, taught_models
from benchmark.world import gl
from benchmark.world.cell import WorkCell
from benchmark.world.drop import DropResult, OnStep
from benchmark.world.sensor import SensorConfig, calibration_error, sensor_config, with_hand_eye_error
from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.localizer import PRESETS, Localization, Localizer
from vision.pose.calibration import CalibrationError

Array = NDArray[np.float64]
CELLS = CellPool()
"""One cell stays open in every process that runs episodes."""


class EpisodeObserver:
    """Is told what happens in an episode; does nothing by itself."""

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:
        """The cell is ready, nothing has been dropped."""

    def step(self) -> None:
        """The physics took one step."""

    def looked(self, index: int, view: View) -> None:
        """A picture was taken."""

    def localized(self, localization: Localization, verdict: Verdict) -> None:
        """The pictures were understood, and held against the truth."""

    def picked(self, outcome: PickOutcome) -> None:
        """A pick ended."""


@dataclass
class Stopwatch:
    """Wall time by stage."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of a block to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Sight:
    """What was photographed, and the truth about it."""

    views: tuple[View, ...]
    true_views: tuple[View, ...]
    visibility: Array


def run_episode(
    config: EpisodeConfig,
    observer: EpisodeObserver | None = None,
    study: Path | None = None,
    cells: CellPool = CELLS,
) -> EpisodeRecord:
    """Run one episode.

    Args:
        config: what to run.
        observer: is told what happens.
        study: directory of the sweep, for a variant with vision models of its own.
        cells: where the cell comes from; has no influence on the result.

    Raises:
        InputError: an unknown part or localizer, or a variant without its models.
        ResourceError: something that the machine lacks.
    """
    # Stepping one by one, for an observer's sake, costs more than the physics of a move.
    on_step = None if observer is None else observer.step
    observer = observer or EpisodeObserver()
    watch = Stopwatch()
    with watch.stage("total"):
        cell = cells.cell(config)
        sensor = _sensor(config)
        observer.begin(cell, config)
        drop_rng, sensor_rng = np.random.default_rng(config.seed).spawn(2)
        with watch.stage("drop"):
            dropped = cell.drop(drop_rng, on_step, sensor)
        sight = _look(cell, cells.viewpoints(config), sensor_rng, watch, observer, on_step)
        pieces = _true_pieces(cell, dropped, sight)
        localizer, *others = _localizers(
            config, study, lambda: [(p.part, p.T_world_part) for p in pieces], calibration_error(sensor)
        )
        with watch.stage("vision"):
            localization = localizer.localize(sight.views, workspace(cell.config))
        if not set(PRESETS) & set(config.compared):
            localization = with_single_extractor_answers(localizer, localization, sight.views, workspace(cell.config))
        verdict = judge(localization, localizer.name, pieces, sight.true_views, config.models)
        for other in others:
            with watch.stage(vision_stage(other.name)):
                answer = other.localize(sight.views, workspace(cell.config))
            verdict = verdict.beside(judge(answer, other.name, pieces, sight.true_views, config.models))
        observer.localized(localization, verdict)
        picks: tuple[PickRecord, ...] = ()
        if config.task == "pick":
            with watch.stage("motion"):
                picks = (_pick(cell, localization, verdict, observer, on_step, config.models),)
    return EpisodeRecord(
        key=config.key,
        parts=config.parts,
        scene=config.scene,
        seed=config.seed,
        config_hash=config.config_hash,
        environment=environment_stamp(gl.drawn_by()),
        pieces=verdict.pieces,
        picks=picks,
        false_positives=verdict.false_positives,
        false_probabilities=verdict.false_probabilities,
        timings_s=watch.seconds,
    )


def _sensor(config: EpisodeConfig) -> SensorConfig:
    """The sensor's preset, with the mounting error that the episode's variant asks for."""
    sensor = sensor_config(config.sensor)
    hand_eye_mm = config.variant.hand_eye_mm if config.variant is not None else None
    return sensor if hand_eye_mm is None else with_hand_eye_error(sensor, hand_eye_mm / 1000)


def _localizers(
    config: EpisodeConfig, study: Path | None, truth: Truth, calibration: CalibrationError
) -> list[Localizer]:
    """The episode's localizer and those compared with it, with the models that its variant has been taught."""
    names = (config.localizer, *config.compared)
    if config.variant is None or not config.variant.is_taught:
        models = [load_model(part, config.models) for part in config.parts]
        return [make_localizer(name, models, truth, calibration) for name in names]
    if study is None:
        expected = "the directory of the sweep in which it was taught"
        raise InputError(f"models of variant {config.variant.name}", got="none", expected=expected)
    models = taught_models(study, config.variant, config.parts)
    if not models:
        return [NothingTaught(name) for name in names]
    return [make_localizer(name, models, truth, calibration) for name in names]


def _look(
    cell: WorkCell,
    viewpoints: Viewpoints,
    rng: np.random.Generator,
    watch: Stopwatch,
    observer: EpisodeObserver,
    on_step: OnStep | None,
) -> _Sight:
    """Photograph the bin from every viewpoint."""
    views, true_views, visible = [], [], []
    for index, viewpoint in enumerate(viewpoints):
        with watch.stage("motion"):
            cell.move_joints(viewpoint.q, on_step)
        with watch.stage("render"):
            view = cell.capture(rng, f"view {index + 1}")
            seen = cell.visibility()
            visible.append(np.where(seen.total_px > 0, seen.fraction, np.nan))
        observer.looked(index, view)
        views.append(view)
        true_views.append(View(view.image, view.camera, cell.camera_truth(), view.name))
    return _Sight(tuple(views), tuple(true_views), _mean_over_views(np.array(visible)))


def _mean_over_views(visible: Array) -> Array:
    """Mean visible share (N,) over the views (V, N) that show any of a piece's silhouette; 0 where none does."""
    shown = np.isfinite(visible)
    return np.asarray(np.where(shown, visible, 0.0).sum(axis=0) / np.maximum(shown.sum(axis=0), 1))


def _true_pieces(cell: WorkCell, dropped: DropResult, sight: _Sight) -> list[TruePiece]:
    return [
        TruePiece(part, pose, float(seen), inside)
        for part, pose, seen, inside in zip(
            cell.config.piece_parts, cell.truth(), sight.visibility, dropped.in_bin, strict=True
        )
    ]


def _pick(
    cell: WorkCell,
    localization: Localization,
    verdict: Verdict,
    observer: EpisodeObserver,
    on_step: OnStep | None,
    models: str | None,
) -> PickRecord:
    if not localization.estimates:
        return PickRecord(attempted=False, piece=None, succeeded=False)
    outcome = Picker(cell, on_step, models).pick(localization.estimates)
    observer.picked(outcome)
    owner = None if outcome.estimate is None else verdict.owner[outcome.estimate]
    return PickRecord(True, owner, outcome.succeeded, outcome.failed_stage, outcome.grasp, dict(outcome.rejected))
