"""What a real camera adds to a rendered picture: light, exposure, blur, noise, distortion, calibration error."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.geometry.camera import Camera
from vision.pose.calibration import CalibrationError

Array = NDArray[np.float64]
Distortion = tuple[float, float, float, float, float]

_OPENGL_TO_OPENCV = np.diag([1.0, -1.0, -1.0])
_KEY_LIGHT_TILT = np.deg2rad(28.0)
# The light stands across the bin from the arm, at most this far to either side: elsewhere the arm is in its way.
_KEY_LIGHT_SIDEWAYS = np.deg2rad(80.0)
_GREY_WEIGHTS = np.array([0.299, 0.587, 0.114], dtype=np.float32)


@dataclass(frozen=True)
class SensorConfig:
    """How far the camera, the light and the calibration are from perfect.

    Attributes:
        name: a label for people and records.
        noise_sigma: standard deviation of the noise of one pixel, in grey levels.
        psf_sigma_px: standard deviation of the Gaussian point spread.
        exposure_spread: half the range of the exposure factor around 1.
        light_spread_rad: how far the direction of the key light strays from its nominal tilt of 28 degrees; any
            value above zero also draws the side it comes from.
        uneven_light: loss of brightness across the picture, from the bright to the dark side, as a fraction.
        specular: strength of the highlights on metal, 0 to 1.
        texture_strength: contrast of dirt, cast and machining marks, 0 to 1.
        distortion_px: lens distortion that calibration left over, where it is largest in the picture.
        hand_eye_translation_m: root mean square length of the camera's mounting error, drawn once per episode.
        hand_eye_rotation_rad: root mean square angle of the same.
        repeatability_m: root mean square positioning error of the arm, drawn for every view.
    """

    name: str
    noise_sigma: float = 0.0
    psf_sigma_px: float = 0.0
    exposure_spread: float = 0.0
    light_spread_rad: float = 0.0
    uneven_light: float = 0.0
    specular: float = 0.15
    texture_strength: float = 0.0
    distortion_px: float = 0.0
    hand_eye_translation_m: float = 0.0
    hand_eye_rotation_rad: float = 0.0
    repeatability_m: float = 0.0

    def __post_init__(self) -> None:
        numbers = [value for key, value in vars(self).items() if key != "name"]
        if not np.isfinite(numbers).all() or min(numbers) < 0:
            raise InputError(f"sensor {self.name}", got=numbers, expected="finite numbers, none negative")
        for fraction in ("exposure_spread", "uneven_light", "specular", "texture_strength"):
            if getattr(self, fraction) > 1:
                raise InputError(fraction, got=getattr(self, fraction), expected="a fraction from 0 to 1")


SENSORS = {
    config.name: config
    for config in (
        SensorConfig("ideal"),
        SensorConfig(
            "lab", noise_sigma=2.0, psf_sigma_px=0.7, exposure_spread=0.1, light_spread_rad=float(np.deg2rad(10))
        ),
        SensorConfig(
            "shopfloor",
            noise_sigma=5.0,
            psf_sigma_px=1.2,
            exposure_spread=0.1,
            light_spread_rad=float(np.deg2rad(15)),
            uneven_light=0.3,
            specular=0.7,
            texture_strength=1.0,
            distortion_px=0.2,
            hand_eye_translation_m=0.5e-3,
            hand_eye_rotation_rad=float(np.deg2rad(0.1)),
            repeatability_m=0.1e-3,
        ),
    )
}


def sensor_config(name: str) -> SensorConfig:
    """The preset of that name.

    Raises:
        InputError: there is no such preset.
    """
    if name not in SENSORS:
        raise InputError("sensor", got=repr(name), expected=f"one of {', '.join(SENSORS)}")
    return SENSORS[name]


def with_hand_eye_error(config: SensorConfig, translation_m: float) -> SensorConfig:
    """The same sensor with another calibration error.

    Args:
        config: the sensor.
        translation_m: root mean square length of the camera's mounting error. Its angle grows in proportion, as the
            ``shopfloor`` preset pairs them: 0.2 degrees for each millimetre.
    """
    pair = SENSORS["shopfloor"]
    rotation_rad = pair.hand_eye_rotation_rad / pair.hand_eye_translation_m * translation_m
    return replace(config, hand_eye_translation_m=translation_m, hand_eye_rotation_rad=rotation_rad)


def calibration_error(config: SensorConfig) -> CalibrationError:
    """What whoever calibrated the cell would know of the calibration: how large its errors are, not what they are."""
    return CalibrationError(
        hand_eye_translation_m=config.hand_eye_translation_m,
        hand_eye_rotation_rad=config.hand_eye_rotation_rad,
        arm_translation_m=config.repeatability_m,
        lens_px=config.distortion_px,
    )


@dataclass(frozen=True)
class Appearance:
    """How the cell looks in one episode.

    Attributes:
        light_direction: unit vector along which the key light shines, world frame.
        light_gradient: brightness lost per half picture towards +x and +y of the image, as fractions.
        specular: strength of the highlights on metal, 0 to 1.
        texture_strength: contrast of dirt, cast and machining marks, 0 to 1.
        texture_seed: seed of these marks.
        distortion: OpenCV's (k1, k2, p1, p2, k3) of the lens distortion that the calibration does not know of.
    """

    light_direction: tuple[float, float, float]
    light_gradient: tuple[float, float]
    specular: float
    texture_strength: float
    texture_seed: int
    distortion: Distortion


def sample_appearance(rng: np.random.Generator, config: SensorConfig, camera: Camera) -> Appearance:
    """Draw the light, the marks on the surfaces and the left-over distortion of one episode."""
    spread = config.light_spread_rad
    azimuth = np.pi + (rng.uniform(-_KEY_LIGHT_SIDEWAYS, _KEY_LIGHT_SIDEWAYS) if spread > 0 else np.deg2rad(40.0))
    tilt = _KEY_LIGHT_TILT + rng.uniform(-spread, spread)
    darker = rng.uniform(-np.pi, np.pi)
    return Appearance(
        light_direction=(
            float(np.sin(tilt) * np.cos(azimuth)),
            float(np.sin(tilt) * np.sin(azimuth)),
            float(-np.cos(tilt)),
        ),
        light_gradient=(
            float(config.uneven_light / 2 * np.cos(darker)),
            float(config.uneven_light / 2 * np.sin(darker)),
        ),
        specular=config.specular,
        texture_strength=config.texture_strength,
        texture_seed=int(rng.integers(2**31)),
        distortion=_residual_distortion(rng, config.distortion_px, camera),
    )


def _residual_distortion(rng: np.random.Generator, largest_px: float, camera: Camera) -> Distortion:
    """Random k1, p1, p2, scaled so that the largest displacement on the picture's border is as asked."""
    corner_radius = np.hypot(camera.width_px / camera.fx, camera.height_px / camera.fy) / 2
    k1 = rng.normal() / corner_radius**2
    p1, p2 = rng.normal(scale=0.3, size=2) / corner_radius
    if largest_px == 0:
        return (0.0, 0.0, 0.0, 0.0, 0.0)
    across, down = np.linspace(0, camera.width_px - 1, 17), np.linspace(0, camera.height_px - 1, 13)
    border = np.array([(x, y) for x in across for y in down if x in across[[0, -1]] or y in down[[0, -1]]])
    rays = camera.rays(border)
    # Displacement is linear in (k1, p1, p2): measure it for a thousandth of them and scale.
    warped = _with_distortion(camera, (k1 * 1e-3, 0.0, p1 * 1e-3, p2 * 1e-3, 0.0)).project(rays)
    scale = 1e-3 * largest_px / np.linalg.norm(warped - border, axis=1).max()
    return (float(k1 * scale), 0.0, float(p1 * scale), float(p2 * scale), 0.0)


