"""The taught vision models: those that come with focalpick, or a directory of the user's own."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from benchmark.world.mesh_file import MeshReference
from vision.errors import InputError
from vision.model import model_file
from vision.model.vision_model import VisionModel

MODELS = Path(__file__).resolve().parents[1] / "assets" / "models"


@lru_cache
def load_model(part: str, models: str | None = None) -> VisionModel:
    """The taught vision model of a part, under the name by which the scene knows the part.

    Args:
        part: its name, or a mesh file; the model's file has the name of the part, or of the mesh file without suffix.
        models: directory of models that come before the shipped ones. A mesh file has none among these.

    Raises:
        InputError: the part was never taught.
        FileFormatError: the model file is corrupt.
    """
    mesh = MeshReference.parse(part)
    if mesh is not None:
        return replace(_load_own(mesh, models), part=part)
    file = f"{part}.json"
    places = [MODELS / file] if models is None else [Path(models) / file, MODELS / file]
    return model_file.load_model(next((path for path in places if path.is_file()), places[0]))


def _load_own(mesh: MeshReference, models: str | None) -> VisionModel:
    """The model of a part that the user brings, under the name that it was taught by."""
    file = Path("models" if models is None else models) / f"{mesh.path.stem}.json"
    if models is not None and file.is_file():
        return model_file.load_model(file)
    command = ["focalpick", "teach", "--mesh", str(mesh.path), "--unit", mesh.unit, "--out", str(file)]
    raise InputError(
        f"vision model of {mesh}",
        got="no --models" if models is None else f"no file {file}",
        expected=f"a directory with {file.name}" if models is None else "a taught model",
        do=f"Teach the part first: {shlex.join(command)}. Then give --models {shlex.quote(str(file.parent))}.",
    )
