"""The work cell of an episode, kept open for the next one, and where its camera looks from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmark.config import EpisodeConfig
from benchmark.world.cell import WorkCell
from benchmark.world.parts import get_part
from benchmark.world.scene import CellConfig, cell_config
from benchmark.world.sensor import sensor_config
from robot.viewpoints import Viewpoint, footprint, reachable_viewpoints, stations
from vision.geometry.workspace import Workspace

Array = NDArray[np.float64]
Viewpoints = list[Viewpoint]


class CellPool:
    """Keeps the last cell open: compiling one takes longer than a drop.

    An episode's result does not depend on what the pool holds, for every drop starts a cell from the same state.
    """

    def __init__(self, configure: Callable[[tuple[str, ...], int], CellConfig] = cell_config) -> None:
        """An empty pool.

        Args:
            configure: gives the sizes of the cell for part names and a number of pieces.
        """
        self._configure = configure
        self._key: tuple[CellConfig, str] | None = None
        self._cell: WorkCell | None = None
        self._viewpoints: dict[int, Viewpoints] = {}

    def cell(self, config: EpisodeConfig) -> WorkCell:
        """The cell for an episode; it stays open until another kind of cell is asked for.

        Raises:
            ResourceError: a mesh or a description is missing, or the machine cannot draw.
        """
        key = (self._configure(config.parts, config.pieces), config.sensor)
        if self._cell is None or key != self._key:
            self.close()
            self._cell, self._key = WorkCell(key[0], sensor_config(config.sensor)), key
        return self._cell

    def viewpoints(self, config: EpisodeConfig) -> Viewpoints:
        """Camera poses T_world_camera and joint angles (6,) in rad from which the episode's bin is photographed."""
        cell = self.cell(config)
        if config.views not in self._viewpoints:
            self._viewpoints[config.views] = _viewpoints(cell, config.views)
        return self._viewpoints[config.views]

    def close(self) -> None:
        """Give the cell's OpenGL context back."""
        if self._cell is not None:
            self._cell.close()
        self._cell, self._key, self._viewpoints = None, None, {}


def workspace(config: CellConfig) -> Workspace:
    """The box in which pieces can lie: the bin, and a part's diameter above its walls."""
    x, y, z = config.bin_centre_m
    half_x, half_y = config.bin_size_m[0] / 2, config.bin_size_m[1] / 2
    top = config.bin_wall_m + max(get_part(name).diameter_m for name in config.part_names)
    return Workspace((x - half_x, y - half_y, z), (x + half_x, y + half_y, z + top))


def bin_stations(config: CellConfig) -> Array:
    """Where to aim, (N, 2) in metres from the bin's centre: several places if the bin is larger than a picture."""
    largest = max(get_part(name).diameter_m for name in config.part_names)
    return stations(config.bin_size_m, footprint(config.camera, config.camera_distance_m), overlap_m=largest)


def _viewpoints(cell: WorkCell, count: int) -> Viewpoints:
    config = cell.config
    target = np.array(config.bin_centre_m)
    target[2] += config.bin_wall_m / 3
    return [
        viewpoint
        for x, y in bin_stations(config)
        for viewpoint in reachable_viewpoints(
            cell.kinematics,
            cell.T_flange_camera,
            target + np.array([x, y, 0.0]),
            config.camera_distance_m,
            count,
            config.view_tilt_rad,
        )
    ]
