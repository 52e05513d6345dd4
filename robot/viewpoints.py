"""Where to look from."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import joint_vector
from robot.errors import UnreachableError
from robot.kinematics import HOME_Q, ArmKinematics
from vision.errors import InputError
from vision.geometry.camera import Camera

Array = NDArray[np.float64]

DEFAULT_TILT_RAD = float(np.radians(15))
_AZIMUTHS_RAD = np.radians(np.arange(0, 360, 30))
# Of the sets of viewpoints, those with at least this fraction of the best parallax compete by the arm's travel.
_GOOD_PARALLAX = 0.85


def look_at(target_world: ArrayLike, position_world: ArrayLike, *, upside_down: bool = False) -> RigidTransform:
    """The camera pose at a position that puts a target into the principal point.

    Args:
        target_world: (3,) in m.
        position_world: (3,) in m, above the target.
        upside_down: turn the camera by 180 degrees about its axis.

    Returns:
        T_world_camera in OpenCV axes; the image's x axis runs along the world's y axis, as the bin's long side does.

    Raises:
        InputError: when the axis would be parallel to the world's y axis, or a number is not finite.
    """
    target, position = np.asarray(target_world, dtype=float), np.asarray(position_world, dtype=float)
    z = target - position
    distance = np.linalg.norm(z)
    if not np.isfinite(distance) or np.hypot(z[0], z[2]) < 1e-6:
        raise InputError(
            "viewing direction", got=z.tolist(), expected="finite and not parallel to the world's y axis"
        )
    z = z / distance
    x = np.array([0.0, -1.0, 0.0]) if upside_down else np.array([0.0, 1.0, 0.0])
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return RigidTransform.from_components(position, Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z])))


class Viewpoint(NamedTuple):
    """Where to look from.

    Attributes:
        T_world_camera: pose of the camera (OpenCV axes).
        q: (6,) joint angles that bring it there, in rad.
    """

    T_world_camera: RigidTransform
    q: Array


def reachable_viewpoints(
    kinematics: ArmKinematics,
    T_flange_camera: RigidTransform,
    target_world: ArrayLike,
    distance_m: float,
    count: int = 3,
    tilt_rad: float = DEFAULT_TILT_RAD,
    seed_q: ArrayLike = HOME_Q,
) -> list[Viewpoint]:
    """Of the viewpoints on a ring around the target, the reachable ones that lie furthest apart.

    Takes about a second, since out-of-reach poses are searched for in vain. A cell's viewpoints never change: ask
    once.

    Args:
        kinematics: the arm.
        T_flange_camera: the camera on the flange (OpenCV axes).
        target_world: (3,) point to look at, in m.
        distance_m: from the camera to the target.
        count: how many.
        tilt_rad: angle of the optical axis from the vertical.
        seed_q: (6,) joint angles to stay near to, in rad.

    Returns:
        ``count`` viewpoints, in the order of their azimuths.

    Raises:
        InputError: when the distance, the count or the tilt is out of range.
        UnreachableError: when fewer than ``count`` are reachable.
    """
    _check(distance_m, count, tilt_rad)
    seed = joint_vector(seed_q)
    found: list[Viewpoint] = []
    for azimuth in _AZIMUTHS_RAD:
        poses = [_viewpoint(target_world, distance_m, tilt_rad, azimuth, upside_down=flip) for flip in (True, False)]
        solutions = [(pose, kinematics.solutions(pose * T_flange_camera.inv(), seed)) for pose in poses]
        candidates = [Viewpoint(pose, q[0]) for pose, q in solutions if q]
        if candidates:
            found.append(min(candidates, key=lambda viewpoint: _travel(viewpoint.q, seed)))
    if len(found) < count:
        raise UnreachableError(
            "viewpoints",
            got=f"{len(found)} of {len(_AZIMUTHS_RAD)} azimuths reachable at {distance_m} m from"
            f" {np.asarray(target_world, dtype=float).round(3).tolist()}, tilted {np.degrees(tilt_rad):.0f} deg",
            expected=f"at least {count}",
            do="Reduce the camera's distance (several stations over the bin) or the tilt.",
        )
    return _best_set(found, count, seed)


def footprint(camera: Camera, distance_m: float) -> tuple[float, float]:
    """What one picture shows of a plane across the optical axis: lengths along the world's x and y axis in m.

    The viewpoints' image x axis runs along the world's y axis, so the larger length comes second.
    """
    return distance_m * camera.height_px / camera.fy, distance_m * camera.width_px / camera.fx


def stations(bin_size_m: Sequence[float], footprint_m: Sequence[float], overlap_m: float = 0.0) -> Array:
    """Where to aim if the bin does not fit into one picture.

    Args:
        bin_size_m: (x, y) inner size of the bin.
        footprint_m: (x, y) what one picture shows; see `footprint`.
        overlap_m: by how much neighbouring pictures overlap at least, best the diameter of a piece, so that each is
            whole in one of them.

    Returns:
        (N, 2) offsets from the bin's centre in m, row by row; a single (0, 0) when one picture does.

    Raises:
        InputError: when the picture is not larger than the overlap.
    """
    axes = []
    for size, seen in zip(bin_size_m, footprint_m, strict=True):
        if size <= seen:
            axes.append(np.zeros(1))
            continue
        if seen <= overlap_m:
            raise InputError("footprint of a picture (m)", got=seen, expected=f"more than the overlap of {overlap_m}")
        count = int(np.ceil((size - overlap_m) / (seen - overlap_m) - 1e-9))
        axes.append(np.linspace(-(size - seen) / 2, (size - seen) / 2, count))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def _viewpoint(
    target_world: ArrayLike, distance_m: float, tilt_rad: float, azimuth_rad: float, *, upside_down: bool = False
) -> RigidTransform:
    sideways = np.sin(tilt_rad) * np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)])
    offset = distance_m * np.array([*sideways, np.cos(tilt_rad)])
    return look_at(target_world, np.asarray(target_world, dtype=float) + offset, upside_down=upside_down)


def _travel(q: Array, seed: Array) -> float:
    """The largest turn of a joint."""
    return float(np.abs(q - seed).max())


def _best_set(found: list[Viewpoint], count: int, seed: Array) -> list[Viewpoint]:
    """The subset with little travel among those whose two nearest optical axes include a large angle."""
    axes = np.array([pose.rotation.as_matrix()[:, 2] for pose, _ in found])
    angles = np.arccos(np.clip(axes @ axes.T, -1.0, 1.0))
    subsets = list(combinations(range(len(found)), count))
    parallax = np.array([min((angles[pair] for pair in combinations(subset, 2)), default=0.0) for subset in subsets])
    good = [
        subset for subset, angle in zip(subsets, parallax, strict=True) if angle >= _GOOD_PARALLAX * parallax.max()
    ]
    best = min(good, key=lambda subset: sum(_travel(found[i].q, seed) for i in subset))
    return [found[i] for i in best]


def _check(distance_m: float, count: int, tilt_rad: float) -> None:
    if not distance_m > 0:
        raise InputError("viewing distance (m)", got=distance_m, expected="above zero")
    if count < 1:
        raise InputError("number of viewpoints", got=count, expected="at least 1")
    if not 0 <= tilt_rad < np.pi / 2:
        raise InputError("tilt (rad)", got=tilt_rad, expected="0 ... pi/2")
