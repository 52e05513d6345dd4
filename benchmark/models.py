"""The taught vision models: those that come with focalpick, or a directory of the user's own."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from benchmark.world.mesh_file import MeshReference
from vision.model import model_file
from vision.model.vision_model import VisionModel

MODELS = Path(__file__).resolve().parents[1] / "assets" / "models"


@lru_cache
def load_model(part: str, models: str | None = None) -> VisionModel:
    """The taught vision model of a part, under the name by which the scene knows the part.

    Args:
        part: its name, or a mesh file; the model's file has the name of the part, or of the mesh file without suffix.
        models: directory of models that come before the shipped ones.

    Raises:
        InputError: the part was never taught.
        FileFormatError: the model file is corrupt.
    """
    model = model_file.load_model(model_path(part, models))
    return model if MeshReference.parse(part) is None else replace(model, part=part)


def model_path(part: str, models: str | None = None) -> Path:
    """The file of a part's vision model; where the part was never taught, the first one that was looked for."""
    mesh = MeshReference.parse(part)
    file = f"{part if mesh is None else mesh.path.stem}.json"
    places = [MODELS / file] if models is None else [Path(models) / file, MODELS / file]
    return next((path for path in places if path.is_file()), places[0])
