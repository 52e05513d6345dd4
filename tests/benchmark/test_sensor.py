"""The sensor adds what its preset says, no more and no less, and the same for the same seed."""

from __future__ import annotations

from dataclasses import replace

import cv2
import mujoco
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.world import gl
from benchmark.world.sensor import (
    SENSORS,
    SensorConfig,
    calibration_error,
    capture,
    opencv_pose,
    sample_appearance,
    sample_hand_eye_error,
    sample_repeatability_error,
    sensor_config,
)
from vision.errors import InputError
from vision.geometry.camera import Camera
from vision.pose.calibration import CalibrationError

CAMERA = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
IDEAL, LAB, SHOPFLOOR = (SENSORS[name] for name in ("ideal", "lab", "shopfloor"))


def flat(level: int) -> np.ndarray:
    return np.full((480, 640, 3), level, np.uint8)


def spheres_model(centres: np.ndarray, radius: float, T_world_camera: RigidTransform) -> mujoco.MjModel:
    """Spheres before a camera with the paper's optics at a given pose (OpenCV axes)."""
    spec = mujoco.MjSpec()
    for centre in centres:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], pos=centre)
    half_turn_about_x = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    spec.worldbody.add_camera(
        name="c",
        pos=T_world_camera.translation,
        quat=(T_world_camera.rotation * half_turn_about_x).as_quat(scalar_first=True),
        focal_length=[0.016, 0.016],
        sensor_size=[0.0048, 0.0036],
        resolution=[640, 480],
    )
    spec.stat.extent = 1.0
    spec.visual.quality.numslices = spec.visual.quality.numstacks = 120
    return spec.compile()


@pytest.mark.parametrize("seed", [0, 1])
def test_camera_model_agrees_with_the_renderer_within_a_twentieth_of_a_pixel(seed: int) -> None:
    """A small sphere's outline is an ellipse whose centre lies off the projected centre by a known amount."""
    rng = np.random.default_rng(seed)
    pose = RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))
    depth, radius = 1.2, 0.012
    corners = [(x, y) for y in (60, 240, 420) for x in (60, 220, 420, 580)]
    centres = pose.apply(CAMERA.rays(corners + rng.uniform(-9, 9, (12, 2))) * depth)
    model = spheres_model(centres, radius, pose)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    gl.choose_backend()
    with mujoco.Renderer(model, 480, 640) as renderer:
        renderer.update_scene(data, "c")
        renderer.enable_segmentation_rendering()
        numbers = renderer.render()[..., 0]
    seen = opencv_pose(data, 0)
    assert np.allclose(seen.as_matrix(), pose.as_matrix(), atol=1e-9)
    measured = np.array(ndimage.center_of_mass(np.ones_like(numbers), numbers, range(12)))[:, ::-1]
    expected = np.array([outline_centre(seen.inv().apply(centre), radius) for centre in centres])
    # The centroid of about 1400 whole pixels has an error of its own.
    assert np.abs(measured - expected).max() < 0.15
    assert np.abs((measured - expected).mean(axis=0)).max() < 0.05
    assert np.sqrt(np.mean((measured - expected) ** 2)) < 0.05


def outline_centre(centre: np.ndarray, radius: float) -> np.ndarray:
    """Centre of the ellipse that a sphere's outline is in the picture, in pixels."""
    tangent_cone = np.outer(centre, centre) - (centre @ centre - radius**2) * np.eye(3)
    x, y = np.linalg.solve(tangent_cone[:2, :2], -tangent_cone[:2, 2])
    return np.array([CAMERA.fx * x + CAMERA.cx, CAMERA.fy * y + CAMERA.cy])


def test_ideal_sensor_only_turns_colour_into_grey() -> None:
    picture = flat(0)
    picture[:, :320] = (200, 100, 50)
    grey = capture(picture, np.random.default_rng(0), IDEAL)
    assert grey.dtype == np.uint8
    assert grey.shape == (480, 640)
    assert set(np.unique(grey)) == {0, round(0.299 * 200 + 0.587 * 100 + 0.114 * 50)}


@pytest.mark.parametrize(("config", "sigma"), [(LAB, 2.0), (SHOPFLOOR, 5.0)])
def test_noise_has_the_deviation_of_the_preset(config: SensorConfig, sigma: float) -> None:
    grey = capture(flat(120), np.random.default_rng(1), config).astype(float)
    assert grey.std() == pytest.approx(np.hypot(sigma, 1 / np.sqrt(12)), rel=0.02)
    neighbours = np.corrcoef(grey[:, 1:].ravel(), grey[:, :-1].ravel())[0, 1]
    assert abs(neighbours) < 0.01  # added after the blur: pixels are independent


def test_point_spread_keeps_the_energy_and_has_the_sigma_of_the_preset() -> None:
    picture = flat(0)
    picture[240, 320] = 255
    blur = replace(IDEAL, psf_sigma_px=1.2)
    spots = capture(picture, np.random.default_rng(0), blur).astype(float)
    assert spots.sum() == pytest.approx(255, rel=0.03)  # rounding to whole grey levels
    picture[:] = 0
    picture[:, 320:] = 200
    edge = np.diff(capture(picture, np.random.default_rng(0), blur)[240].astype(float))
    at = np.arange(len(edge)) - 319
    assert edge.sum() == 200
    assert edge @ at / 200 == pytest.approx(0, abs=0.01)
    assert np.sqrt(edge @ at**2 / 200) == pytest.approx(1.2, rel=0.05)