def _with_distortion(camera: Camera, distortion: Distortion) -> Camera:
    return Camera(camera.width_px, camera.height_px, camera.fx, camera.fy, camera.cx, camera.cy, distortion)


def capture(
    render_rgb: NDArray[np.uint8],
    rng: np.random.Generator,
    config: SensorConfig,
    appearance: Appearance | None = None,
    camera: Camera | None = None,
) -> NDArray[np.uint8]:
    """Turn a rendered picture into the grey picture that the camera would have delivered.

    Args:
        render_rgb: uint8 (H, W, 3).
        rng: the source of exposure and noise.
        config: the strength of each effect.
        appearance: uneven light and distortion of the episode; None for neither.
        camera: the intrinsics of the picture, needed where the appearance has a distortion.

    Returns:
        uint8 (H, W) grey levels.

    Raises:
        InputError: the picture is not uint8 (H, W, 3), or a distortion comes without a camera.
    """
    if render_rgb.dtype != np.uint8 or render_rgb.ndim != 3 or render_rgb.shape[2] != 3:
        raise InputError("rendered picture", got=f"{render_rgb.dtype} {render_rgb.shape}", expected="uint8 (H, W, 3)")
    gain = rng.uniform(1 - config.exposure_spread, 1 + config.exposure_spread)
    grey = (render_rgb @ _GREY_WEIGHTS) * np.float32(gain)
    if appearance is not None and any(appearance.light_gradient):
        grey *= _light_field(grey.shape, appearance.light_gradient)
    if appearance is not None and any(appearance.distortion):
        if camera is None:
            raise InputError("camera", got=None, expected="the intrinsics of the picture to distort")
        grey = cv2.remap(grey, *_distortion_maps(camera, appearance.distortion), cv2.INTER_CUBIC)
    if config.psf_sigma_px > 0:
        grey = cv2.GaussianBlur(grey, (0, 0), config.psf_sigma_px, borderType=cv2.BORDER_REFLECT)
    if config.noise_sigma > 0:
        grey = grey + rng.standard_normal(grey.shape, dtype=np.float32) * np.float32(config.noise_sigma)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _light_field(shape: tuple[int, ...], gradient: tuple[float, float]) -> NDArray[np.float32]:
    height, width = shape
    x = np.linspace(-1, 1, width)[None, :] * gradient[0]
    y = np.linspace(-1, 1, height)[:, None] * gradient[1]
    return np.asarray(1 - x - y, dtype=np.float32)


