"""The taught vision models: those that come with focalpick, or a directory of the user's own."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from benchmark.meshes.mesh_file import MeshReference
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
    mesh, path = MeshReference.parse(part), model_path(part, models)
    if mesh is None:
        return model_file.load_model(path)
    if models is None or not path.is_file():
        raise _untaught(mesh, path, models)
    return replace(model_file.load_model(path), part=part)


def model_path(part: str, models: str | None = None) -> Path:
    """The file of a part's vision model; where the part was never taught, the first one that was looked for."""
    mesh = MeshReference.parse(part)
    if mesh is not None:
        return Path("models" if models is None else models) / f"{mesh.path.stem}.json"
    places = [MODELS / f"{part}.json"] if models is None else [Path(models) / f"{part}.json", MODELS / f"{part}.json"]
    return next((path for path in places if path.is_file()), places[0])


def _untaught(mesh: MeshReference, file: Path, models: str | None) -> InputError:
    command = ["focalpick", "teach", "--mesh", str(mesh.path), "--unit", mesh.unit, "--out", str(file)]
    return InputError(
        f"vision model of {mesh}",
        got="no --models" if models is None else f"no file {file}",
        expected=f"a directory with {file.name}" if models is None else "a taught model",
        do=f"Teach the part first: {shlex.join(command)}. Then give --models {shlex.quote(str(file.parent))}.",
    )
