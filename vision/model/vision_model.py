"""The vision model: what a person taught about a part, sufficient to recognise it and compute its pose.

Sections 2, 4 and 6: a small number of salient and supporting features, which extractor to use for each, and the
grasp coordinates. It is not a CAD model. Metres and radians throughout; ``vision.model.model_file`` stores it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.features import Extractor
from vision.frozen import frozen_arrays, read_only
from vision.geometry.circle import Circle
from vision.model.grasp import BoreCoordinates, GraspCoordinates, turns_about_z

Array = NDArray[np.float64]
Role = Literal["salient", "supporting"]

_UNIT_TOLERANCE = 1e-6


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
    extractor: Extractor
    copies: int = 1
    support: float = 1.0
    attributes: tuple[tuple[str, AttributeRange], ...] = ()

    def circles(self) -> list[Circle]:
        """The circles of all copies."""
        return [
            Circle(R @ self.circle.centre, R @ self.circle.normal, self.circle.radius_m)
            for R in turns_about_z(self.copies).as_matrix()
        ]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Pattern:
    """Edges on a face that are no taught circles, such as those of slots: a supporting feature (Section 6).

    They follow from the taught views and say how the part is turned about its axis; edges that run around the axis,
    which a turn does not move, are left out. All copies that the part's symmetry makes are there.

    Attributes:
        name: label.
        normal: (3,) unit vector towards the side from which the edges are seen.
        points: (N, 3) metres in the part's frame, evenly spaced along the edges; read-only.
        directions: (N, 3) unit tangents of the edges at the points, whose sign has no meaning; read-only.
    """

    name: str
    normal: Array
    points: Array
    directions: Array

    def __post_init__(self) -> None:
        count = len(self.points)
        for name, shape in (("normal", (3,)), ("points", (count, 3)), ("directions", (count, 3))):
            array = np.array(getattr(self, name), dtype=float)
            expected = (
                f"finite {'numbers' if name == 'points' else 'unit vectors'} of shape {shape}, at least one point"
            )
            good = array.shape == shape and array.size > 0 and bool(np.isfinite(array).all())
            if good and name != "points":
                good = bool((np.abs(np.linalg.norm(array, axis=-1) - 1) < _UNIT_TOLERANCE).all())
            if not good:
                raise InputError(f"{name} of pattern {self.name!r}", got=array, expected=expected)
            object.__setattr__(self, name, array)


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
        thresholds: of the extractors, as adapted to the part.
        patterns: edges on the faces besides the circles, as the taught views show them.
    """

    part: str
    diameter_m: float
    features: tuple[CircleFeature, ...]
    symmetry_fold: int | None = None
    grasps: tuple[GraspCoordinates, ...] = ()
    bore: BoreCoordinates | None = None
    thresholds: ExtractionThresholds = field(default_factory=ExtractionThresholds)
    patterns: tuple[Pattern, ...] = ()

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


class CoaxialCircle(NamedTuple):
    """A circle about the part's axis: height of its centre along z, side +1 or -1 of its normal, radius in metres."""

    height: float
    side: float
    radius: float


class SalientCircles(NamedTuple):
    """The salient circles as the compiled loops read them.

    Attributes:
        height: (K,) of the centres along z, metres.
        side: (K,) +1 or -1, the direction of the normals along z.
        radius: (K,) metres.
    """

    height: Array
    side: Array
    radius: Array

    @classmethod
    def of(cls, model: VisionModel) -> SalientCircles:
        """Of a model; salient features are coaxial circles."""
        circles = [f.circle for f in model.salient]
        height = np.array([c.centre[2] for c in circles])
        side = np.sign([c.normal[2] for c in circles])
        return read_only(cls(height, side, np.array([c.radius_m for c in circles])))

    def lowest(self, T_world_part: Array) -> float:
        """Height in the world, whose z axis points up, of the lowest point of all circles of a posed part (4, 4)."""
        up = T_world_part[2, 2]
        lowest = self.height * up - self.radius * np.sqrt(max(1 - up * up, 0.0))
        return float(T_world_part[2, 3] + lowest.min())

    def circle(self, number: int | np.intp) -> CoaxialCircle:
        """One of them."""
        return CoaxialCircle(float(self.height[number]), float(self.side[number]), float(self.radius[number]))
