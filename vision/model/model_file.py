"""Vision models as files: versioned JSON, described field by field in ``assets/models/vision_model.schema.json``."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import FileFormatError, InputError
from vision.extraction import ExtractionThresholds
from vision.features import Extractor, RegionAttributes
from vision.files.json_reader import JsonValue, parse, read_text
from vision.geometry.circle import Circle
from vision.model.grasp import BoreCoordinates, GraspCoordinates, GraspKind
from vision.model.vision_model import AttributeRange, CircleFeature, Pattern, Role, VisionModel

Array = NDArray[np.float64]

FORMAT = "focalpick-vision-model"
VERSION = 3

_ATTRIBUTES = tuple(f.name for f in fields(RegionAttributes))
_POSE_KEYS = ("translation_m", "rotation_xyzw")
_KEYS = (
    *("format", "version", "part", "diameter_m", "symmetry_fold"),
    *("features", "patterns", "grasps", "bore", "thresholds"),
)
_ROW_OF_NUMBERS = re.compile(r"\[\n\s+([-+.\deE]+(?:,\n\s+[-+.\deE]+)*)\n\s+\]")
_THRESHOLDS = tuple(f.name for f in fields(ExtractionThresholds))


def load_model(path: Path | str) -> VisionModel:
    """Read a model file.

    Raises:
        FileFormatError: when it is not a vision model, with the path to the field that is wrong.
        InputError: when there is no such file.
    """
    text = read_text(Path(path), "vision model", "Teach the part first.")
    return model_from_json(text, source=str(path))


def save_model(model: VisionModel, path: Path | str) -> None:
    """Write a model file.

    Raises:
        InputError: when the file cannot be written.
    """
    try:
        Path(path).write_text(model_to_json(model), encoding="utf-8", newline="\n")
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
        "patterns": [_pattern_to_dict(p) for p in model.patterns],
        "grasps": [_grasp_to_dict(g) for g in model.grasps],
        "bore": None if model.bore is None else _bore_to_dict(model.bore),
        "thresholds": thresholds_to_dict(model.thresholds),
    }
    text = json.dumps(document, indent=2, allow_nan=False) + "\n"
    # A point to a line. No text in the document matches: there, a line break is written as an escape.
    return _ROW_OF_NUMBERS.sub(lambda row: f"[{' '.join(row[1].split())}]", text)


def model_from_json(text: str, source: str = "vision model") -> VisionModel:
    """Read a model.

    Args:
        text: JSON.
        source: names the text in errors.

    Raises:
        FileFormatError: with the path to the field that is wrong.
    """
    root = parse(text, source, "vision model")
    root.check_header("vision model", FORMAT, VERSION)
    d = root.members(*_KEYS)
    try:
        return VisionModel(
            part=d["part"].text(),
            diameter_m=d["diameter_m"].positive(),
            features=tuple(_feature_from(item) for item in d["features"].items()),
            symmetry_fold=None if d["symmetry_fold"].value is None else d["symmetry_fold"].count(),
            grasps=tuple(_grasp_from(item) for item in d["grasps"].items()),
            bore=None if d["bore"].value is None else _bore_from(d["bore"]),
            thresholds=thresholds_from(d["thresholds"]),
            patterns=tuple(_pattern_from(item) for item in d["patterns"].items()),
        )
    except FileFormatError:
        raise
    except InputError as error:  # each value is good by itself, but they do not make a model
        raise FileFormatError(f"{source}: {error.what}", got=error.got, expected=error.expected) from error


def _number(value: float) -> float:
    """Nine significant digits, for what a person stated."""
    return float(f"{value:.9g}")


def _measured(value: float, decimals: int = 6) -> float:
    """What was measured in the views is written to a micrometre, a hundredth of what teaching aims at.

    The last bits of a measurement come from the machine: processors fuse multiplications and additions differently.
    What is coarser than they are by orders of magnitude seldom shows them.
    """
    return round(float(value), decimals) + 0.0


def _numbers(values: Array) -> list[float]:
    return [_number(v) + 0.0 for v in np.where(np.abs(values) < 1e-12, 0.0, values)]


def _pose_to_dict(T: RigidTransform) -> dict[str, Any]:
    # Rounded before its sign is settled: at half turns the sign would hang on the last bit of a zero.
    quaternion = Rotation.from_quat(np.round(T.rotation.as_quat(), 12)).as_quat(canonical=True)
    numbers = (_numbers(T.translation), _numbers(quaternion))
    return dict(zip(_POSE_KEYS, numbers, strict=True))


def _pose_from(d: dict[str, JsonValue]) -> RigidTransform:
    translation, rotation = (d[key] for key in _POSE_KEYS)
    return RigidTransform.from_components(translation.vector(3), Rotation.from_quat(rotation.unit(4)))


def _feature_to_dict(feature: CircleFeature) -> dict[str, Any]:
    return {
        "name": feature.name,
        "role": feature.role,
        "centre_m": [_measured(v) for v in feature.circle.centre],
        "normal": [_measured(v, 7) for v in feature.circle.normal],
        "radius_m": _measured(feature.circle.radius_m),
        "extractor": feature.extractor,
        "copies": feature.copies,
        "support": _measured(feature.support, 4),
        "attributes": {n: {"low": _measured(r.low, 4), "high": _measured(r.high, 4)} for n, r in feature.attributes},
    }


def _feature_from(item: JsonValue) -> CircleFeature:
    d = item.members("name", "role", "centre_m", "normal", "radius_m", "extractor", "copies", "support", "attributes")
    return CircleFeature(
        name=d["name"].text(),
        role=d["role"].choice(get_args(Role)),
        circle=Circle(d["centre_m"].vector(3), d["normal"].unit(3), d["radius_m"].positive()),
        extractor=d["extractor"].choice(get_args(Extractor)),
        copies=d["copies"].count(),
        support=d["support"].share(),
        attributes=tuple((name, _range_from(name, value)) for name, value in d["attributes"].mapping().items()),
    )


def _range_from(name: str, item: JsonValue) -> AttributeRange:
    JsonValue(name, item.source, item.path).choice(_ATTRIBUTES)
    d = item.members("low", "high")
    low, high = d["low"].number(), d["high"].number()
    item.check(low <= high, "low <= high")
    return AttributeRange(low, high)


def _pattern_to_dict(pattern: Pattern) -> dict[str, Any]:
    return {
        "name": pattern.name,
        "normal": [_measured(v, 7) for v in pattern.normal],
        "points_m": [[_measured(v) for v in point] for point in pattern.points],
        "directions": [[_measured(v, 7) for v in direction] for direction in pattern.directions],
    }


def _pattern_from(item: JsonValue) -> Pattern:
    d = item.members("name", "normal", "points_m", "directions")
    points = [point.vector(3) for point in d["points_m"].items()]
    directions = [direction.unit(3) for direction in d["directions"].items()]
    d["points_m"].check(len(points) > 0, "at least one point")
    d["directions"].check(len(directions) == len(points), f"{len(points)} directions, one for each point")
    return Pattern(d["name"].text(), d["normal"].unit(3), np.array(points), np.array(directions))


def _grasp_to_dict(grasp: GraspCoordinates) -> dict[str, Any]:
    return {
        "name": grasp.name,
        "kind": grasp.kind,
        "width_m": _number(grasp.width_m),
        "copies": grasp.copies,
        **_pose_to_dict(grasp.T_part_tcp),
    }


def _grasp_from(item: JsonValue) -> GraspCoordinates:
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


def _bore_from(item: JsonValue) -> BoreCoordinates:
    d = item.members("diameter_m", "depth_m", *_POSE_KEYS)
    return BoreCoordinates(_pose_from(d), d["diameter_m"].positive(), d["depth_m"].positive())


def thresholds_to_dict(thresholds: ExtractionThresholds) -> dict[str, float]:
    """Thresholds as a JSON object."""
    return {name: _number(getattr(thresholds, name)) for name in _THRESHOLDS}


def thresholds_from(item: JsonValue) -> ExtractionThresholds:
    """Thresholds from a JSON object.

    Raises:
        FileFormatError: with the path to the field that is wrong.
    """
    d = item.members(*_THRESHOLDS)
    values = {name: d[name].positive() for name in _THRESHOLDS}
    item.check(values["canny_low"] <= values["canny_high"], "canny_low <= canny_high")
    return ExtractionThresholds(**values)
