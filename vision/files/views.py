"""Pictures of a scene as a directory: the files, and ``views.json`` with intrinsics and camera poses.

::

    {
      "schema_version": 1,
      "unit": "metre",
      "views": [
        {
          "name": "left",
          "image": "left.png",
          "camera": {"width_px": 640, "height_px": 480, "fx": 2133.3, "fy": 2133.3, "cx": 319.5, "cy": 239.5,
                     "distortion": [k1, k2, p1, p2, k3]},
          "T_world_camera": [[r, r, r, x], [r, r, r, y], [r, r, r, z], [0, 0, 0, 1]]
        }
      ]
    }

``T_world_camera`` carries points from the camera's frame (x right, y down, z forward, as in OpenCV) into the world's.
Where the pictures are those of a lesson, the world is the part's frame: the key is ``T_part_camera`` then, and
``part`` names the part (``vision.teaching.view_directory``).
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

from vision.errors import FileFormatError, InputError
from vision.files.json_reader import JsonValue, parse, read_text
from vision.files.picture import read_picture
from vision.geometry.camera import Camera, View, distortion_of, rigid_transform

SCHEMA_VERSION = 1
VIEWS_FILE = "views.json"
POSE, LESSON_POSE = "T_world_camera", "T_part_camera"


def load_views(directory: Path | str) -> list[View]:
    """Read the pictures of a scene, or of a lesson.

    Args:
        directory: with ``views.json`` and the pictures.

    Returns:
        The views as they were taken, with the distortion of their lenses.

    Raises:
        InputError: when a file is missing or no picture.
        FileFormatError: when ``views.json`` is wrong, with the path to the field.
    """
    directory = Path(directory)
    root = read_description(directory, "Describe the pictures in it: docs/vision.md, 'Pictures of your own'.")
    lesson = isinstance(root.value, dict) and "part" in root.value
    d = check_head(root, ("part",) if lesson else (), least_views=1)
    return [read_view(item, directory, LESSON_POSE if lesson else POSE) for item in d["views"].items()]


def save_views(directory: Path | str, views: Sequence[View]) -> None:
    """Write the pictures of a scene: grey PNGs, and ``views.json``.

    Raises:
        InputError: when two views have one name, or the directory cannot be written.
    """
    write_views(Path(directory), views, POSE, {})


def read_description(directory: Path, do: str) -> JsonValue:
    """``views.json``, not yet checked; ``do`` is the remedy where it is missing."""
    path = directory / VIEWS_FILE
    return parse(read_text(path, "description of the views", do), str(path), "description of views")


def check_head(root: JsonValue, more_keys: Sequence[str], least_views: int) -> dict[str, JsonValue]:
    """The members of a description: version, unit and views as they must be, and texts under ``more_keys``."""
    d = root.members("schema_version", *more_keys, "unit", "views")
    d["schema_version"].check(d["schema_version"].value == SCHEMA_VERSION, str(SCHEMA_VERSION))
    d["unit"].choice(("metre",))
    for key in more_keys:
        d[key].text()
    amount = {1: "one view", 2: "two views"}[least_views]
    d["views"].check(len(d["views"].items()) >= least_views, f"a list of at least {amount}")
    return d


def read_view(item: JsonValue, directory: Path, pose_key: str) -> View:
    """One view of a description, with its picture."""
    d = item.members("name", "image", "camera", pose_key)
    rows = d[pose_key].items()
    d[pose_key].check(len(rows) == 4, "four rows of four numbers")
    matrix = np.array([row.vector(4) for row in rows])
    try:
        pose = rigid_transform(matrix, pose_key)
    except InputError as error:
        where = f"{item.source}: {d[pose_key].path}"
        raise FileFormatError(where, got=error.got, expected="a 4x4 matrix of a rigid motion") from error
    camera = _camera_from(d["camera"])
    name = d["image"].text()
    d["image"].check(Path(name).name == name, "a file name without a directory")
    image = read_picture(directory / name, turned=False)
    if image.shape[:2] != (camera.height_px, camera.width_px):
        raise FileFormatError(
            f"{item.source}: {d['image'].path}",
            got=f"a picture of {image.shape[1]} x {image.shape[0]} pixels",
            expected=f"the size of its camera, {camera.width_px} x {camera.height_px}",
        )
    return View(image, camera, pose, d["name"].text())


def write_views(directory: Path, views: Sequence[View], pose_key: str, head: dict[str, str]) -> None:
    """Write grey PNGs and ``views.json``, whose head holds more texts than version and unit."""
    files = [f"{re.sub(r'[^A-Za-z0-9-]+', '_', view.name)}.png" for view in views]
    if len(set(files)) != len(files):
        raise InputError("names of the views", got=[v.name for v in views], expected="different names")
    document = {
        "schema_version": SCHEMA_VERSION,
        **head,
        "unit": "metre",
        "views": [_view_to_dict(view, file, pose_key) for view, file in zip(views, files, strict=True)],
    }
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for view, file in zip(views, files, strict=True):
            (directory / file).write_bytes(_png(view.gray))
        text = json.dumps(document, indent=2, allow_nan=False) + "\n"
        (directory / VIEWS_FILE).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise InputError(
            "directory for views", got=f"{directory} ({error})", expected="a writable directory"
        ) from error


def _view_to_dict(view: View, file: str, pose_key: str) -> dict[str, Any]:
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
        pose_key: [[float(v) + 0.0 for v in row] for row in view.T_world_camera.as_matrix()],
    }


def _camera_from(item: JsonValue) -> Camera:
    d = item.members("width_px", "height_px", "fx", "fy", "cx", "cy", "distortion")
    coefficients = d["distortion"]
    bent = None if coefficients.value is None else [number.number() for number in coefficients.items()]
    try:
        distortion = distortion_of(bent)
    except InputError as error:
        do = error.do or "Give k1, k2, p1, p2, k3; an empty list is a lens without distortion."
        what = f"{coefficients.source}: {coefficients.path}"
        raise FileFormatError(what, got=error.got, expected=error.expected, do=do) from None
    return Camera(
        d["width_px"].count(),
        d["height_px"].count(),
        d["fx"].positive(),
        d["fy"].positive(),
        d["cx"].number(),
        d["cy"].number(),
        distortion,
    )


def _png(gray: NDArray[np.uint8]) -> bytes:
    # Sensor noise hardly repeats itself: Huffman coding alone is smaller than with a search for repetitions.
    settings = [cv2.IMWRITE_PNG_COMPRESSION, 9, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
    _, encoded = cv2.imencode(".png", gray, [*settings, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_ALL_FILTERS])
    return bytes(encoded.tobytes())
