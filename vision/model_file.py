"""Vision models as files: versioned JSON, described field by field in ``assets/models/vision_model.schema.json``."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.circle_pose import Circle
from vision.errors import FileFormatError, InputError
from vision.features import Process, RegionAttributes
from vision.vision_model import (
    AttributeRange,
    BoreCoordinates,
    CircleFeature,
    GraspCoordinates,
    GraspKind,
    Role,
    VisionModel,
)

Array = NDArray[np.float64]

FORMAT = "focalpick-vision-model"
VERSION = 1

_ATTRIBUTES = tuple(f.name for f in fields(RegionAttributes))
_POSE_KEYS = ("translation_m", "rotation_xyzw")
_UNIT_TOLERANCE = 1e-6  # numbers are written with nine significant digits


def load_model(path: Path) -> VisionModel:
    """Read a model file.

    Raises:
        FileFormatError: when it is not a vision model, with the path to the field that is wrong.
        InputError: when there is no such file.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError(
            "vision model", got=f"{path} ({error})", expected="a readable file", do="Teach the part first."
        ) from error
    except UnicodeDecodeError as error:
        raise FileFormatError(str(path), got=f"not UTF-8 ({error})", expected="a vision model in JSON") from error
    return model_from_json(text, source=str(path))


def save_model(model: VisionModel, path: Path) -> None:
    """Write a model file.

    Raises:
        InputError: when the file cannot be written.
    """
    try:
        path.write_text(model_to_json(model), encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError("file for the vision model", got=f"{path} ({error})", expected="a writable path") from error


def model_to_json(model: VisionModel) -> str:
    """The model as JSON text, the same bytes for the same model."""
    document = {
        "format": FORMAT,
        "version": VERSION,
        "part": model.part,
        "diameter_m": _number(model.diameter_m),
        "symmetry_fold": model.symmetry_fold,
        "features": [_feature_to_dict(f) for f in model.features],
        "grasps": [_grasp_to_dict(g) for g in model.grasps],
        "bore": None if model.bore is None else _bore_to_dict(model.bore),
    }
    return json.dumps(document, indent=2, allow_nan=False) + "\n"


def model_from_json(text: str, source: str = "vision model") -> VisionModel:
    """Read a model.

    Args:
        text: JSON.
        source: names the text in errors.

    Raises:
        FileFormatError: with the path to the field that is wrong.
    """
    try:
        root = _Value(json.loads(text), source)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(source, got=f"invalid JSON ({error})", expected="a vision model") from error
    root.check_header()
    d = root.members("format", "version", "part", "diameter_m", "symmetry_fold", "features", "grasps", "bore")
    try:
        return VisionModel(
            part=d["part"].text(),
            diameter_m=d["diameter_m"].positive(),
            features=tuple(_feature_from(item) for item in d["features"].items()),
            symmetry_fold=None if d["symmetry_fold"].value is None else d["symmetry_fold"].count(),
            grasps=tuple(_grasp_from(item) for item in d["grasps"].items()),
            bore=None if d["bore"].value is None else _bore_from(d["bore"]),
        )
    except FileFormatError:
        raise
    except InputError as error:  # each value is good by itself, but they do not make a model
        raise FileFormatError(f"{source}: {error.what}", got=error.got, expected=error.expected) from error


@dataclass(frozen=True)
class _Value:
    """A value in the document, and the path that leads to it."""

    value: Any
    source: str
    path: str = ""

    def check(self, condition: bool, expected: str) -> None:
        if not condition:
            got = repr(self.value)
            where = f"{self.source}: {self.path}" if self.path else self.source
            raise FileFormatError(where, got=got if len(got) <= 80 else f"{got[:77]}...", expected=expected)

    def check_header(self) -> None:
        """Say of a foreign file that it is foreign, not which keys it lacks."""
        self.check(isinstance(self.value, dict), "a vision model: a JSON object")
        for key, expected in (("format", FORMAT), ("version", VERSION)):
            found = self.value.get(key)
            _Value(found, self.source, key).check(
                type(found) is type(expected) and found == expected, json.dumps(expected)
            )

    def members(self, *keys: str) -> dict[str, _Value]:
        """The members of an object that has exactly these keys."""
        mine = self.mapping()
        for key in keys:
            if key not in mine:
                raise FileFormatError(f"{self.source}: {self._inner(key)}", got="no such key", expected="this key")
        for key in mine:
            if key not in keys:
                got, expected = "an unknown key", f"one of {', '.join(keys)}"
                raise FileFormatError(f"{self.source}: {self._inner(key)}", got=got, expected=expected)
        return mine

    def mapping(self) -> dict[str, _Value]:
        self.check(isinstance(self.value, dict), "an object")
        return {k: _Value(v, self.source, self._inner(k)) for k, v in self.value.items()}

    def items(self) -> list[_Value]:
        self.check(isinstance(self.value, list), "a list")
        return [_Value(v, self.source, f"{self.path}[{i}]") for i, v in enumerate(self.value)]

    def text(self) -> str:
        self.check(isinstance(self.value, str) and self.value != "", "a text that is not empty")
        return str(self.value)

    def choice(self, choices: Sequence[str]) -> Any:
        self.check(isinstance(self.value, str) and self.value in choices, f"one of {', '.join(choices)}")
        return self.value

    def number(self) -> float:
        number = isinstance(self.value, int | float) and not isinstance(self.value, bool)
        self.check(number and abs(self.value) <= sys.float_info.max, "a finite number")
        return float(self.value)

    def positive(self) -> float:
        self.check(self.number() > 0, "a number > 0")
        return float(self.value)

    def share(self) -> float:
        self.check(0 <= self.number() <= 1, "a number from 0 to 1")
        return float(self.value)

    def count(self) -> int:
        whole = isinstance(self.value, int) and not isinstance(self.value, bool)
        self.check(whole and self.value >= 1, "a whole number >= 1")
        return int(self.value)

    def vector(self, n: int) -> Array:
        numbers = self.items()
        self.check(len(numbers) == n, f"{n} numbers")
        return np.array([item.number() for item in numbers])

    def unit(self, n: int) -> Array:
        vector = self.vector(n)
        # Compared before the norm is taken: large numbers would overflow in it.
        near = bool((np.abs(vector) < 2).all()) and abs(float(np.linalg.norm(vector)) - 1) < _UNIT_TOLERANCE
        self.check(near, f"{n} numbers of length 1")
        return vector

    def _inner(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key


def _number(value: float) -> float:
    """Nine significant digits: nanometres, and the same text on every platform."""
    return float(f"{value:.9g}")


def _numbers(values: Array) -> list[float]:
    return [_number(v) + 0.0 for v in np.where(np.abs(values) < 1e-12, 0.0, values)]


def _pose_to_dict(T: RigidTransform) -> dict[str, Any]:
    numbers = (_numbers(T.translation), _numbers(T.rotation.as_quat(canonical=True)))
    return dict(zip(_POSE_KEYS, numbers, strict=True))


def _pose_from(d: dict[str, _Value]) -> RigidTransform:
    translation, rotation = (d[key] for key in _POSE_KEYS)
    return RigidTransform.from_components(translation.vector(3), Rotation.from_quat(rotation.unit(4)))


def _feature_to_dict(feature: CircleFeature) -> dict[str, Any]:
    return {
        "name": feature.name,
        "role": feature.role,
        "centre_m": _numbers(feature.circle.centre),
        "normal": _numbers(feature.circle.normal),
        "radius_m": _number(feature.circle.radius_m),
        "extractor": feature.extractor,
        "copies": feature.copies,
        "support": _number(feature.support),
        "attributes": {n: {"low": _number(r.low), "high": _number(r.high)} for n, r in feature.attributes},
    }


def _feature_from(item: _Value) -> CircleFeature:
    d = item.members("name", "role", "centre_m", "normal", "radius_m", "extractor", "copies", "support", "attributes")
    return CircleFeature(
        name=d["name"].text(),
        role=d["role"].choice(get_args(Role)),
        circle=Circle(d["centre_m"].vector(3), d["normal"].unit(3), d["radius_m"].positive()),
        extractor=d["extractor"].choice(get_args(Process)),
        copies=d["copies"].count(),
        support=d["support"].share(),
        attributes=tuple((name, _range_from(name, value)) for name, value in d["attributes"].mapping().items()),
    )


def _range_from(name: str, item: _Value) -> AttributeRange:
    _Value(name, item.source, item.path).choice(_ATTRIBUTES)
    d = item.members("low", "high")
    low, high = d["low"].number(), d["high"].number()
    item.check(low <= high, "low <= high")
    return AttributeRange(low, high)


def _grasp_to_dict(grasp: GraspCoordinates) -> dict[str, Any]:
    return {
        "name": grasp.name,
        "kind": grasp.kind,
        "width_m": _number(grasp.width_m),
        "copies": grasp.copies,
        **_pose_to_dict(grasp.T_part_tcp),
    }


def _grasp_from(item: _Value) -> GraspCoordinates:
    d = item.members("name", "kind", "width_m", "copies", *_POSE_KEYS)
    return GraspCoordinates(
        name=d["name"].text(),
        T_part_tcp=_pose_from(d),
        width_m=d["width_m"].positive(),
        kind=d["kind"].choice(get_args(GraspKind)),
        copies=d["copies"].count(),
    )


def _bore_to_dict(bore: BoreCoordinates) -> dict[str, Any]:
    return {
        "diameter_m": _number(bore.diameter_m),
        "depth_m": _number(bore.depth_m),
        **_pose_to_dict(bore.T_part_bore),
    }


def _bore_from(item: _Value) -> BoreCoordinates:
    d = item.members("diameter_m", "depth_m", *_POSE_KEYS)
    return BoreCoordinates(_pose_from(d), d["diameter_m"].positive(), d["depth_m"].positive())
