"""The views of a lesson as a directory: pictures, and ``views.json`` with intrinsics and camera poses.

::

    {
      "schema_version": 1,
      "part": "cover2",
      "unit": "metre",
      "views": [
        {
          "name": "front 1",
          "image": "front_1.png",
          "camera": {"width_px": 640, "height_px": 480, "fx": 2133.3, "fy": 2133.3, "cx": 319.5, "cy": 239.5,
                     "distortion": [k1, k2, p1, p2, k3]},
          "T_part_camera": [[r, r, r, x], [r, r, r, y], [r, r, r, z], [0, 0, 0, 1]]
        }
      ]
    }

``T_part_camera`` carries points from the camera's frame (x right, y down, z forward, as in OpenCV) into the part's
(z is the axis of revolution, +z the front). ``assets/models/teaching_views.schema.json`` describes every field.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.camera import Camera, View
from vision.errors import FileFormatError, InputError
from vision.json_value import JsonValue, parse, read_text
from vision.teaching.events import matrix_of, pose_of

SCHEMA_VERSION = 1
VIEWS_FILE = "views.json"


def load_views(directory: Path) -> list[View]:
    """Read the views of a lesson.

    Args:
        directory: with ``views.json`` and the pictures.

    Returns:
        The views as distortion-free lenses would have seen them; their world frame is the part's frame.

    Raises:
        InputError: when a file is missing or no picture.
        FileFormatError: when ``views.json`` is wrong, with the path to the field.
    """
    return [_view_from(item, directory).undistorted() for item in _read(directory)["views"].items()]


def load_part_name(directory: Path) -> str:
    """The name of the part that the views show; errors as of :func:`load_views`."""
    return _read(directory)["part"].text()


def save_views(directory: Path, views: Sequence[View], part: str) -> None:
    """Write the views of a lesson: grey PNGs, and ``views.json``.

    Raises:
        InputError: when two views have one name, or the directory cannot be written.
    """
    files = [f"{re.sub(r'[^A-Za-z0-9-]+', '_', view.name)}.png" for view in views]
    if len(set(files)) != len(files):
        raise InputError("names of the views", got=[v.name for v in views], expected="different names")
    document = {
        "schema_version": SCHEMA_VERSION,
        "part": part,
        "unit": "metre",
        "views": [_view_to_dict(view, file) for view, file in zip(views, files, strict=True)],
    }
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for view, file in zip(views, files, strict=True):
            (directory / file).write_bytes(_png(view.gray))
        text = json.dumps(document, indent=2, allow_nan=False) + "\n"
        (directory / VIEWS_FILE).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError("lesson directory", got=f"{directory} ({error})", expected="a writable directory") from error


def _read(directory: Path) -> dict[str, JsonValue]:
    path = directory / VIEWS_FILE
    root = parse(
        read_text(path, "description of the views", "Describe the pictures in it: README, 'Teaching'."),
        str(path),
        "description of views",
    )
    d = root.members("schema_version", "part", "unit", "views")
    d["schema_version"].check(d["schema_version"].value == SCHEMA_VERSION, str(SCHEMA_VERSION))
    d["unit"].choice(("metre",))
    d["part"].text()
    d["views"].check(len(d["views"].items()) >= 2, "a list of at least two views")
    return d


def _view_to_dict(view: View, file: str) -> dict[str, Any]:
    camera = view.camera
    return {
        "name": view.name,
        "image": file,
        "camera": {
            "width_px": camera.width_px,
            "height_px": camera.height_px,
            "fx": camera.fx,
            "fy": camera.fy,
            "cx": camera.cx,
            "cy": camera.cy,
            "distortion": list(camera.distortion),
        },
        "T_part_camera": matrix_of(view.T_world_camera),
    }


def _view_from(item: JsonValue, directory: Path) -> View:
    d = item.members("name", "image", "camera", "T_part_camera")
    rows = d["T_part_camera"].items()
    d["T_part_camera"].check(len(rows) == 4, "four rows of four numbers")
    matrix = tuple(tuple(row.vector(4).tolist()) for row in rows)
    try:
        pose = pose_of(matrix)
    except InputError as error:
        where = f"{item.source}: {d['T_part_camera'].path}"
        raise FileFormatError(where, got=error.got, expected=error.expected) from error
    camera = _camera_from(d["camera"])
    name = d["image"].text()
    d["image"].check(Path(name).name == name, "a file name without a directory")
    image = _read_image(directory / name)
    if image.shape[:2] != (camera.height_px, camera.width_px):
        raise FileFormatError(
            f"{item.source}: {d['image'].path}",
            got=f"a picture of {image.shape[1]} x {image.shape[0]} pixels",
            expected=f"the size of its camera, {camera.width_px} x {camera.height_px}",
        )
    return View(image, camera, pose, d["name"].text())


def _camera_from(item: JsonValue) -> Camera:
    d = item.members("width_px", "height_px", "fx", "fy", "cx", "cy", "distortion")
    k1, k2, p1, p2, k3 = d["distortion"].vector(5).tolist()
    return Camera(
        d["width_px"].count(),
        d["height_px"].count(),
        d["fx"].positive(),
        d["fy"].positive(),
        d["cx"].number(),
        d["cy"].number(),
        (k1, k2, p1, p2, k3),
    )


def _read_image(path: Path) -> NDArray[np.uint8]:
    try:
        encoded = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise InputError("picture", got=f"{path} ({error})", expected="a readable file") from error
    image = cv2.imdecode(encoded, cv2.IMREAD_ANYCOLOR) if encoded.size else None
    if image is None:
        raise InputError("picture", got=str(path), expected="a PNG, JPEG or TIFF with 8 bits per channel")
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2RGB)
    return np.asarray(image, dtype=np.uint8)


def _png(gray: NDArray[np.uint8]) -> bytes:
    # Sensor noise hardly repeats itself: Huffman coding alone is smaller than with a search for repetitions.
    settings = [cv2.IMWRITE_PNG_COMPRESSION, 9, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    _, encoded = cv2.imencode(".png", gray, [*settings, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_ALL_FILTERS])
    return bytes(encoded.tobytes())
