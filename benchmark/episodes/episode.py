"""One episode: drop, do the task, judge.

A seed determines it to the last bit where the stamp of the environment (``benchmark.records.environment``) is equal.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmark.config import EpisodeConfig
from benchmark.episodes.cells import CellPool, clearance_m, workspace
from benchmark.episodes.evaluation import Verdict
from benchmark.episodes.referee import Referee, pick_record
from benchmark.localizers.oracle import Truth
from benchmark.localizers.registry import make_localizer
from benchmark.models import load_model
from benchmark.records.environment import environment_stamp
from benchmark.records.episode_record import AttemptRecord, EpisodeRecord
from benchmark.study.taught_models import NothingTaught, taught_models
from benchmark.tasks.bench import Workbench
from benchmark.tasks.clock import Clock
from benchmark.tasks.registry import make_task
from benchmark.world import gl
from benchmark.world.cell import WorkCell
from benchmark.world.sensor import SensorConfig, calibration_error, sensor_config, with_hand_eye_error
from benchmark.world.watch import StepWatch
from vision.errors import InputError
from vision.geometry.camera import View
from vision.localizer import Localization, Localizer
from vision.pose.calibration import CalibrationError

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

    def attempted(self, attempt: AttemptRecord) -> None:
        """An attempt of the robot's ended, and was held against the truth."""


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
    on_step = None if observer is None else observer.step
    observer = observer or EpisodeObserver()
    clock = Clock()
    with clock.stage("total"):
        cell = cells.cell(config)
        sensor = _sensor(config)
        observer.begin(cell, config)
        drop_rng, sensor_rng = np.random.default_rng(config.seed).spawn(2)
        with clock.stage("drop"):
            dropped = cell.drop(drop_rng, on_step, sensor)
        referee = Referee(cell, dropped, config.models, observer.localized, observer.looked)
        localizer, *compared = _localizers(config, study, referee.truth, calibration_error(sensor))
        referee.judge_for(localizer, compared, clock)
        clock.follow(lambda: float(cell.data.time))
        watch = StepWatch(cell) if config.task not in ("none", "pick") else None
        bench = Workbench(
            cell,
            localizer,
            workspace(cell.config),
            sensor_rng,
            clock,
            referee,
            on_step,
            config.models,
            watch,
            clearance_m(config),
        )
        attempts = []
        for attempt in make_task(config.task).run(bench, cells.looks(config)):
            attempts.append(referee.attempted(attempt))
            observer.attempted(attempts[-1])
    verdict = referee.verdict or Verdict((), {}, ())
    return EpisodeRecord(
        key=config.key,
        parts=config.parts,
        scene=config.scene,
        seed=config.seed,
        config_hash=config.config_hash,
        environment=environment_stamp(gl.drawn_by()),
        pieces=verdict.pieces,
        picks=tuple(map(pick_record, attempts)) if config.task == "pick" else (),
        false_positives=verdict.false_positives,
        false_probabilities=verdict.false_probabilities,
        timings_s=clock.wall_s,
        attempts=tuple(attempts),
        places=referee.places() if config.task != "none" else (),
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
