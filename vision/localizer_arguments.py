"""What a localizer is given, checked before anything is computed: wrong names would find nothing, and not say why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeVar, get_args

from vision.camera import View
from vision.candidates import Workspace
from vision.errors import InputError
from vision.features import Process
from vision.matching_parameters import MatchingParameters
from vision.vision_model import VisionModel

T = TypeVar("T")

PRESETS: dict[str, tuple[Process, ...]] = {"dual": ("region", "group"), "region": ("region",), "group": ("group",)}
"""The paper's system, its predecessor [18], and edge grouping alone: which extractors each has."""


def processes_of(choice: str | Sequence[str]) -> tuple[Process, ...]:
    """The extractors that a preset's name stands for, or that are named one by one; region growing comes first.

    Raises:
        InputError: when there is no such preset or extractor, or none is named.
    """
    named = PRESETS.get(choice, ()) if isinstance(choice, str) else tuple(choice)
    known: tuple[Process, ...] = get_args(Process)
    if not named or not all(name in known for name in named):
        expected = f"{', '.join(PRESETS)}, or a tuple with one or more of {', '.join(known)}"
        raise InputError("extractors", got=repr(choice), expected=expected)
    return tuple(process for process in known if process in named)


def checked_models(models: Sequence[VisionModel]) -> tuple[VisionModel, ...]:
    """The taught parts to look for.

    Raises:
        InputError: when there are none, or they are something else.
    """
    found = _sequence(models, VisionModel, "models", "Read one with vision.load_model(file).")
    if not found:
        raise InputError("models", got="none", expected="at least one taught model")
    return found


def checked_parameters(parameters: MatchingParameters | None) -> MatchingParameters:
    """Settings of the matching, the default ones for None.

    Raises:
        InputError: when they are those of something else.
    """
    if not isinstance(parameters, MatchingParameters | None):
        got = f"{type(parameters).__name__} object"
        raise InputError("parameters of the localizer", got=got, expected="vision.MatchingParameters or None")
    return parameters or MatchingParameters()


def checked_scene(views: Sequence[View], workspace: Workspace | None) -> tuple[View, ...]:
    """The views that a localizer is to look at.

    Raises:
        InputError: when they are not a sequence of views, or the workspace is none.
    """
    if not isinstance(workspace, Workspace | None):
        raise InputError("workspace", got=f"{type(workspace).__name__} object", expected="a vision.Workspace or None")
    return _sequence(views, View, "views", "Make one of image, camera and pose.")


def _sequence(values: Iterable[T], kind: type[T], what: str, do: str) -> tuple[T, ...]:
    expected = f"a sequence of vision.{kind.__name__} objects"
    if isinstance(values, kind):
        raise InputError(what, got=f"a single {kind.__name__}", expected=expected, do="Put it into a list.")
    if not isinstance(values, Iterable):
        raise InputError(what, got=f"{type(values).__name__} object", expected=expected, do=do)
    found = tuple(values)
    for value in found:
        if not isinstance(value, kind):
            raise InputError(what, got=f"{type(value).__name__} object", expected=expected, do=do)
    return found