def test_exposure_stays_within_its_spread_and_uses_it() -> None:
    quiet = replace(LAB, noise_sigma=0.0)
    levels = [capture(flat(100), np.random.default_rng(seed), quiet)[0, 0] for seed in range(60)]
    assert 90 <= min(levels) < 93
    assert 107 < max(levels) <= 110


def test_same_seed_same_bytes_and_another_seed_others() -> None:
    def picture(seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        look = sample_appearance(rng, SHOPFLOOR, CAMERA)
        return capture(flat(99), rng, SHOPFLOOR, look, CAMERA).tobytes()

    assert picture(4) == picture(4)
    assert picture(4) != picture(5)


def test_left_over_distortion_moves_the_border_by_the_amount_of_the_preset() -> None:
    """Draw dots, distort them, find them again."""
    config = replace(SHOPFLOOR, noise_sigma=0.0, exposure_spread=0.0, uneven_light=0.0, distortion_px=2.0)
    look = sample_appearance(np.random.default_rng(3), config, CAMERA)
    distorted_camera = replace(CAMERA, distortion=look.distortion)
    dots = np.array([(x, y) for x in (40, 320, 600) for y in (40, 240, 440)])
    picture = flat(0)
    for x, y in dots:
        cv2.circle(picture, (int(x), int(y)), 6, (255, 255, 255), -1)
    grey = capture(picture, np.random.default_rng(0), config, look, CAMERA)
    labels, count = ndimage.label(grey > 0)
    assert count == 9
    found = np.array(ndimage.center_of_mass(grey, labels, range(1, 10)))[:, ::-1]
    expected = distorted_camera.project(CAMERA.rays(dots))
    nearest = found[np.linalg.norm(found[None] - expected[:, None], axis=2).argmin(axis=1)]
    assert np.abs(nearest - expected).max() < 0.05
    border = np.array([(x, y) for x in range(640) for y in (0, 479)] + [(x, y) for x in (0, 639) for y in range(480)])
    moved = np.linalg.norm(distorted_camera.project(CAMERA.rays(border)) - border, axis=1)
    assert moved.max() == pytest.approx(2.0, rel=0.01)


def test_uneven_light_loses_its_fraction_across_the_picture() -> None:
    config = replace(IDEAL, uneven_light=0.3)
    look = sample_appearance(np.random.default_rng(0), config, CAMERA)
    grey = capture(flat(150), np.random.default_rng(0), config, look, CAMERA).astype(float)
    across, down = grey.mean(axis=0), grey.mean(axis=1)
    loss = np.hypot(across[-1] - across[0], down[-1] - down[0]) / 150
    assert loss == pytest.approx(0.3, abs=0.02)
    assert grey.mean() == pytest.approx(150, rel=0.01)


@pytest.mark.parametrize("seed", range(5))
def test_light_shines_down_from_beyond_the_bin(seed: int) -> None:
    direction = np.array(sample_appearance(np.random.default_rng(seed), LAB, CAMERA).light_direction)
    assert np.linalg.norm(direction) == pytest.approx(1)
    assert np.rad2deg(np.arccos(-direction[2])) == pytest.approx(28, abs=10)
    assert direction[0] < 0  # away from the arm, which would stand in its way


def test_calibration_errors_have_the_root_mean_square_of_the_preset() -> None:
    rng = np.random.default_rng(0)
    mounting = [sample_hand_eye_error(rng, SHOPFLOOR) for _ in range(2000)]
    lengths = [np.linalg.norm(error.translation) for error in mounting]
    angles = [np.rad2deg(error.rotation.magnitude()) for error in mounting]
    placing = [np.linalg.norm(sample_repeatability_error(rng, SHOPFLOOR).translation) for _ in range(2000)]
    for values, expected in ((lengths, 0.5e-3), (angles, 0.1), (placing, 0.1e-3)):
        assert np.sqrt(np.mean(np.square(values))) == pytest.approx(expected, rel=0.05)
    exact = sample_hand_eye_error(rng, LAB)
    assert np.array_equal(exact.as_matrix(), np.eye(4))


def test_unknown_preset_and_impossible_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="ideal, lab, shopfloor"):
        sensor_config("moonlight")
    with pytest.raises(InputError, match="none negative"):
        SensorConfig("bad", noise_sigma=-1.0)
    with pytest.raises(InputError, match="fraction"):
        SensorConfig("bad", specular=2.0)


def test_wrong_picture_and_missing_camera_are_refused() -> None:
    with pytest.raises(InputError, match="uint8"):
        capture(np.zeros((4, 4, 3)), np.random.default_rng(0), IDEAL)  # type: ignore[arg-type]
    look = sample_appearance(np.random.default_rng(0), SHOPFLOOR, CAMERA)
    with pytest.raises(InputError, match="camera"):
        capture(flat(1), np.random.default_rng(0), SHOPFLOOR, look)


def test_what_is_known_of_the_calibration_is_how_large_its_errors_are():
    assert calibration_error(IDEAL).is_zero
    assert calibration_error(LAB).is_zero
    known = calibration_error(SHOPFLOOR)
    assert known == CalibrationError(0.5e-3, np.radians(0.1), 0.1e-3, 0.2)
    drawn = [sample_hand_eye_error(np.random.default_rng(seed), SHOPFLOOR) for seed in range(2000)]
    lengths = [np.linalg.norm(T.translation) for T in drawn]
    angles = [T.rotation.magnitude() for T in drawn]
    assert np.sqrt(np.mean(np.square(lengths))) == pytest.approx(known.hand_eye_translation_m, rel=0.05)
    assert np.sqrt(np.mean(np.square(angles))) == pytest.approx(known.hand_eye_rotation_rad, rel=0.05)
