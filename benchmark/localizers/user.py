"""A user's own localizer: found by its name, made, and watched, so that its mistakes are told from focalpick's."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import operator
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform

from benchmark.localizers.errors import LocalizerError
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace
from vision.localizer import Localization, Localizer
from vision.model.vision_model import VisionModel
from vision.pose.estimate import PoseEstimate

REFERENCE = "package.module:factory"
LOCALIZE = "localize(views, workspace) that returns a vision.Localization"
_PACKAGES = tuple(str(Path(__file__).resolve().parents[2] / name) for name in ("benchmark", "vision", "robot"))
_LIBRARIES = tuple({path for key, path in sysconfig.get_paths().items() if "lib" in key})


class WatchedLocalizer:
    """A user's localizer whose errors name the user's file, and whose answers are what they should be.

    Attributes:
        inner: the user's object.
        name: its name.
    """

    def __init__(self, inner: Localizer, reference: str, models: Sequence[VisionModel]) -> None:
        """Watch a localizer.

        Args:
            inner: the user's object.
            reference: how the user called it.
            models: what it was made from.
        """
        self.inner, self.name = inner, inner.name
        self._reference, self._parts = reference, tuple(model.part for model in models)

    def localize(self, views: Sequence[View], workspace: Workspace | None = None) -> Localization:
        """The user's answer.

        Raises:
            LocalizerError: the user's code raised an error, or the answer is no localization of these views.
        """
        with _attributed_to(self._reference, self.inner.localize, LOCALIZE):
            answer = self.inner.localize(views, workspace)
        return self._checked(answer, len(views))

    def _checked(self, answer: object, views: int) -> Localization:
        if not isinstance(answer, Localization):
            raise self._refused(_described(answer), "a vision.Localization, Localization(()) where nothing is found")
        methods = {self.name: answer.estimates, **answer.by_extractor}
        for estimate in (estimate for found in methods.values() for estimate in found):
            self._check_estimate(estimate)
        if answer.features and len(answer.features) != views:
            raise self._refused(f"features of {len(answer.features)} views", f"those of {views} views, or none")
        by_extractor = {name: tuple(found) for name, found in answer.by_extractor.items()}
        return replace(answer, estimates=tuple(answer.estimates), by_extractor=by_extractor)

    def _check_estimate(self, estimate: object) -> None:
        if not isinstance(estimate, PoseEstimate):
            raise self._refused(f"{_described(estimate)} among the estimates", "vision.PoseEstimate objects")
        if estimate.part not in self._parts:
            raise self._refused(f"an estimate of part {estimate.part!r}", f"one of {', '.join(self._parts)}")
        pose = estimate.T_world_part
        if not isinstance(pose, RigidTransform) or not pose.single or not np.isfinite(pose.as_matrix()).all():
            raise self._refused(f"T_world_part = {pose}", "a finite scipy RigidTransform")

    def _refused(self, got: str, expected: str) -> LocalizerError:
        do = f"Correct localize in {_definition(self.inner.localize)}."
        return LocalizerError(f"localizer {self._reference}", got=got, expected=expected, do=do)


def make_watched(
    reference: str, load: Callable[[], object], models: Sequence[VisionModel], expected: str = REFERENCE
) -> WatchedLocalizer:
    """Make a user's localizer.

    Args:
        reference: how the user called it.
        load: gives the factory.
        models: the taught models, which the factory is given.
        expected: what the reference should be.

    Raises:
        LocalizerError: the user's code raised an error, or what it made is no localizer.
    """
    with _attributed_to(reference, None, expected):
        factory = load()
    what = f"localizer {reference}"
    if not callable(factory):
        raise LocalizerError(what, got=_described(factory), expected="a function of the taught models")
    _check_call(what, factory, "a function of the taught models", models)
    with _attributed_to(reference, factory, f"a function of the taught models that makes an object with {LOCALIZE}"):
        made = factory(models)
        usable = isinstance(made, Localizer) and not inspect.isclass(made) and isinstance(made.name, str)
    if not usable:
        got = f"the class {made.__name__} itself" if inspect.isclass(made) else _described(made)
        do = f"Return such an object in {_definition(factory)}."
        raise LocalizerError(what, got=got, expected="an object with a name and localize(views, workspace)", do=do)
    _check_call(what, made.localize, "localize(views, workspace)", (), None)
    return WatchedLocalizer(made, reference, models)


def imported(reference: str) -> object:
    """What ``package.module:factory`` names.

    Raises:
        LocalizerError: there is no such module or name in it.
    """
    module, _, attribute = reference.partition(":")
    here = _look_here()
    try:
        return operator.attrgetter(attribute)(importlib.import_module(module))
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module}.".startswith(f"{error.name}."):
            raise  # the user's module is there, and misses another one
        do = f"Look for the file below {here}, or install its package."
        raise LocalizerError("localizer", got=f"{reference} ({error})", expected=REFERENCE, do=do) from None
    except (AttributeError, ValueError) as error:  # ValueError: the module's name is empty
        if _users_frames(error):
            raise
        raise LocalizerError("localizer", got=f"{reference} ({error})", expected=REFERENCE) from None


def source_file(module: str) -> Path | None:
    """The file of a module; None where there is no such module, or it has no file."""
    _look_here()
    try:
        spec = importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin else None


def _look_here() -> str:
    """Have modules found in the working directory, where an installed command does not look."""
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    return here


@contextmanager
def _attributed_to(reference: str, code: object, expected: str) -> Iterator[None]:
    """Turn whatever the user's code raises into an error that says so; Ctrl-C is nobody's mistake.

    Args:
        reference: how the user called the localizer.
        code: what is called, None while it is imported.
        expected: of it.
    """
    try:
        yield
    except LocalizerError:
        raise
    except (Exception, SystemExit) as error:
        place = _place(error) or (_definition(code) if code is not None else "")
        said = error.msg if isinstance(error, SyntaxError) else error  # whose text names the place once more
        text = " ".join(f"{type(error).__name__}: {said}".split()).removesuffix(":")
        raise LocalizerError(
            f"localizer {reference}",
            got=f"{text}{f' ({place})' if place else ''}",
            expected=expected,
            do=f"Correct {place.partition(', line')[0] or 'its module'}.",
        ) from error


def _check_call(what: str, function: Callable[..., object], expected: str, *arguments: object) -> None:
    """Refuse a function that does not take the arguments, before anything runs."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # compiled code need not tell
        return
    try:
        signature.bind(*arguments)
    except TypeError as error:
        name = getattr(function, "__name__", type(function).__name__)
        do = f"Change {_definition(function)}."
        raise LocalizerError(what, got=f"{name}{signature}: {error}", expected=expected, do=do) from None


def _users_frames(error: BaseException) -> list[traceback.FrameSummary]:
    """The frames of a traceback outside focalpick and the import machinery, outermost first."""
    frames = traceback.extract_tb(error.__traceback__)
    return [
        f for f in frames if not f.filename.startswith((*_PACKAGES, "<")) and not f.filename.startswith(_stdlib())
    ]


def _place(error: BaseException) -> str:
    """File and line of the user's code where an error comes from; the innermost that is in no library."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}, line {error.lineno}"
    frames = _users_frames(error)
    own = [f for f in frames if not f.filename.startswith(_LIBRARIES)] or frames
    return f"{own[-1].filename}, line {own[-1].lineno}" if own else ""


def _stdlib() -> str:
    return str(Path(importlib.__file__).parent)


def _definition(code: object) -> str:
    """File and line where a function, method or class is defined; its name where that cannot be told."""
    for thing in (code, type(code)):
        try:
            return f"{inspect.getsourcefile(thing)}, line {inspect.getsourcelines(thing)[1]}"  # type: ignore[arg-type]
        except (TypeError, OSError):
            continue
    return getattr(code, "__name__", type(code).__name__)


def _described(value: object) -> str:
    return "None" if value is None else f"{type(value).__name__} object"
