"""The box in which parts can be, and how deep it is in a view."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.geometry.camera import View

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Workspace:
    """The box in which parts can be, in the world frame, metres: known from the cell, like the pose of the bin."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        corners = []
        for name in ("low", "high"):
            try:
                corners.append(np.array(getattr(self, name), dtype=float))
            except (TypeError, ValueError):
                corners.append(np.empty(0))
        low, high = corners
        if low.shape != (3,) or high.shape != (3,) or not (np.isfinite([low, high]).all() and (low <= high).all()):
            expected = "x, y, z of two corners in metres, finite, no number of the first above that of the second"
            raise InputError("workspace", got=(self.low, self.high), expected=expected)
        object.__setattr__(self, "low", tuple(low.tolist()))
        object.__setattr__(self, "high", tuple(high.tolist()))

    def contains(self, points: Array, margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Which of the points (N, 3) lie in the box, widened by a margin."""
        low, high = np.array(self.low) - margin_m, np.array(self.high) + margin_m
        return np.asarray(((points >= low) & (points <= high)).all(axis=-1))


def depth_range(view: View, workspace: Workspace) -> tuple[float, float]:
    """Smallest and largest depth of the workspace's corners in a view, metres."""
    T = view.T_world_camera.inv().as_matrix()
    corners = [
        (x, y, z)
        for x in (workspace.low[0], workspace.high[0])
        for y in (workspace.low[1], workspace.high[1])
        for z in (workspace.low[2], workspace.high[2])
    ]
    depths = [float(T[2, :3] @ c + T[2, 3]) for c in corners]
    return max(min(depths), 1e-3), max(depths)
