"""What the page asks of the program around it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.model.vision_model import VisionModel


@dataclass(frozen=True)
class Description:
    """What is known of the part before anybody has said anything."""

    name: str
    diameter_m: float
    symmetry_fold: int | None = None


@dataclass(frozen=True)
class PieceOutcome:
    """What became of one piece in a trial.

    Attributes:
        scene: number of the scene.
        status: "hit", "miss" or "false alarm".
        visible: how much of it could be seen, 0 to 1; None for a false alarm.
        translation_mm: error of the position; None unless hit.
        rotation_deg: error of the axis; None unless hit.
    """

    scene: int
    status: str
    visible: float | None = None
    translation_mm: float | None = None
    rotation_deg: float | None = None


@dataclass(frozen=True, eq=False)
@frozen_arrays
class SceneOutcome:
    """One scene of a trial: its pieces, and a picture (H, W, 3) RGB with the model drawn where it was found."""

    number: int
    pieces: tuple[PieceOutcome, ...]
    picture: NDArray[np.uint8] = field(repr=False)


class Services(Protocol):
    """Given by whoever opens the page; methods run in a process of their own, so it can be pickled."""

    @property
    def description(self) -> Description | None:
        """What is known of the part; None for pictures alone."""
        ...

    @property
    def trial_note(self) -> str:
        """One sentence: in what a trial looks for the part."""
        ...

    def try_model(
        self,
        model: VisionModel,
        views: Sequence[View],
        scenes: int,
        seed: int,
        report: Callable[[SceneOutcome], None],
    ) -> None:
        """Localise the part in fresh scenes with a model and report each scene when it is done."""
        ...


def run_trial(
    services: Services,
    model: VisionModel,
    views: Sequence[View],
    scenes: int,
    seed: int,
    report: Callable[[SceneOutcome], None],
) -> None:
    """``Services.try_model`` as a function, to be called in another process."""
    services.try_model(model, views, scenes, seed, report)
