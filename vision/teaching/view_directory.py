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

from collections.abc import Sequence
from pathlib import Path

from vision.files.json_reader import JsonValue
from vision.files.views import (
    LESSON_POSE,
    SCHEMA_VERSION,
    VIEWS_FILE,
    check_head,
    read_description,
    read_view,
    write_views,
)
from vision.geometry.camera import View

__all__ = ["SCHEMA_VERSION", "VIEWS_FILE", "load_part_name", "load_views", "save_views"]


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
    return [read_view(item, directory, LESSON_POSE).undistorted() for item in _read(directory)["views"].items()]


def load_part_name(directory: Path) -> str:
    """The name of the part that the views show; errors as of :func:`load_views`."""
    return _read(directory)["part"].text()


def save_views(directory: Path, views: Sequence[View], part: str) -> None:
    """Write the views of a lesson: grey PNGs, and ``views.json``.

    Raises:
        InputError: when two views have one name, or the directory cannot be written.
    """
    write_views(directory, views, LESSON_POSE, {"part": part})


def _read(directory: Path) -> dict[str, JsonValue]:
    root = read_description(directory, "Describe the pictures in it: README, 'Teaching'.")
    return check_head(root, ("part",), least_views=2)
