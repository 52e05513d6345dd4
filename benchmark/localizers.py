"""Finds the localizer that a run asks for: the paper's, the oracle, or the user's own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmark.user_localizer import REFERENCE, WatchedLocalizer, imported, make_watched
from benchmark.world.mesh_file import MeshReference
from vision.errors import InputError
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import PRESETS, EllipseLocalizer, Localization, Localizer
from vision.matching.parameters import MatchingParameters
from vision.model import model_file
from vision.model.vision_model import VisionModel
from vision.pose.calibration import EXACT, CalibrationError
from vision.pose.estimate import PoseEstimate

MODELS = Path(__file__).resolve().parents[1] / "assets" / "models"
ENTRY_POINTS = "focalpick.localizers"
Truth = Callable[[], Sequence[tuple[str, RigidTransform]]]


@lru_cache
def load_model(part: str, models: str | None = None) -> VisionModel:
    """The taught vision model of a part, under the name by which the scene knows the part.

    Args:
        part: its name, or a mesh file; the model's file has the name of the part, or of the mesh file without suffix.
        models: directory of models that come before the shipped ones.

    Raises:
        InputError: the part was never taught.
        FileFormatError: the model file is corrupt.
    """
    mesh = MeshReference.parse(part)
    file = f"{part if mesh is None else mesh.path.stem}.json"
    places = [MODELS / file] if models is None else [Path(models) / file, MODELS / file]
    model = model_file.load_model(next((path for path in places if path.is_file()), places[0]))
    return model if mesh is None else replace(model, part=part)


def make_localizer(
    name: str, models: Sequence[VisionModel], truth: Truth, calibration: CalibrationError = EXACT
) -> Localizer:
    """The localizer of that name.

    Args:
        name: ``dual``, ``region``, ``group``, ``oracle``, the name of an entry point in the group
            ``focalpick.localizers``, or ``package.module:factory``. A factory takes the taught models.
        models: the taught models of the parts in the scene.
        truth: part name and true pose of every piece; handed to the oracle alone.
        calibration: how large the errors of the calibration are on average.

    Raises:
        InputError: there is no such localizer.
        LocalizerError: the user's own cannot be imported or made, or is none.
    """
    if name == "oracle":
        return Oracle(truth)
    if name in PRESETS:
        return EllipseLocalizer(models, name, MatchingParameters(calibration=calibration))
    if ":" in name:
        return make_watched(name, lambda: imported(name), models)
    registered = {point.name: point for point in entry_points(group=ENTRY_POINTS)}
    if name not in registered:
        known = ", ".join([*PRESETS, "oracle", *sorted(registered)])
        raise InputError("localizer", got=name, expected=f"{known}, or {REFERENCE}")
    return make_watched(name, registered[name].load, models, f"what {registered[name].value} names in its package")


def with_answers_alone(
    localizer: Localizer, localization: Localization, views: Sequence[View], workspace: Workspace
) -> Localization:
    """The localization with what each extractor would have said alone, for localizers that have several."""
    paper = localizer.inner if isinstance(localizer, WatchedLocalizer) else localizer
    if not isinstance(paper, EllipseLocalizer):
        return localization
    return replace(localization, by_process=paper.alone(views, localization, workspace))


@dataclass(frozen=True)
class Oracle:
    """Knows where everything lies: the upper bound for vision, and the way to test picking alone."""

    truth: Truth
    name: str = "oracle"

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:  # noqa: ARG002
        """The true poses, whatever the views show."""
        return Localization(
            tuple(
                PoseEstimate(part, pose, 1e-12 * np.eye(6), 1.0, "oracle", 0.0, len(views), inplane_known=True)
                for part, pose in self.truth()
            )
        )
