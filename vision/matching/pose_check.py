"""Do the pictures contradict the camera poses? Asked of the circles that two views can agree on.

An ellipse in one view and an ellipse in another are one circle in space if the rays through the circle's centre meet
in front of both cameras, and if the circles behind the ellipses have one radius and one normal there. Under right
poses many pairs do; under wrong ones hardly any, for they would have to do so by chance. How often chance does it is
measured: the cameras are turned at random where they stand, and the pairs are counted again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.extraction import run_extractors
from vision.features import EllipseFeature
from vision.frozen import frozen_arrays
from vision.geometry.camera import Camera, View
from vision.geometry.circle import circle_candidates
from vision.geometry.ellipse import conic_matrices, geometric_parameters
from vision.geometry.pose_reading import AS_GIVEN, READINGS, PoseReading
from vision.geometry.workspace import Workspace

Array = NDArray[np.float64]
Bounds = tuple[float, float]

USUAL_RADII_M: Bounds = (5e-4, 2.0)

SMALLEST_PX = 8.0  # semi-major axis: less of an ellipse tells little about its circle
MOST_ELLIPSES = 60
GAP, LOG_RADIUS, TURN_RAD = 0.2, 0.06, np.radians(12.0)  # within these two circles are one; the gap is in radii
LEAST_PARALLAX = np.sin(np.radians(2.0))
RADIUS_SLACK = 2.0

TURNINGS = 20
TURNED_BY = 0.35  # of the field of view to either side
LEAST_MARGIN = 3  # pairs more than any of the turnings gives
OUTWEIGHED = 4  # times as many pairs as under the reading that is accused
FARTHEST_M = 200.0


@dataclass(frozen=True, eq=False)
@frozen_arrays
class PoseCheck:
    """What the pictures say about the camera poses.

    Attributes:
        shared: for each reading of the given poses, how many pairs of ellipses from two views are one circle in
            space, of a radius that can be.
        better: the readings that the pictures speak for, against the poses as given; best first, empty where they do
            not contradict these.
        remarks: what is odd about the poses whatever the pictures show; sentences without a full stop.
    """

    shared: Mapping[PoseReading, int]
    better: tuple[PoseReading, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def complaint(self) -> str:
        """All of it in words; empty where nothing speaks against the poses."""
        if not self.better:
            return "; and ".join(self.remarks)
        readings = "".join(f"; read as {r}, {self.shared[r]} are: {r.remedy}" for r in self.better)
        return (
            f"the pictures contradict the camera poses: read as given, {self.shared[AS_GIVEN]} pairs of ellipses "
            f"from two views are one circle in space{readings}"
        )


def check_poses(
    views: Sequence[View], workspace: Workspace | None = None, radii_m: Bounds = USUAL_RADII_M
) -> PoseCheck:
    """Look whether the pictures contradict the camera poses, and which other reading of these they agree with.

    Two views or more are compared by their ellipses, which takes about 0.2 s for each view. Of a single view nothing
    but the place of its camera can be odd. Errors of calibration are not looked for: they leave most pairs in place.

    Args:
        views: as they are given to a localizer.
        workspace: the box in which parts can be; None where it is not known.
        radii_m: the smallest and the largest radius of circles on the parts. They alone tell the unit of the poses.

    Raises:
        InputError: when the radii are none.
    """
    if not 0 < radii_m[0] <= radii_m[1] < np.inf:
        raise InputError("radii_m", got=radii_m, expected="two lengths in metres, 0 < smallest <= largest")
    flat = [view.undistorted() for view in views]
    shared: dict[PoseReading, int] = dict.fromkeys(READINGS, 0)
    better: tuple[PoseReading, ...] = ()
    if len(flat) > 1:
        shared, better = _compare(_Sighting.of_all(flat), radii_m)
    return PoseCheck(shared, better, tuple(_remarks(flat, workspace)))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Sighting:
    """The circles behind the ellipses of one view: two to each.

    Attributes:
        given: the pose of the view as given.
        half_field: (2,) half the angles that the picture spans across and down, radians.
        centres: (2 N, 3) of circles of radius 1, in the camera's frame.
        normals: (2 N, 3).
    """

    given: RigidTransform
    half_field: Array
    centres: Array
    normals: Array

    @classmethod
    def of_all(cls, views: Sequence[View]) -> list[_Sighting]:
        return [cls.of(view, run_extractors(view.gray, ("region", "group")).features) for view in views]

    @classmethod
    def of(cls, view: View, found: Sequence[EllipseFeature]) -> _Sighting:
        camera = view.camera
        centres, normals = circle_candidates(conic_matrices(_distinct(found)), camera.matrix)
        return cls(view.T_world_camera, _half_field(camera), centres.reshape(-1, 3), normals.reshape(-1, 3))


def _distinct(found: Sequence[EllipseFeature]) -> Array:
    """Focal parameters (N, 5) of the best supported ellipses, each once, for both extractors may have found it."""
    large = [f for f in found if f.ellipse.semi_axes[0] > SMALLEST_PX]
    large.sort(key=lambda f: -f.support * f.ellipse.semi_axes[0])
    p = np.array([f.ellipse.p for f in large]).reshape(-1, 5)
    shapes, kept = geometric_parameters(p), np.zeros(len(p), bool)
    for i, shape in enumerate(shapes):
        off = np.abs(shapes[:i][kept[:i], :4] - shape[:4])
        kept[i] = not (off < shape[2] * np.array([0.1, 0.1, 0.07, 0.1]) + 1).all(axis=1).any()
    return np.asarray(p[kept][:MOST_ELLIPSES])


def _compare(
    sightings: Sequence[_Sighting], radii_m: Bounds
) -> tuple[dict[PoseReading, int], tuple[PoseReading, ...]]:
    """The pairs under each reading, and the readings that are significantly better than the poses as given."""
    radii = {r: _shared_radii(sightings, [r.pose(s.given) for s in sightings]) for r in READINGS}
    shared = {r: _count(radii[r], radii_m) for r in READINGS}
    better = []
    for reading in READINGS[1:]:
        # The unit changes no pair, only its radius: it is to blame where the pairs are many but the radii impossible.
        unit_alone = replace(reading, millimetres=False) == AS_GIVEN
        against = shared[AS_GIVEN] if unit_alone else len(radii[AS_GIVEN])
        if shared[reading] < LEAST_MARGIN or shared[reading] < OUTWEIGHED * against:
            continue
        if shared[reading] >= LEAST_MARGIN + _by_chance(sightings, reading, radii_m):
            better.append(reading)
    better.sort(key=lambda r: -shared[r])
    return shared, tuple(r for r in better if 2 * shared[r] > shared[better[0]])


def _by_chance(sightings: Sequence[_Sighting], reading: PoseReading, radii_m: Bounds) -> int:
    """The most pairs that come about when every camera is turned at random where it stands."""
    rng = np.random.default_rng(0)
    most = 0
    for _ in range(TURNINGS):
        poses = []
        for sighting in sightings:
            across, down = 2 * TURNED_BY * sighting.half_field * rng.uniform(-1, 1, size=2)
            turn = Rotation.from_euler("xyz", [down, across, rng.uniform(0, 2 * np.pi)])
            poses.append(reading.pose(sighting.given) * RigidTransform.from_rotation(turn))
        most = max(most, _count(_shared_radii(sightings, poses), radii_m))
    return most


def _count(radii: Array, radii_m: Bounds) -> int:
    smallest, largest = radii_m
    return int(np.count_nonzero((radii > smallest / RADIUS_SLACK) & (radii < largest * RADIUS_SLACK)))


def _shared_radii(sightings: Sequence[_Sighting], poses: Sequence[RigidTransform]) -> Array:
    """Radius of every circle that two views agree on."""
    pairs = combinations(range(len(sightings)), 2)
    return np.concatenate(
        [_pair_radii((sightings[a], sightings[b]), (poses[a].as_matrix(), poses[b].as_matrix())) for a, b in pairs]
    )


def _pair_radii(sightings: tuple[_Sighting, _Sighting], poses: tuple[Array, Array]) -> Array:
    """The same for one pair of views: no ellipse is in two pairs, and the best agreeing come first."""
    off, radius = _disagreement(sightings, poses)
    radii = []
    while off.size:
        i, j = np.unravel_index(off.argmin(), off.shape)
        if not off[i, j] < 1:
            break
        radii.append(radius[i, j])
        off[i // 2 * 2 : i // 2 * 2 + 2], off[:, j // 2 * 2 : j // 2 * 2 + 2] = np.inf, np.inf
    return np.array(radii)


def _disagreement(sightings: tuple[_Sighting, _Sighting], poses: tuple[Array, Array]) -> tuple[Array, Array]:
    """How far circles (N,) of one view are from being circles (M,) of another: (N, M), and their radii (N, M)."""
    (u, far_u, normals_u), (v, far_v, normals_v) = (_in_world(s, T) for s, T in zip(sightings, poses, strict=True))
    base = poses[1][:3, 3] - poses[0][:3, 3]
    cosine = u @ v.T
    sine_squared = np.maximum(1 - cosine**2, LEAST_PARALLAX**2)
    along_u, along_v = (u @ base)[:, None], (v @ base)[None]
    s, t = (along_u - cosine * along_v) / sine_squared, (cosine * along_u - along_v) / sine_squared
    gap = np.linalg.norm(s[..., None] * u[:, None] - t[..., None] * v[None] - base, axis=2)
    meet = (s > 0) & (t > 0) & (1 - cosine**2 > LEAST_PARALLAX**2)
    radius_u, radius_v = (np.where(meet, depth, 1.0) / far for depth, far in ((s, far_u[:, None]), (t, far_v[None])))
    radius = np.sqrt(radius_u * radius_v)
    turn = np.arccos(np.clip(normals_u @ normals_v.T, -1, 1))
    off = (gap / radius / GAP) ** 2 + (np.log(radius_u / radius_v) / LOG_RADIUS) ** 2 + (turn / TURN_RAD) ** 2
    return np.where(meet, off, np.inf), radius


def _in_world(sighting: _Sighting, T: Array) -> tuple[Array, Array, Array]:
    """Unit rays (N, 3) through the centres, how many radii far these are (N,), and normals (N, 3) in the world."""
    far = np.linalg.norm(sighting.centres, axis=1)
    return (sighting.centres / far[:, None]) @ T[:3, :3].T, far, sighting.normals @ T[:3, :3].T


def _remarks(views: Sequence[View], workspace: Workspace | None) -> Iterator[str]:
    """What is odd about the poses by themselves."""
    if not views:
        return
    far = [float(np.linalg.norm(view.T_world_camera.translation)) for view in views]
    if max(far) > FARTHEST_M:
        name = views[int(np.argmax(far))].name
        yield f"the camera of {name} is {max(far):.0f} m from the world's origin; translations have to be in metres"
    if workspace is not None and not any(_sees(view, AS_GIVEN, workspace) for view in views):
        right = [reading for reading in READINGS[1:] if all(_sees(view, reading, workspace) for view in views)]
        hint = f"; read as {right[0]}, it is in all of them: {right[0].remedy}" if len(right) == 1 else ""
        yield f"none of the workspace is in any picture{hint}"
    if len(views) > 1 and all(_part_company(a, b) for a, b in combinations(views, 2)):
        yield "no two cameras look at one place: their optical axes, which z points along, diverge"


def _sees(view: View, reading: PoseReading, workspace: Workspace) -> bool:
    """Whether any of the workspace is in the picture: points of a small one, or what rays hit of a large one."""
    T, camera = reading.pose(view.T_world_camera), view.camera
    low, high = np.array(workspace.low), np.array(workspace.high)
    points = low + (high - low) * np.array(list(product(np.linspace(0, 1, 7), repeat=3)))
    pixels = camera.project(T.inv().apply(points))
    size = np.array([camera.width_px, camera.height_px])
    if ((pixels > -0.5) & (pixels < size - 0.5)).all(axis=1).any():
        return True
    grid = np.array(list(product(np.linspace(0, 1, 9), repeat=2))) * (size - 1)
    rays = camera.rays(grid) @ T.rotation.as_matrix().T
    with np.errstate(divide="ignore", invalid="ignore"):
        near, far = (low - T.translation) / rays, (high - T.translation) / rays
    enter, leave = np.fmin(near, far).max(axis=1), np.fmax(near, far).min(axis=1)
    return bool(((leave > 0) & (enter <= leave)).any())


def _part_company(first: View, second: View) -> bool:
    """Whether two optical axes are nearest to each other behind the cameras, and more than a picture apart."""
    poses = [view.T_world_camera.as_matrix() for view in (first, second)]
    u, v = (T[:3, 2] for T in poses)
    base, cosine = poses[1][:3, 3] - poses[0][:3, 3], float(u @ v)
    behind = u @ base < cosine * (v @ base) and cosine * (u @ base) < v @ base
    fields = [2 * np.linalg.norm(_half_field(view.camera)) for view in (first, second)]
    return bool(behind and np.arccos(np.clip(cosine, -1, 1)) > max(fields))


def _half_field(camera: Camera) -> Array:
    """(2,) half the angles that a picture spans across and down, radians."""
    return np.arctan([camera.width_px / camera.fx / 2, camera.height_px / camera.fy / 2])