@lru_cache(maxsize=4)
def _distortion_maps(camera: Camera, distortion: Distortion) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """For each pixel of the distorted picture, where it lies in the rendered one."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    source = camera.project(_with_distortion(camera, distortion).rays(pixels))
    x, y = source.T.reshape(2, camera.height_px, camera.width_px).astype(np.float32)
    return x, y


def sample_hand_eye_error(rng: np.random.Generator, config: SensorConfig) -> RigidTransform:
    """The mounting error T_camera_calibrated of one episode: the believed pose, seen from the true one."""
    rotation = rng.normal(scale=config.hand_eye_rotation_rad / np.sqrt(3), size=3)
    translation = rng.normal(scale=config.hand_eye_translation_m / np.sqrt(3), size=3)
    return RigidTransform.from_components(translation, Rotation.from_rotvec(rotation))


def sample_repeatability_error(rng: np.random.Generator, config: SensorConfig) -> RigidTransform:
    """The positioning error of the arm at one view, a translation in the world frame."""
    return RigidTransform.from_translation(rng.normal(scale=config.repeatability_m / np.sqrt(3), size=3))


def opencv_pose(data: mujoco.MjData, camera_id: int) -> RigidTransform:
    """The true T_world_camera, in OpenCV's axes, of a MuJoCo camera (which looks along its -z, y up).

    Args:
        data: the simulation, with forward kinematics done.
        camera_id: number of the camera in the model.
    """
    rotation = Rotation.from_matrix(data.cam_xmat[camera_id].reshape(3, 3) @ _OPENGL_TO_OPENCV)
    return RigidTransform.from_components(data.cam_xpos[camera_id], rotation)


def mujoco_quaternion(T_world_camera: RigidTransform) -> Array:
    """The other way: (4,) w, x, y, z of the MuJoCo camera whose OpenCV pose this is."""
    rotation = T_world_camera.rotation * Rotation.from_matrix(_OPENGL_TO_OPENCV)
    return np.asarray(rotation.as_quat(scalar_first=True))
