"""Scenes to tune and to validate on: photographed once, with the truth about every piece."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from benchmark.commands.common import print_line
from benchmark.config import EpisodeConfig, episode_seed
from benchmark.episodes.cells import workspace
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.episodes.evaluation import TruePiece, Verdict
from benchmark.models import load_model
from benchmark.report.published import PARTS
from benchmark.seeds import SCENES
from benchmark.tuning.options import Size
from benchmark.world.cell import WorkCell
from benchmark.world.sensor import calibration_error, sensor_config
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import EllipseLocalizer, Localization
from vision.matching.parameters import MatchingParameters

PIECES = 4


@dataclass(frozen=True, eq=False)
class KnownScene:
    """What a localizer is given, and the truth.

    Attributes:
        part: name of the pieces' type.
        sensor: name of the sensor's preset.
        views: the pictures.
        workspace: where pieces can lie.
        pieces: the truth.
    """

    part: str
    sensor: str
    views: tuple[View, ...]
    workspace: Workspace
    pieces: tuple[TruePiece, ...]

    def visible(self, least: float) -> frozenset[int]:
        """Numbers of the pieces in the bin of which at least this share is visible."""
        return frozenset(i for i, p in enumerate(self.pieces) if p.in_bin and p.visibility >= least)

    def localize(self, parameters: MatchingParameters) -> Localization:
        """What the focal localizer finds with these settings, told what the sensor states of its calibration."""
        told = replace(parameters, calibration=calibration_error(sensor_config(self.sensor)))
        return EllipseLocalizer([load_model(self.part)], parameters=told).localize(self.views, self.workspace)


class _Witness(EpisodeObserver):
    """Keeps an episode's pictures and its truth."""

    def __init__(self) -> None:
        self.views: list[View] = []
        self.workspace: Workspace | None = None
        self.pieces: tuple[TruePiece, ...] = ()

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:  # noqa: ARG002
        self.workspace = workspace(cell.config)

    def looked(self, index: int, view: View) -> None:  # noqa: ARG002
        self.views.append(view)

    def localized(self, localization: Localization, verdict: Verdict) -> None:
        # The oracle names the true poses in the order of the pieces.
        self.pieces = tuple(
            TruePiece(piece.part, estimate.T_world_part, piece.visibility, piece.in_bin)
            for piece, estimate in zip(verdict.pieces, localization.estimates, strict=True)
        )


def known_scene(part: str, seed: int, sensor: str = "lab", pieces: int = PIECES) -> KnownScene:
    """Drop and photograph the scene of a part that a seed of ``SCENES`` stands for.

    Raises:
        ResourceError: this machine cannot draw.
    """
    witness = _Witness()
    config = EpisodeConfig(
        (part,),
        pieces=pieces,
        seed=episode_seed(seed, part, 0),
        sensor=sensor,
        localizer="oracle",
        task="none",
    )
    run_episode(config, witness)
    if witness.workspace is None:
        raise RuntimeError("an episode ended without having begun")
    return KnownScene(part, sensor, tuple(witness.views), witness.workspace, witness.pieces)


def known_scenes(use: str, size: Size, sensors: Sequence[str] = ("lab",), pieces: int = PIECES) -> list[KnownScene]:
    """The first scenes of each part and sensor for "tuning" or "validation"."""
    print_line(f"photographing {use} scenes")
    parts, seeds = PARTS[-1:] if size.quick else PARTS, SCENES[use][: size.number]
    return [known_scene(part, seed, sensor, pieces) for part in parts for sensor in sensors for seed in seeds]
