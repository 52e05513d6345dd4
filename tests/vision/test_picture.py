"""Pictures from files: what the levels mean, and what is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vision.errors import InputError
from vision.files.picture import read_picture

GREY = np.random.default_rng(0).integers(0, 256, (40, 60)).astype(np.uint8)
FULL = np.linspace(0, 65535, 40 * 60).reshape(40, 60).astype(np.uint16)


def saved(path, image):
    assert cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("name", ["a.png", "a.tiff", "a.pgm"])
def test_eight_bits_are_read_as_they_are(name, tmp_path):
    assert np.array_equal(read_picture(str(saved(tmp_path / name, GREY))), GREY)


@pytest.mark.parametrize("bits", [8, 16])
def test_colour_is_rgb_without_transparency(bits, tmp_path):
    blue_green_red_alpha = np.zeros((4, 5, 4), np.uint8 if bits == 8 else np.uint16)
    blue_green_red_alpha[:] = np.array([10, 20, 200, 255]) * (1 if bits == 8 else 257)
    image = read_picture(saved(tmp_path / "a.png", blue_green_red_alpha))
    assert image.shape == (4, 5, 3)
    assert (image == [200, 20, 10]).all()


@pytest.mark.parametrize("name", ["a.png", "a.tiff"])
def test_sixteen_bits_are_scaled_by_what_the_file_can_hold(name, tmp_path):
    half = (FULL // 2).astype(np.uint16)
    for levels in (FULL, half):
        image = read_picture(saved(tmp_path / name, levels))
        assert image.dtype == np.uint8
        assert np.abs(image - levels / 257).max() <= 0.5


@pytest.mark.parametrize("bits", [10, 12])
def test_twelve_bits_in_a_file_of_sixteen_are_refused_with_the_remedy(bits, tmp_path):
    path = saved(tmp_path / "a.png", (FULL >> (16 - bits)).astype(np.uint16))
    with pytest.raises(InputError, match=rf"a\.png: got 16 bits .* no level above {2**bits - 1}; .* Scale"):
        read_picture(path)


def test_floating_point_pictures_are_refused_with_the_remedy(tmp_path):
    path = saved(tmp_path / "a.tiff", FULL.astype(np.float32) / 65535)
    with pytest.raises(InputError, match=r"a\.tiff: got float32 pixels; .* 8 or 16 bits .* Scale it"):
        read_picture(path)


@pytest.mark.parametrize("content", [None, b"", b"no picture", "truncated", "damaged"], ids=str)
def test_what_is_no_picture_is_refused_without_a_word_on_standard_error(content, tmp_path, capfd):
    path = tmp_path / "a.png"
    encoded = bytearray(cv2.imencode(".png", GREY)[1].tobytes())
    if content == "truncated":
        content = bytes(encoded[: len(encoded) // 2])
    elif content == "damaged":
        encoded[len(encoded) // 2] ^= 255  # libpng writes to standard error itself
        content = bytes(encoded)
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"picture .*a\.png: got"):
        read_picture(path)
    assert capfd.readouterr() == ("", "")


def test_standard_error_is_there_again_after_a_picture(tmp_path, capfd):
    import os

    read_picture(saved(tmp_path / "a.png", GREY))
    os.write(2, b"heard")
    assert capfd.readouterr().err == "heard"


def test_what_belongs_to_intrinsics_is_not_turned_by_its_exif_orientation(tmp_path):
    image = np.zeros((16, 32), np.uint8)
    image[:8, :16] = 255
    _, encoded = cv2.imencode(".jpg", image)
    half_a_turn = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x03\0\0\0\0\0\0"
    block = b"Exif\0\0" + half_a_turn
    marker = b"\xff\xe1" + (len(block) + 2).to_bytes(2, "big") + block
    path = tmp_path / "turned.jpg"
    path.write_bytes(encoded.tobytes()[:2] + marker + encoded.tobytes()[2:])
    as_sensor, as_looked_at = read_picture(path, turned=False), read_picture(path)
    assert as_sensor[2, 2] > 200 > as_sensor[13, 29]
    assert as_looked_at[13, 29] > 200 > as_looked_at[2, 2]
