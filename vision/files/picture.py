"""Pictures from files: 8 bits per channel, grey or RGB, by one rule for every command."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.files.regular import check_regular

EXPECTED = "a PNG, JPEG or TIFF with 8 or 16 bits per channel"
FAINTEST_16_BIT = 4096
"""Brightest level of a 16-bit picture below which it holds the 12 bits, or fewer, of a camera that nobody scaled."""

_one_decoder = threading.Lock()


def read_picture(path: Path | str, *, turned: bool = True) -> NDArray[np.uint8]:
    """Read a picture: PNG, JPEG, TIFF, or what else OpenCV reads.

    16 bits per channel are scaled to 8 by 1/257, so that the brightest level that the file can hold becomes 255. The
    scale is that of the file and not of what it shows, so that several pictures of a scene stay comparable.

    Args:
        path: of the picture.
        turned: whether to turn it as its EXIF orientation says, as people look at it; False keeps the rows and
            columns of the sensor, which a camera's intrinsics belong to.

    Returns:
        (H, W) grey levels or (H, W, 3) RGB; transparency is dropped.

    Raises:
        InputError: when there is no such file, it is no picture or broken, holds floating-point numbers, or holds 16
            bits of which it uses at most the lower 12.
    """
    path = Path(path)
    try:
        encoded = np.frombuffer(check_regular(path).read_bytes(), np.uint8)
    except OSError as error:
        raise InputError(f"picture {path}", got=error.strerror, expected=EXPECTED) from None
    image = _decoded(encoded, turned)
    if image is None:
        raise InputError(f"picture {path}", got="a file that cannot be decoded", expected=EXPECTED)
    levels = _eight_bits(image, path)
    return levels if levels.ndim == 2 else np.asarray(cv2.cvtColor(levels, cv2.COLOR_BGR2RGB), np.uint8)


def _decoded(encoded: NDArray[np.uint8], turned: bool) -> NDArray[np.generic] | None:
    if encoded.size == 0:
        return None
    with _silent_decoders():
        try:
            keep = 0 if turned else cv2.IMREAD_IGNORE_ORIENTATION
            return cv2.imdecode(encoded, cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH | keep)
        except cv2.error:
            return None


def _eight_bits(image: NDArray[np.generic], path: Path) -> NDArray[np.uint8]:
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    if image.dtype != np.uint16:
        do = "Scale it to 0..255 and save it with 8 bits."
        raise InputError(f"picture {path}", got=f"{image.dtype} pixels", expected=EXPECTED, do=do)
    brightest = int(image.max(initial=0))
    if brightest < FAINTEST_16_BIT:
        raise InputError(
            f"picture {path}",
            got=f"16 bits per channel with no level above {brightest}",
            expected="levels up to 65535",
            do="Scale the levels of all pictures alike, those of 12 bits by 16, or save them with 8 bits.",
        )
    return np.asarray((image.astype(np.uint32) + 128) // 257, np.uint8)


@contextmanager
def _silent_decoders() -> Iterator[None]:
    """Keep OpenCV, and the libraries behind it, from writing about a broken file: the error says it in one line.

    libpng writes to the file descriptor of standard error, past Python and past OpenCV's own log.
    """
    with _one_decoder:
        level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            with _closed_standard_error():
                yield
        finally:
            cv2.utils.logging.setLogLevel(level)


@contextmanager
def _closed_standard_error() -> Iterator[None]:
    try:
        kept = os.dup(2)
    except OSError:  # the process has none
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
