"""What the teaching page asks of the benchmark: pictures of a part, and trials in the simulated cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmark.meshes.mesh_file import MeshReference
from benchmark.world.part import Part
from benchmark.world.parts import get_part
from vision.errors import InputError
from vision.geometry.camera import View
from vision.model.vision_model import VisionModel
from vision.teaching.editor.services import Description, SceneOutcome
from vision.teaching.view_directory import VIEWS_FILE, save_views

LESSONS = Path("teaching")
"""Where lesson directories are made."""


@dataclass(frozen=True)
class LessonServices:
    """Implements ``vision.teaching.editor.services.Services``.

    Attributes:
        description: what is known of the part.
        source: the part's name, or the mesh file; None for pictures alone.
    """

    description: Description | None
    source: str | None

    @property
    def trial_note(self) -> str:
        """In what a trial looks for the part."""
        if self.source is None:
            return "There is no mesh to simulate: looks for the part in the taught pictures themselves."
        return "Drops the part into a simulated bin, again and again, and looks for it in three views."

    def try_model(
        self,
        model: VisionModel,
        views: Sequence[View],
        scenes: int,
        seed: int,
        report: Callable[[SceneOutcome], None],
    ) -> None:
        """Localise the part in fresh scenes and report each when it is done."""
        from benchmark.lessons.model_trial import try_in_views, try_model

        if self.source is None:
            try_in_views(model, views, scenes, seed, report)
        else:
            try_model(model, self.source, scenes, seed, report)


def open_part(name: str, directory: Path | None) -> tuple[Path, LessonServices]:
    """A lesson directory for a part of the benchmark, with pictures rendered where there are none yet.

    Raises:
        InputError: for an unknown part, or a directory that cannot be written.
        ResourceError: when the machine cannot draw.
    """
    part = get_part(name)
    return _prepare(part, directory or LESSONS / part.name, name)


def open_mesh(mesh: Path, unit: str | None, directory: Path | None) -> tuple[Path, LessonServices]:
    """The same for any mesh.

    Args:
        mesh: its file; as where a part's name is expected, ``pulley.stl:mm`` names the unit, too.
        unit: of its coordinates; metres where nobody says anything.
        directory: of the lesson.

    Raises:
        InputError: no such file, or a solid that cannot be a part.
        FileFormatError: the file is no mesh.
        ResourceError: when the machine cannot draw.
    """
    named = MeshReference.parse(str(mesh))
    if named is None:
        do = "Export it as one of these."
        raise InputError("mesh", got=mesh, expected="an OBJ, STL or PLY file, with :m or :mm for its unit", do=do)
    if named.path != mesh and unit not in (None, named.unit):
        raise InputError("--unit", got=unit, expected=f"{named.unit}, as in {mesh}", do="Leave one of them out.")
    reference = MeshReference(named.path.resolve(), unit or named.unit)
    part = get_part(str(reference))
    return _prepare(part, directory or LESSONS / part.name, str(reference))


def open_views(directory: Path, diameter_mm: float | None) -> tuple[Path, LessonServices]:
    """A directory with pictures that somebody took; the diameter is asked on the page where it is not given."""
    if diameter_mm is None:
        return directory, LessonServices(None, None)
    from vision.teaching.view_directory import load_part_name

    return directory, LessonServices(Description(load_part_name(directory), diameter_mm / 1e3), None)


def _prepare(part: Part, directory: Path, source: str) -> tuple[Path, LessonServices]:
    if not (directory / VIEWS_FILE).exists():
        from benchmark.world.sensor import sensor_config
        from benchmark.world.studio import Sitter, Studio

        with Studio(Sitter(part.visual_mesh, part.diameter_m, part.rgba)) as studio:
            save_views(directory, studio.photograph(sensor_config("lab"), 0), part.name)
    return directory, LessonServices(Description(part.name, part.diameter_m, part.symmetry.fold), source)
