"""The files that the results of a sweep depend on, told apart by their content: a name alone says nothing of it."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from modulefinder import ModuleFinder
from pathlib import Path

from benchmark.config import SweepConfig
from benchmark.localizers.registry import user_file
from benchmark.meshes.mesh_file import MeshReference
from benchmark.models import model_path
from vision.errors import InputError


def input_digests(config: SweepConfig) -> dict[str, str]:
    """SHA-256 of every file that the user may change: meshes, vision models, the user's localizer.

    To the localizer belongs what its module imports from its own folder.

    Args:
        config: of the sweep.

    Returns:
        Digests by what a file is to the sweep, for example ``mesh pulley.stl`` or ``vision model of hub``. A file
        that is missing is left out; whoever needs it says so.

    Raises:
        InputError: a file cannot be read.
    """
    return {name: _digest(path) for name, path in _files(config) if path.is_file()}


def _files(config: SweepConfig) -> Iterator[tuple[str, Path]]:
    for part in config.part_names:
        if (mesh := MeshReference.parse(part)) is not None:
            yield f"mesh {mesh.path}", mesh.path
        yield f"vision model of {part}", model_path(part, config.models)
    for name in (config.localizer, *config.compared):
        if (module := user_file(name)) is not None:
            yield f"localizer {name} in {module.name}", module
            yield from ((f"{path.name} of localizer {name}", path) for path in _imported(module))


def _imported(module: Path) -> list[Path]:
    """What a module imports of the files in its own folder, directly or through each other."""
    finder = ModuleFinder([str(module.parent)])
    with contextlib.suppress(SyntaxError, UnicodeDecodeError, ImportError):  # whoever imports it says so
        finder.run_script(str(module))
    files = (getattr(found, "__file__", None) for found in finder.modules.values())
    return sorted({Path(file) for file in files if file} - {module})


def _digest(path: Path) -> str:
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(str(path), got=error.strerror, expected="a file that can be read") from None
