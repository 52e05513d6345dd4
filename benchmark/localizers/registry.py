"""Finds the localizer that a run asks for: this project's, the paper's, the oracle, or the user's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path

from benchmark.config import LADDER
from benchmark.localizers.ladder import make_rung
from benchmark.localizers.oracle import Oracle, Truth
from benchmark.localizers.user import REFERENCE, WatchedLocalizer, imported, make_watched, source_file
from vision.errors import InputError
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import PRESETS, EllipseLocalizer, Localization, Localizer, refuse_old_name
from vision.matching.parameters import MatchingParameters
from vision.model.vision_model import VisionModel
from vision.paper.localizer import PAPER_PRESETS, PaperLocalizer
from vision.pose.calibration import EXACT, CalibrationError

ENTRY_POINTS = "focalpick.localizers"


def make_localizer(
    name: str, models: Sequence[VisionModel], truth: Truth, calibration: CalibrationError = EXACT
) -> Localizer:
    """The localizer of that name.

    Args:
        name: ``focal``, ``focal-region``, ``focal-group``, ``paper``, ``previous``, ``oracle``, the name of an entry
            point in the group ``focalpick.localizers``, or ``package.module:factory``. A factory takes the taught
            models.
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
    if name in PAPER_PRESETS:
        return PaperLocalizer(models, name)
    if (rung := make_rung(name, models, MatchingParameters(calibration=calibration))) is not None:
        return rung
    refuse_old_name(name)
    if ":" in name:
        return make_watched(name, lambda: imported(name), models)
    registered = {point.name: point for point in entry_points(group=ENTRY_POINTS)}
    if name not in registered:
        known = ", ".join([*PRESETS, *PAPER_PRESETS, "oracle", *sorted(registered)])
        raise InputError("localizer", got=name, expected=f"{known}, or {REFERENCE}")
    return make_watched(name, registered[name].load, models, f"what {registered[name].value} names in its package")


def user_file(name: str) -> Path | None:
    """The file of the module that a user's localizer comes from; None where there is none, as for focalpick's own."""
    if name == "oracle" or name in LADDER:
        return None
    modules = {point.name: point.module for point in entry_points(group=ENTRY_POINTS)}
    module = name.partition(":")[0] if ":" in name else modules.get(name, "")
    return source_file(module)


def with_single_extractor_answers(
    localizer: Localizer, localization: Localization, views: Sequence[View], workspace: Workspace
) -> Localization:
    """The localization with what each extractor would have said alone, for localizers that have several."""
    paper = localizer.inner if isinstance(localizer, WatchedLocalizer) else localizer
    if not isinstance(paper, EllipseLocalizer):
        return localization
    return replace(localization, by_extractor=paper.alone(views, localization, workspace))
