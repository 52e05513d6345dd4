import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision.camera import Camera, View

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
