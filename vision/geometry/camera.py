"""The pinhole camera with lens distortion, rigid motions, and a view: one image with the pose it was taken from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from numbers import Integral, Real
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.frozen import frozen_arrays, read_only

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """Intrinsics in OpenCV's convention.

    The camera frame has x to the right, y down, z forward. A whole-numbered pixel coordinate is the centre of
    a pixel, so the image spans (-0.5, -0.5) to (width_px - 0.5, height_px - 0.5).

    Attributes:
        width_px: image width.
        height_px: image height.
        fx: focal length over pixel pitch along x, in pixels.
        fy: the same along y.
        cx: principal point x, in pixels.
        cy: principal point y, in pixels.
        distortion: OpenCV's (k1, k2, p1, p2, k3).
    """

    width_px: int
    height_px: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        size = (self.width_px, self.height_px)
        if not all(isinstance(n, Integral) for n in size) or min(size) < 1:
            raise InputError("image size", got=size, expected="whole numbers, at least 1 x 1 pixels")
        bent = np.ravel(np.asarray(self.distortion, dtype=object)).tolist()
        if len(bent) != 5:
            raise InputError("lens distortion", got=f"{len(bent)} numbers", expected="OpenCV's k1, k2, p1, p2, k3")
        given = [self.fx, self.fy, self.cx, self.cy, *bent]
        if not all(isinstance(n, Real) and math.isfinite(n) for n in given) or min(self.fx, self.fy) <= 0:
            raise InputError("camera intrinsics", got=given, expected="finite numbers, focal lengths > 0")
        object.__setattr__(self, "distortion", tuple(map(float, bent)))

    @classmethod
    def from_lens(
        cls, focal_length_m: float, sensor_size_m: tuple[float, float], resolution_px: tuple[int, int]
    ) -> Camera:
        """The distortion-free camera of a lens on a sensor, principal point in the image centre.

        Args:
            focal_length_m: focal length (the paper's Pulnix lens: 0.016).
            sensor_size_m: width and height of the sensor (a 1/3-inch CCD: 0.0048, 0.0036).
            resolution_px: width and height of the image.
        """
        (width_m, height_m), (width_px, height_px) = sensor_size_m, resolution_px
        return cls(
            width_px,
            height_px,
            fx=focal_length_m / width_m * width_px,
            fy=focal_length_m / height_m * height_px,
            cx=(width_px - 1) / 2,
            cy=(height_px - 1) / 2,
        )

    @classmethod
    def from_matrix(
        cls, matrix: ArrayLike, resolution_px: tuple[int, int], distortion: ArrayLike | None = None
    ) -> Camera:
        """The camera that ``cv2.calibrateCamera`` found.

        Args:
            matrix: the 3x3 calibration matrix, without skew.
            resolution_px: width and height of the image.
            distortion: k1, k2, p1, p2, k3 and more that are 0, as OpenCV returns 4, 5, 8, 12 or 14 of them, in an
                array of any shape; empty or None for a lens without distortion.

        Raises:
            InputError: when the matrix is no such matrix, or the lens has more coefficients.
        """
        K = np.asarray(matrix, dtype=float)
        empty = [(0, 1), (1, 0), (2, 0), (2, 1)]
        if K.shape != (3, 3) or any(K[place] != 0 for place in empty) or K[2, 2] != 1:
            expected = "a 3x3 matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
            raise InputError("calibration matrix", got=K.tolist(), expected=expected)
        fx, fy, cx, cy = (float(K[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return cls(resolution_px[0], resolution_px[1], fx, fy, cx, cy, distortion_of(distortion))

    def reduced(self, block_px: int) -> Camera:
        """The camera that takes each block of pixels, ``block_px`` wide and high, for one pixel."""
        offset = (block_px - 1) / 2
        return Camera(
            -(-self.width_px // block_px),
            -(-self.height_px // block_px),
            self.fx / block_px,
            self.fy / block_px,
            (self.cx - offset) / block_px,
            (self.cy - offset) / block_px,
            self.distortion,
        )

    @property
    def matrix(self) -> Array:
        """The 3x3 calibration matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points_camera: ArrayLike) -> Array:
        """Pixels (N, 2) of points (N, 3) given in the camera frame in metres; NaN for points not in front."""
        points = np.atleast_2d(np.asarray(points_camera, dtype=float))
        in_front = points[:, 2] > 1e-9
        normalised = np.full((len(points), 2), np.nan)
        normalised[in_front] = points[in_front, :2] / points[in_front, 2:]
        x, y = normalised.T
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.column_stack([self.fx * xd + self.cx, self.fy * yd + self.cy])

    def rays(self, pixels: ArrayLike) -> Array:
        """Viewing rays (N, 3) with z = 1 in the camera frame, through distorted pixels (N, 2)."""
        pixels_array = np.atleast_2d(np.asarray(pixels, dtype=float))
        if any(self.distortion):
            # Five iterations, OpenCV's default, leave half a pixel in the corners of a wide lens.
            until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-9)
            bent = np.array(self.distortion)
            flat = cv2.undistortPoints(pixels_array[:, None, :], self.matrix, bent, criteria=until)
            normalised = flat.reshape(-1, 2)
        else:
            normalised = (pixels_array - (self.cx, self.cy)) / (self.fx, self.fy)
        return np.column_stack([normalised, np.ones(len(normalised))])


