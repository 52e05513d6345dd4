import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.geometry.camera import Camera, View

BENT = (-0.2, 0.05, 0.001, -0.002, 0.0)


def view(distortion, shape, seed=0):
    image = np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)
    camera = Camera(shape[1], shape[0], 200.0, 210.0, 60.0, 44.0, distortion)
    return View(image, camera, RigidTransform.identity())


@pytest.mark.parametrize("shape", [(90, 120), (90, 120, 3)])
def test_the_undistorted_image_is_that_of_opencv_each_time(shape):
    for seed in (0, 1):
        bent = view(BENT, shape, seed)
        expected = cv2.undistort(bent.image, bent.camera.matrix, np.array(BENT))
        assert (bent.undistorted().image == expected).all()
        assert not any(bent.undistorted().camera.distortion)


def test_another_camera_has_other_maps():
    bent, more_bent = view(BENT, (90, 120)), view((-0.4, *BENT[1:]), (90, 120))
    assert (bent.undistorted().image != more_bent.undistorted().image).any()


def test_a_view_without_distortion_is_left_alone():
    straight = view((0.0,) * 5, (90, 120))
    assert straight.undistorted() is straight


@pytest.mark.parametrize("block_px", [1, 2, 3])
def test_a_reduced_camera_sees_each_block_as_one_pixel(block_px):
    camera = Camera(641, 480, 700.0, 710.0, 311.0, 250.5)
    reduced = camera.reduced(block_px)
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 1], [0.3, 0.3, 2], (20, 3))
    block = np.floor((camera.project(points) + 0.5) / block_px)
    assert np.array_equal(np.round(reduced.project(points)), block)
    assert (reduced.width_px, reduced.height_px) == (-(-641 // block_px), 480 // block_px)


GREY = np.zeros((90, 120), np.uint8)
CAMERA = Camera(120, 90, 200.0, 200.0, 59.5, 44.5)
TURNED = RigidTransform.from_components([0.1, -0.2, 0.7], Rotation.from_rotvec([2.0, 0.3, -0.1]))


def test_a_pose_may_be_a_matrix():
    given = View(GREY, CAMERA, TURNED.as_matrix())
    assert isinstance(given.T_world_camera, RigidTransform)
    assert np.allclose(given.T_world_camera.as_matrix(), TURNED.as_matrix(), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("pose", "got"),
    [
        (None, "None"),
        ("left", "str object"),
        (np.eye(3), r"shape \(3, 3\)"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), r"\[\[1"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), r"\[\[2"),
        (TURNED.as_matrix().T, r"\[\["),
        (np.full((4, 4), np.nan), "nan"),
        (RigidTransform.from_matrix(np.stack([np.eye(4)] * 2)), "RigidTransform"),
        (RigidTransform.from_translation([np.nan, 0.0, 0.0]), "RigidTransform"),
    ],
    ids=str,
)
def test_what_is_no_pose_is_refused(pose, got):
    with pytest.raises(InputError, match=f"(?s)T_world_camera of left: got .*{got}.*; expected .*rigid motion"):
        View(GREY, CAMERA, pose, "left")


def test_what_is_no_camera_is_refused():
    with pytest.raises(InputError, match=r"camera of view: got NoneType object; .* Camera\.from_matrix"):
        View(GREY, None, TURNED)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"fx": np.nan}, "intrinsics"),
        ({"fy": -1.0}, "intrinsics"),
        ({"cx": "59.5"}, "intrinsics"),
        ({"distortion": (0.1, None, 0.0, 0.0, 0.0)}, "intrinsics"),
        ({"distortion": (0.1, 0.2)}, "distortion: got 2 numbers"),
        ({"width_px": 0}, "image size"),
        ({"height_px": 90.5}, "image size"),
    ],
    ids=str,
)
def test_what_no_camera_can_have_is_refused(changed, named):
    with pytest.raises(InputError, match=named):
        Camera(**{"width_px": 120, "height_px": 90, "fx": 200.0, "fy": 200.0, "cx": 59.5, "cy": 44.5} | changed)


@pytest.mark.parametrize("coefficients", [4, 5])
def test_a_camera_is_made_of_what_opencv_calibrates(coefficients):
    K = np.array([[700.0, 0.0, 311.0], [0.0, 710.0, 250.5], [0.0, 0.0, 1.0]])
    distortion = np.array([BENT[:coefficients]])  # OpenCV gives a row
    camera = Camera.from_matrix(K, (640, 480), distortion)
    assert camera == Camera(640, 480, 700.0, 710.0, 311.0, 250.5, (*BENT[:coefficients], 0.0)[:5])
    assert np.array_equal(camera.matrix, K)
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 1], [0.3, 0.3, 2], (20, 3))
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, distortion)[0].reshape(-1, 2)
    assert np.allclose(camera.project(points), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("matrix", "distortion", "named"),
    [
        (np.eye(2), BENT, "calibration matrix"),
        ([[700, 0.5, 311], [0, 700, 250], [0, 0, 1]], BENT, "calibration matrix"),  # skew
        ([[700, 0, 0], [0, 700, 0], [311, 250, 1]], BENT, "calibration matrix"),  # transposed
        ([[700, 0, 311], [0, 700, 250], [0, 0, 1]], np.zeros(7), "lens distortion: got 7 numbers"),
    ],
    ids=str,
)
def test_a_calibration_that_the_camera_cannot_have_is_refused(matrix, distortion, named):
    with pytest.raises(InputError, match=named):
        Camera.from_matrix(matrix, (640, 480), distortion)


@pytest.mark.parametrize("given", [None, [], *(np.zeros(n) for n in (4, 5, 8, 12, 14))], ids=str)
def test_a_lens_without_distortion_may_be_said_in_all_of_opencvs_ways(given):
    K = [[700, 0, 311], [0, 700, 250], [0, 0, 1]]
    assert Camera.from_matrix(K, (640, 480), given).distortion == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_coefficients_beyond_the_fifth_are_refused_with_a_remedy():
    with pytest.raises(InputError, match="CALIB_RATIONAL_MODEL"):
        Camera.from_matrix(np.eye(3), (640, 480), [0.1, 0, 0, 0, 0, 0.2, 0, 0])


@pytest.mark.parametrize(
    "k", [(-0.30, 0.10, 0.0, 0.0, -0.015), (-0.38, 0.18, 0.0, 0.0, -0.04), (-0.2, 0.05, 0.001, -0.001, 0.0)]
)
def test_rays_undo_projection_in_the_corners_of_a_wide_lens(k):
    camera = Camera(640, 480, 330.0, 330.0, 320.0, 240.0, k)
    directions = np.stack(np.meshgrid(np.linspace(-0.9, 0.9, 19), np.linspace(-0.68, 0.68, 15)), -1).reshape(-1, 2)
    pixels = camera.project(np.column_stack([directions, np.ones(len(directions))]))
    assert np.abs(camera.rays(pixels)[:, :2] - directions).max() * 330 < 1e-3
