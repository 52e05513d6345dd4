"""Frozen dataclasses hold read-only arrays, in every package, also as copies and after a trip to another process."""

from __future__ import annotations

import copy
import pickle
import pkgutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass, replace
from importlib import import_module
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

import benchmark
import robot
import vision
from robot.arm import JointLimits
from robot.gripper_geometry import Boxes
from robot.trajectory import Trajectory
from vision.drawing.strokes import plain_strokes
from vision.frozen import frozen_arrays, read_only
from vision.geometry.camera import Camera, View
from vision.geometry.circle import Circle
from vision.geometry.ellipse import Ellipse
from vision.model.projection import ContourSamples
from vision.model.vision_model import Pattern
from vision.pose.estimate import PoseEstimate


@dataclass(frozen=True, eq=False)
class Forgetful:
    """Not decorated."""

    name: str
    lines: tuple[NDArray[np.float64], ...]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Careful:
    name: str
    lines: dict[int, NDArray[np.float64]]
    samples: ContourSamples | None = None


def holds_arrays(annotation: Any) -> bool:
    """Whether values of a type are arrays or have some in them."""
    kind = get_origin(annotation) or annotation
    if isinstance(kind, type) and (issubclass(kind, np.ndarray) or hasattr(kind, "_fields")):
        return issubclass(kind, np.ndarray) or any(map(holds_arrays, get_type_hints(kind).values()))
    return any(map(holds_arrays, get_args(annotation)))


def annotations(cls: type) -> dict[str, Any]:
    """The types of a dataclass's fields, without those that are imported for type checking only."""
    found, names = {}, vars(import_module(cls.__module__))
    for field in fields(cls):
        alone = type("Alone", (), {"__annotations__": {field.name: field.type}})
        with suppress(NameError):
            found |= get_type_hints(alone, names)
    return found


def frozen_classes(*packages: Any) -> list[type]:
    """All frozen dataclasses in some packages that hold arrays."""
    modules = [m.name for p in packages for m in pkgutil.walk_packages(p.__path__, f"{p.__name__}.")]
    return [
        cls
        for module in modules
        for cls in vars(import_module(module)).values()
        if isinstance(cls, type) and cls.__module__ == module and _is_frozen(cls)
        if any(map(holds_arrays, annotations(cls).values()))
    ]


def _is_frozen(cls: Any) -> bool:
    return is_dataclass(cls) and cls.__dataclass_params__.frozen


NORMAL = np.array([0.0, 0.0, 1.0])
CHECKED: dict[type, Callable[[], Any]] = {
    Boxes: lambda: Boxes(np.zeros((1, 3)), np.eye(3)[None], np.ones((1, 3))),
    Circle: lambda: Circle(np.zeros(3), NORMAL, 0.1),
    Ellipse: lambda: Ellipse(np.array([1.0, 0.0, -1.0, 0.0, 4.0]), np.eye(5)),
    JointLimits: lambda: JointLimits(-np.ones(6), *np.ones((4, 6))),
    Pattern: lambda: Pattern("slots", NORMAL, np.zeros((2, 3)), np.tile(NORMAL, (2, 1))),
    PoseEstimate: lambda: PoseEstimate("hub", RigidTransform.identity(), np.eye(6), 0.9, "region", 0.1, 3, True),
    type(plain_strokes([], (0, 0, 0))): lambda: plain_strokes([np.zeros((4, 2))], (255, 0, 0)),
    Trajectory: lambda: Trajectory(np.zeros((2, 6)), np.zeros((2, 6)), 0.004),
    View: lambda: View(np.zeros((6, 8), np.uint8), Camera(8, 6, 8.0, 8.0, 3.5, 2.5), RigidTransform.identity()),
}
"""Those whose constructor wants more than any arrays."""


def example(cls: type) -> Any:
    """A value of a class, with arrays wherever it may hold some."""
    if cls in CHECKED:
        return CHECKED[cls]()
    known = annotations(cls)
    return cls(**{f.name: _dummy(known.get(f.name)) for f in fields(cls)})


def _dummy(annotation: Any) -> Any:
    kind, inner = get_origin(annotation) or annotation, get_args(annotation)
    if not holds_arrays(annotation):
        return None
    if isinstance(kind, type) and issubclass(kind, np.ndarray):
        return np.zeros((2, 3))
    if kind is tuple:
        return (np.zeros((2, 3)),)
    if len(inner) == 2 and not holds_arrays(inner[0]):  # a mapping
        return {0: np.zeros((2, 3))}
    return _dummy(next(filter(holds_arrays, inner)))


def arrays_in(value: Any) -> list[np.ndarray]:
    if isinstance(value, np.ndarray):
        return [value]
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, tuple) else ()
    return [array for each in inside for array in arrays_in(each)]


def is_frozen_throughout(value: Any) -> bool:
    """Whether a dataclass holds arrays and no writable one."""
    arrays = arrays_in(tuple(getattr(value, field.name) for field in fields(value)))
    return bool(arrays) and not any(array.flags.writeable for array in arrays)


@pytest.mark.parametrize("cls", frozen_classes(vision, robot, benchmark), ids=lambda cls: cls.__qualname__)
def test_the_arrays_are_read_only(cls):
    value = example(cls)
    for held in (value, replace(value), copy.copy(value), pickle.loads(pickle.dumps(value))):
        assert is_frozen_throughout(held), f"@frozen_arrays is missing below the @dataclass of {cls.__qualname__}"


def test_a_class_that_forgets_is_found():
    assert _is_frozen(Forgetful)
    assert any(map(holds_arrays, annotations(Forgetful).values()))
    assert not is_frozen_throughout(example(Forgetful))


def test_arrays_are_found_wherever_they_are():
    samples = ContourSamples(*np.zeros((3, 3, 5)), np.zeros(5, np.intp), np.zeros((0, 2, 5)), 0.01)
    value = Careful("rim", {1: np.zeros((4, 2))}, samples)
    assert is_frozen_throughout(value)
    assert len(arrays_in((value.lines, value.samples))) == 6
    assert isinstance(value.samples, ContourSamples)
    assert value.samples.margin_m == 0.01


def test_nothing_is_copied_and_the_maker_may_go_on_writing():
    mine = np.zeros((4, 2))
    held = read_only(mine)
    mine[0] = 1.0
    assert held[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        held[0] = 2.0


def test_what_was_computed_is_not_pickled():
    value = Careful("rim", {1: np.zeros((4, 2))})
    vars(value)["computed"] = 7
    assert not hasattr(pickle.loads(pickle.dumps(value)), "computed")
