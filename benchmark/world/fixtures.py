"""What is added to a cell for an insertion: the peg on the tool, and a bore that is round enough for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from vision.errors import InputError
from vision.model.grasp import BoreCoordinates

Array = NDArray[np.float64]

PEG_SIDES = 96
BORE_SECTORS = 126
TIP_BELOW_TCP_M = 0.045
BODY_ABOVE_TCP_M = 0.020
_COLLAR_SLACK = 0.02  # of the bore's radius: what lies so near to it belongs to its collar


@dataclass(frozen=True)
class PegTool:
    """A chamfered round peg in the tool changer; its tip is `TIP_BELOW_TCP_M` beyond the tool centre point.

    Attributes:
        diameter_m: of the cylinder, which the polygon's corners lie on.
        chamfer_m: of its end, at 45 degrees.
    """

    diameter_m: float
    chamfer_m: float = 0.0005

    def __post_init__(self) -> None:
        if not 0 <= self.chamfer_m < self.diameter_m / 2:
            raise InputError("peg (m)", got=self, expected="a chamfer smaller than the radius")

    @property
    def vertices(self) -> Array:
        """(N, 3) corners of the peg in the frame of the tool centre point; it is convex."""
        radius = self.diameter_m / 2
        rings = (
            (radius, -BODY_ABOVE_TCP_M),
            (radius, TIP_BELOW_TCP_M - self.chamfer_m),
            (radius - self.chamfer_m, TIP_BELOW_TCP_M),
        )
        turns = 2 * np.pi * np.arange(PEG_SIDES) / PEG_SIDES
        return np.vstack(
            [np.column_stack([r * np.cos(turns), r * np.sin(turns), np.full(PEG_SIDES, z)]) for r, z in rings]
        )


def peg_for(bore: BoreCoordinates, clearance_m: float) -> PegTool:
    """The peg that leaves a diametral clearance in a bore.

    Raises:
        InputError: a clearance that is not above zero, or larger than the bore.
    """
    if not 0 < clearance_m < bore.diameter_m:
        raise InputError("clearance (m)", got=clearance_m, expected=f"above 0 and below {bore.diameter_m}")
    return PegTool(bore.diameter_m - clearance_m)


def is_collar(hull: Array, bore: BoreCoordinates) -> bool:
    """Whether a convex piece with these corners (N, 3) bounds the bore, which runs along the part's axis."""
    nearest = float(np.hypot(hull[:, 0], hull[:, 1]).min())
    low, high = _reach(bore)
    overlaps = hull[:, 2].min() < high - 1e-6 and hull[:, 2].max() > low + 1e-6
    return bool(overlaps and abs(nearest - bore.diameter_m / 2) < _COLLAR_SLACK * bore.diameter_m / 2)


def round_collar(hulls: list[Array], bore: BoreCoordinates) -> list[trimesh.Trimesh]:
    """Convex sectors in place of coarser ones around a bore: their inner faces touch the nominal circle from outside.

    Args:
        hulls: corners (N, 3) of the coarse sectors.
        bore: the bore, along the part's axis.
    """
    corners = np.vstack(hulls)
    radii = np.hypot(corners[:, 0], corners[:, 1])
    outer, low, high = float(radii.max()), float(corners[:, 2].min()), float(corners[:, 2].max())
    half = np.pi / BORE_SECTORS
    inner = bore.diameter_m / 2 / np.cos(half)
    sectors = []
    for number in range(BORE_SECTORS):
        turns = 2 * half * number + np.array([-half, half])
        points = [
            (r * np.cos(turn), r * np.sin(turn), z) for r in (inner, outer) for turn in turns for z in (low, high)
        ]
        sectors.append(trimesh.convex.convex_hull(np.array(points)))
    return sectors


def _reach(bore: BoreCoordinates) -> tuple[float, float]:
    """Lowest and highest z of a bore in the part's frame."""
    ends = bore.T_part_bore.apply([[0.0, 0.0, 0.0], [0.0, 0.0, bore.depth_m]])[:, 2]
    return float(ends.min()), float(ends.max())
