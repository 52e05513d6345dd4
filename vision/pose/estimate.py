"""The pose of a part, as far as the images tell, and which features of its model confirm it (Section 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.model.vision_model import Role, VisionModel

Array = NDArray[np.float64]

CONFIRMED = 0.5
"""Edge support from which a copy of a feature counts as found: random edges give about 0.2."""


@dataclass(frozen=True)
class FeatureSupport:
    """How well edges run where one feature of a posed model must show them.

    Attributes:
        name: of the circle or pattern in the vision model.
        role: "salient" for the circles that make hypotheses, "supporting" for what confirms them.
        copies: edge support of each copy over all views, 0 to 1; None for a copy that no view can show, because it
            faces away, lies outside the pictures or behind a part that was found before.
    """

    name: str
    role: Role
    copies: tuple[float | None, ...]

    @property
    def in_sight(self) -> int:
        """Number of copies that some view can show."""
        return len(self._seen)

    @property
    def confirmed(self) -> int:
        """Number of copies with an edge support of at least one half."""
        return sum(support >= CONFIRMED for support in self._seen)

    @property
    def support(self) -> float | None:
        """Mean edge support of the copies in sight, 0 to 1; None where no copy is."""
        return float(np.mean(self._seen)) if self._seen else None

    @property
    def _seen(self) -> list[float]:
        return [support for support in self.copies if support is not None]


def features_supported(
    model: VisionModel, feature: NDArray[np.intp], support: Array, samples: Array
) -> tuple[FeatureSupport, ...]:
    """Sort the edge support of sampled circles by the features that they are copies of.

    Args:
        model: its circles come first, then its patterns.
        feature: (C,) number of the feature that each sampled circle is a copy of, ascending.
        support: (C,) mean edge support of the circle's samples in sight.
        samples: (C,) number of these samples.
    """
    roles: list[tuple[str, Role]] = [(f.name, f.role) for f in model.features]
    roles += [(pattern.name, "supporting") for pattern in model.patterns]
    copies: list[list[float | None]] = [[] for _ in roles]
    for number, value, count in zip(feature.tolist(), support.tolist(), samples.tolist(), strict=True):
        copies[number].append(value if count else None)
    return tuple(FeatureSupport(*role, tuple(of_one)) for role, of_one in zip(roles, copies, strict=True))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class PoseEstimate:
    """Where a part is, as far as the images tell.

    Attributes:
        part: name of the part.
        T_world_part: its pose.
        covariance: (6, 6) of (translation in metres, rotation vector in radians), both in the world frame and about
            the part's origin.
        score: edge support of the pose, 0 to 1.
        extractor: "region" or "group", the extractor whose features made the hypothesis; "oracle" for the true pose.
        residual_px: root mean square distance of the edge points used from the projected model.
        views: number of views that support the pose.
        inplane_known: whether supporting features settled the rotation about the part's axis.
        features: for every feature of the vision model, the edges that confirm it; empty from methods that ask none.
        shown: share of the edges facing the views that is in sight and not hidden by parts found before, 0 to 1; None
            from methods that do not know.
        probability: that the pose is right, as ``vision/pose/probability.py`` has it; None from methods that do not
            say.
    """

    part: str
    T_world_part: RigidTransform
    covariance: Array
    score: float
    extractor: str
    residual_px: float
    views: int
    inplane_known: bool
    features: tuple[FeatureSupport, ...] = ()
    shown: float | None = None
    probability: float | None = None

    def __post_init__(self) -> None:
        for name in ("shown", "probability"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= 1:
                raise InputError(f"{name} of a pose", got=value, expected="a number from 0 to 1, or None")
        covariance = np.array(self.covariance, dtype=np.float64)
        if covariance.shape != (6, 6):
            raise InputError("covariance of a pose", got=f"shape {covariance.shape}", expected="(6, 6)")
        object.__setattr__(self, "covariance", covariance)