def distortion_of(coefficients: ArrayLike | None) -> tuple[float, float, float, float, float]:
    """The five coefficients of a lens, k1, k2, p1, p2, k3, from as many as OpenCV gives.

    Args:
        coefficients: 4, 5, 8, 12 or 14 numbers in OpenCV's order, those after k3 being 0; none for no distortion.

    Raises:
        InputError: another number of them, or a lens that five do not describe.
    """
    given = [] if coefficients is None else np.ravel(np.asarray(coefficients, dtype=float)).tolist()
    if len(given) not in (0, 4, 5, 8, 12, 14):
        raise InputError("lens distortion", got=f"{len(given)} numbers", expected="k1, k2, p1, p2, k3: 5 numbers")
    if any(given[5:]):
        do = "Calibrate without CALIB_RATIONAL_MODEL, CALIB_THIN_PRISM_MODEL and CALIB_TILTED_MODEL."
        raise InputError("lens distortion", got=given, expected="no coefficients but k1, k2, p1, p2, k3", do=do)
    k1, k2, p1, p2, k3 = (given + [0.0] * 5)[:5]
    return k1, k2, p1, p2, k3


@dataclass(frozen=True, eq=False)
@frozen_arrays
class View:
    """One photograph and where it was taken from.

    Attributes:
        image: uint8, (H, W) grey or (H, W, 3) RGB; read-only.
        camera: the intrinsics the image was taken with.
        T_world_camera: pose of the OpenCV camera frame in the world, as far as the robot knows it; may be given as
            a 4x4 matrix.
        name: a label for people.
    """

    image: NDArray[np.uint8]
    camera: Camera
    T_world_camera: RigidTransform
    name: str = "view"

    def __post_init__(self) -> None:
        if not isinstance(self.camera, Camera):
            got, do = f"{type(self.camera).__name__} object", "Camera.from_matrix makes one of a calibration matrix."
            raise InputError(f"camera of {self.name}", got=got, expected="a vision.Camera", do=do)
        pose = rigid_transform(self.T_world_camera, f"T_world_camera of {self.name}")
        object.__setattr__(self, "T_world_camera", pose)
        image = np.ascontiguousarray(self.image)
        size = (self.camera.height_px, self.camera.width_px)
        if image.dtype != np.uint8 or image.shape[:2] != size or image.shape[2:] not in ((), (3,)):
            raise InputError(
                f"image of {self.name}",
                got=f"{image.dtype} {image.shape}",
                expected=f"uint8 {size} or {(*size, 3)}, the size of its camera",
            )
        object.__setattr__(self, "image", image)

    @property
    def gray(self) -> NDArray[np.uint8]:
        """The image as (H, W) grey levels."""
        if self.image.ndim == 2:
            return self.image
        return np.asarray(cv2.cvtColor(self.image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)

    def project(self, points_world: ArrayLike) -> Array:
        """Pixels (N, 2) of points (N, 3) given in the world frame in metres."""
        return self.camera.project(self.T_world_camera.inv().apply(np.atleast_2d(points_world)))

    def undistorted(self) -> View:
        """The view as a distortion-free lens would have seen it; itself where the lens is free of distortion."""
        if not any(self.camera.distortion):
            return self
        image = cv2.remap(np.asarray(self.image), *_undistortion_maps(self.camera), cv2.INTER_LINEAR)
        camera = replace(self.camera, distortion=(0.0, 0.0, 0.0, 0.0, 0.0))
        return View(np.asarray(image, dtype=np.uint8), camera, self.T_world_camera, self.name)


class CameraArrays(NamedTuple):
    """The cameras of V views as the compiled loops read them.

    Attributes:
        T_camera_world: (V, 4, 4).
        intrinsics: (V, 4) fx, fy, cx, cy.
    """

    T_camera_world: Array
    intrinsics: Array


def camera_arrays(views: Sequence[View]) -> CameraArrays:
    """The cameras of views."""
    T = np.stack([np.linalg.inv(v.T_world_camera.as_matrix()) for v in views])
    intrinsics = np.array([(v.camera.fx, v.camera.fy, v.camera.cx, v.camera.cy) for v in views], dtype=np.float64)
    return CameraArrays(T, intrinsics)


@lru_cache(maxsize=16)
def _undistortion_maps(camera: Camera) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Where each pixel of a distortion-free image lies in that of a camera, in the fixed-point form of OpenCV."""
    K, size = camera.matrix, (camera.width_px, camera.height_px)
    whole, fraction = cv2.initUndistortRectifyMap(K, np.array(camera.distortion), np.eye(3), K, size, cv2.CV_16SC2)
    return read_only((np.asarray(whole, np.int16), np.asarray(fraction, np.uint16)))


TOLERANCE = 1e-4  # for matrices that were written with five decimals
EXPECTED = "a scipy RigidTransform, or a 4x4 matrix of a rigid motion"


def rigid_transform(value: object, what: str) -> RigidTransform:
    """The rigid motion that a value is.

    Args:
        value: a single ``RigidTransform``, or a 4x4 matrix: a rotation without reflection, a translation, and the
            row (0, 0, 0, 1).
        what: names the value in errors.

    Raises:
        InputError: when it is none.
    """
    if isinstance(value, RigidTransform):
        if not value.single or not np.isfinite(value.as_matrix()).all():
            raise InputError(what, got=value, expected="one finite rigid motion")
        return value
    try:
        matrix = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(what, got=f"{type(value).__name__} object", expected=EXPECTED) from None
    if matrix.shape != (4, 4):
        raise InputError(what, got="None" if value is None else f"shape {matrix.shape}", expected=EXPECTED)
    if not np.isfinite(matrix).all() or not _is_rigid(matrix):
        raise InputError(what, got=matrix.tolist(), expected=EXPECTED)
    matrix[3] = 0.0, 0.0, 0.0, 1.0  # scipy takes nothing else
    return RigidTransform.from_matrix(matrix)


def _is_rigid(matrix: np.ndarray) -> bool:
    rotation = matrix[:3, :3]
    if np.abs(rotation).max() > 2:  # the product of larger numbers could overflow
        return False
    off = max(np.abs(rotation @ rotation.T - np.eye(3)).max(), np.abs(matrix[3] - [0, 0, 0, 1]).max())
    return bool(off < TOLERANCE and np.linalg.det(rotation) > 0)
