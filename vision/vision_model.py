"""The vision model: what a person taught about a part, sufficient to recognise it and compute its pose.

Sections 2, 4 and 6: a small number of salient and supporting features, which extractor to use for each, and the
grasp coordinates. It is not a CAD model. The model is stored as versioned JSON; metres and radians throughout.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.circle_pose import Circle
from vision.errors import FileFormatError, InputError
from vision.features import Process

Array = NDArray[np.float64]
Role = Literal["salient", "supporting"]
FORMAT = "focalpick-vision-model"
VERSION = 1


@dataclass(frozen=True)
class AttributeRange:
    """The smallest and the largest value that a region attribute took in the taught views."""

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class CircleFeature:
    """A circular feature of the part, in the part's frame.

    Attributes:
        name: what the person called it.
        role: "salient" features make hypotheses, "supporting" ones confirm them (Section 6).
        circle: its circle; the normal points to the side from which it is seen.
        extractor: the extractor to be tried first.
        copies: number of equal features, evenly spaced around the part's axis (bolt holes).
        support: the part of the circumference along which edges were seen in the taught views, 0 to 1.
        attributes: ranges of the region attributes in the taught views, by name.
    """

    name: str
    role: Role
    circle: Circle
    extractor: Process
    copies: int = 1
    support: float = 1.0
    attributes: tuple[tuple[str, AttributeRange], ...] = ()

    def circles(self) -> list[Circle]:
        """The circles of all copies."""
        turns = Rotation.from_rotvec(np.outer(np.arange(self.copies) * 2 * np.pi / self.copies, [0.0, 0.0, 1.0]))
        matrices = turns.as_matrix()
        return [Circle(R @ self.circle.centre, R @ self.circle.normal, self.circle.radius_m) for R in matrices]


@dataclass(frozen=True, eq=False)
class GraspCoordinates:
    """Where the gripper may take the part (Fig. 2 b).

    Attributes:
        name: label.
        T_part_tcp: pose of the tool centre point: z approaches, x is the direction in which the fingers open.
        width_m: gap between the fingers at contact ("outside"), or distance of their outer faces ("inside").
        kind: close on the outside, or open in a bore.
        copies: number of equally good rotations about the part's axis.
    """

    name: str
    T_part_tcp: RigidTransform
    width_m: float
    kind: Literal["outside", "inside"]
    copies: int = 1


@dataclass(frozen=True, eq=False)
class BoreCoordinates:
    """The bore for peg-in-hole: the origin is the centre of the entry rim, z points into the bore."""

    T_part_bore: RigidTransform
    diameter_m: float
    depth_m: float


@dataclass(frozen=True, eq=False)
class VisionModel:
    """A taught part.

    Attributes:
        part: name of the part.
        diameter_m: outline diameter.
        features: salient and supporting features.
        symmetry_fold: number of rotations about z that look the same; None when every rotation does.
        grasps: grasp coordinates.
        bore: the bore, where the part has one.
    """

    part: str
    diameter_m: float
    features: tuple[CircleFeature, ...]
    symmetry_fold: int | None = None
    grasps: tuple[GraspCoordinates, ...] = ()
    bore: BoreCoordinates | None = None

    def __post_init__(self) -> None:
        if not self.salient:
            raise InputError(
                f"vision model of {self.part}", got="no salient feature", expected="at least one", do="Teach one."
            )
        for feature in self.salient:
            off_axis = np.hypot(*feature.circle.centre[:2])
            if feature.copies != 1 or off_axis > 0.02 * self.diameter_m or abs(feature.circle.normal[2]) < 0.99:
                raise InputError(
                    f"salient feature {feature.name!r} of {self.part}",
                    got=f"centre {feature.circle.centre.round(5).tolist()}, {feature.copies} copies",
                    expected="one circle around the part's z axis",
                    do="Teach it as a supporting feature instead.",
                )

    @property
    def salient(self) -> tuple[CircleFeature, ...]:
        """The features that make hypotheses."""
        return tuple(f for f in self.features if f.role == "salient")

    @property
    def supporting(self) -> tuple[CircleFeature, ...]:
        """The features that confirm them."""
        return tuple(f for f in self.features if f.role == "supporting")

    def to_json(self) -> str:
        """The model as JSON text, the same bytes for the same model."""
        document = {
            "format": FORMAT,
            "version": VERSION,
            "part": self.part,
            "diameter_m": _number(self.diameter_m),
            "symmetry_fold": self.symmetry_fold,
            "features": [_feature_to_dict(f) for f in self.features],
            "grasps": [_grasp_to_dict(g) for g in self.grasps],
            "bore": None if self.bore is None else _bore_to_dict(self.bore),
        }
        return json.dumps(document, indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str, source: str = "vision model") -> VisionModel:
        """Read a model; ``source`` names it in errors.

        Raises:
            FileFormatError: with the path to the field that is wrong.
        """
        reader = _Reader(source)
        try:
            root = json.loads(text)
        except json.JSONDecodeError as error:
            raise FileFormatError(source, got=f"invalid JSON ({error})", expected="a vision model") from error
        reader.check(isinstance(root, dict) and root.get("format") == FORMAT, "format", FORMAT, root)
        reader.check(root.get("version") == VERSION, "version", str(VERSION), root.get("version"))
        bore = root.get("bore")
        return cls(
            part=reader.text(root, "part"),
            diameter_m=reader.positive(root, "diameter_m"),
            features=tuple(_feature_from_dict(reader, d, p) for d, p in reader.items(root, "features")),
            symmetry_fold=None if root.get("symmetry_fold") is None else reader.count(root, "symmetry_fold"),
            grasps=tuple(_grasp_from_dict(reader, d, p) for d, p in reader.items(root, "grasps")),
            bore=None if bore is None else _bore_from_dict(reader, bore, "bore"),
        )

    def save(self, path: Path) -> None:
        """Write the model as JSON."""
        path.write_text(self.to_json(), encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> VisionModel:
        """Read a model file.

        Raises:
            FileFormatError: when it is not a vision model, naming the field.
            InputError: when there is no such file.
        """
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(
                "vision model", got=f"{path} ({error})", expected="a readable JSON file", do="Teach the part first."
            ) from error
        return cls.from_json(text, source=str(path))


@dataclass(frozen=True)
class _Reader:
    """Reads fields of the JSON document and names the one that is wrong."""

    source: str

    def check(self, condition: bool, path: str, expected: str, got: object) -> None:
        if not condition:
            raise FileFormatError(f"{self.source}: {path}", got=repr(got)[:80], expected=expected)

    def text(self, d: dict[str, Any], key: str, path: str = "") -> str:
        self.check(isinstance(d.get(key), str) and d[key] != "", path + key, "a non-empty text", d.get(key))
        return cast("str", d[key])

    def choice(self, d: dict[str, Any], key: str, path: str, choices: tuple[str, ...]) -> Any:
        self.check(d.get(key) in choices, path + key, f"one of {', '.join(choices)}", d.get(key))
        return d[key]

    def number(self, d: dict[str, Any], key: str, path: str = "") -> float:
        value = d.get(key)
        good = isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))
        self.check(good, path + key, "a finite number", value)
        return float(cast("float", value))

    def positive(self, d: dict[str, Any], key: str, path: str = "") -> float:
        value = self.number(d, key, path)
        self.check(bool(value > 0), path + key, "a number > 0", value)
        return value

    def count(self, d: dict[str, Any], key: str, path: str = "") -> int:
        value = d.get(key)
        good = isinstance(value, int) and not isinstance(value, bool) and value >= 1
        self.check(good, path + key, "a whole number >= 1", value)
        return int(cast("int", value))

    def vector(self, d: dict[str, Any], key: str, path: str, n: int) -> Array:
        value = d.get(key)
        good = isinstance(value, list) and len(value) == n and all(isinstance(x, int | float) for x in value)
        self.check(good and bool(np.isfinite(np.array(value, dtype=float)).all()), path + key, f"{n} numbers", value)
        return np.array(value, dtype=float)

    def items(self, d: dict[str, Any], key: str) -> list[tuple[dict[str, Any], str]]:
        value = d.get(key)
        self.check(isinstance(value, list) and all(isinstance(x, dict) for x in value), key, "a list", value)
        return [(item, f"{key}[{i}].") for i, item in enumerate(cast("list[dict[str, Any]]", value))]

    def pose(self, d: dict[str, Any], path: str) -> RigidTransform:
        quaternion = self.vector(d, "rotation_xyzw", path, 4)
        self.check(
            bool(abs(np.linalg.norm(quaternion) - 1) < 1e-3), path + "rotation_xyzw", "a unit quaternion", quaternion
        )
        return RigidTransform.from_components(
            self.vector(d, "translation_m", path, 3), Rotation.from_quat(quaternion)
        )


def _number(value: float) -> float:
    """Nine significant digits: nanometres, and the same text on every platform."""
    return float(f"{value:.9g}")


def _numbers(values: Array) -> list[float]:
    return [_number(v) + 0.0 for v in np.where(np.abs(values) < 1e-12, 0.0, values)]


def _pose_to_dict(T: RigidTransform) -> dict[str, Any]:
    return {
        "translation_m": _numbers(T.translation),
        "rotation_xyzw": _numbers(T.rotation.as_quat(canonical=True)),
    }


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


def _feature_from_dict(reader: _Reader, d: dict[str, Any], path: str) -> CircleFeature:
    attributes = d.get("attributes", {})
    reader.check(isinstance(attributes, dict), path + "attributes", "an object", attributes)
    ranges = []
    for name, item in attributes.items():
        inner = f"{path}attributes.{name}."
        reader.check(isinstance(item, dict), inner, "an object with low and high", item)
        ranges.append((name, AttributeRange(reader.number(item, "low", inner), reader.number(item, "high", inner))))
    normal = reader.vector(d, "normal", path, 3)
    reader.check(bool(np.linalg.norm(normal) > 0.5), path + "normal", "a unit vector", normal)
    return CircleFeature(
        name=reader.text(d, "name", path),
        role=reader.choice(d, "role", path, ("salient", "supporting")),
        circle=Circle(reader.vector(d, "centre_m", path, 3), normal, reader.positive(d, "radius_m", path)),
        extractor=reader.choice(d, "extractor", path, ("region", "group")),
        copies=reader.count(d, "copies", path),
        support=reader.number(d, "support", path),
        attributes=tuple(ranges),
    )


def _grasp_to_dict(grasp: GraspCoordinates) -> dict[str, Any]:
    return {
        "name": grasp.name,
        "kind": grasp.kind,
        "width_m": _number(grasp.width_m),
        "copies": grasp.copies,
        **_pose_to_dict(grasp.T_part_tcp),
    }


def _grasp_from_dict(reader: _Reader, d: dict[str, Any], path: str) -> GraspCoordinates:
    return GraspCoordinates(
        name=reader.text(d, "name", path),
        T_part_tcp=reader.pose(d, path),
        width_m=reader.positive(d, "width_m", path),
        kind=reader.choice(d, "kind", path, ("outside", "inside")),
        copies=reader.count(d, "copies", path),
    )


def _bore_to_dict(bore: BoreCoordinates) -> dict[str, Any]:
    return {
        "diameter_m": _number(bore.diameter_m),
        "depth_m": _number(bore.depth_m),
        **_pose_to_dict(bore.T_part_bore),
    }


def _bore_from_dict(reader: _Reader, d: dict[str, Any], path: str) -> BoreCoordinates:
    reader.check(isinstance(d, dict), path, "an object or null", d)
    path += "."
    return BoreCoordinates(
        reader.pose(d, path), reader.positive(d, "diameter_m", path), reader.positive(d, "depth_m", path)
    )
