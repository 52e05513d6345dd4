"""The work cell of an episode, kept open for the next one, and where its camera looks from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmark.config import EpisodeConfig
from benchmark.tasks.bench import Viewpoints
from benchmark.tasks.task import Looks
from benchmark.world.cell import WorkCell
from benchmark.world.fixtures import PegTool, peg_for
from benchmark.world.parts import get_part
from benchmark.world.scene import CellConfig, cell_config
from benchmark.world.sensor import sensor_config
from robot.errors import UnreachableError
from robot.viewpoints import footprint, reachable_viewpoints, stations
from vision.errors import InputError
from vision.geometry.workspace import Workspace

Array = NDArray[np.float64]
VIEWS_AGAIN = 3
DEFAULT_CLEARANCE_MM = 0.5
TILTS_AGAIN_RAD = tuple(float(np.radians(tilt)) for tilt in (45, 35, 25, 20))


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
        self._viewpoints: dict[tuple[int, bool], Viewpoints] = {}

    def cell(self, config: EpisodeConfig) -> WorkCell:
        """The cell for an episode; it stays open until another kind of cell is asked for.

        Raises:
            ResourceError: a mesh or a description is missing, or the machine cannot draw.
        """
        sizes = self._configure(config.parts, config.pieces)
        if config.task == "insert":
            sizes = replace(sizes, peg=peg_of(config))
        key = (sizes, config.sensor)
        if self._cell is None or key != self._key:
            self.close()
            self._cell, self._key = WorkCell(key[0], sensor_config(config.sensor)), key
        return self._cell

    def looks(self, config: EpisodeConfig) -> Looks:
        """From where the episode's bin is photographed, at first and again."""
        return Looks(lambda: self.viewpoints(config), lambda: self.viewpoints(config, again=True))

    def viewpoints(self, config: EpisodeConfig, *, again: bool = False) -> Viewpoints:
        """Camera poses T_world_camera and joint angles (6,) in rad from which the episode's bin is photographed.

        Args:
            config: the episode.
            again: the steeper ones of a second look.
        """
        cell = self.cell(config)
        key = config.views, again
        if key not in self._viewpoints:
            self._viewpoints[key] = (
                _steeper(cell) if again else _viewpoints(cell, config.views, cell.config.view_tilt_rad)
            )
        return self._viewpoints[key]

    def close(self) -> None:
        """Give the cell's OpenGL context back."""
        if self._cell is not None:
            self._cell.close()
        self._cell, self._key, self._viewpoints = None, None, {}


def clearance_m(config: EpisodeConfig) -> float:
    """Diametral, between peg and bore."""
    return 1e-3 * (DEFAULT_CLEARANCE_MM if config.clearance_mm is None else config.clearance_mm)


def peg_of(config: EpisodeConfig) -> PegTool:
    """The peg for the bore of the episode's part.

    Raises:
        InputError: several parts, or one without a bore.
    """
    bore = get_part(config.parts[0]).bore
    if len(config.parts) != 1 or bore is None:
        raise InputError("parts of an insertion", got=config.kind, expected="one part that has a bore")
    return peg_for(bore, clearance_m(config))


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


def _steeper(cell: WorkCell) -> Viewpoints:
    """Viewpoints of a second look: tilted as far as the arm reaches, or those of the first look."""
    for tilt in TILTS_AGAIN_RAD:
        if tilt > cell.config.view_tilt_rad:
            try:
                return _viewpoints(cell, VIEWS_AGAIN, tilt)
            except UnreachableError:
                continue
    return _viewpoints(cell, VIEWS_AGAIN, cell.config.view_tilt_rad)


def _viewpoints(cell: WorkCell, count: int, tilt_rad: float) -> Viewpoints:
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
            tilt_rad,
        )
    ]
