"""What several commands share."""

from __future__ import annotations

import itertools
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from vision import kernel_cache
from vision.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from vision.model.vision_model import VisionModel

_PRESET = "(default: the preset's)"
_LEFT_OUT = "(optional)"

# Options that leave the preset's value alone when they are not given, and optional paths; only for a readable --help.
PresetName = Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint=_PRESET)]
PresetNumber = Annotated[int | None, tyro.conf.arg(metavar="N", help_behavior_hint=_PRESET)]
PartNames = Annotated[
    str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint=_PRESET, aliases=["--part"])
]  # sweep takes several, run takes one: the same word shall do
OptionalPath = Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint=_LEFT_OUT)]
PresetPieces = Annotated[str | None, tyro.conf.arg(metavar="N", help_behavior_hint=_PRESET)]
Pieces = Annotated[str, tyro.conf.arg(metavar="N")]
Name = Annotated[str, tyro.conf.arg(metavar="NAME")]
Millimetres = Annotated[float | None, tyro.conf.arg(metavar="MM")]
Number = Annotated[int, tyro.conf.arg(metavar="N")]
Seconds = Annotated[float, tyro.conf.arg(metavar="SECONDS")]
SweepDirectory = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]


def named_model(name: Path) -> VisionModel:
    """The vision model in a file, or the one that is shipped for the part of that name.

    Raises:
        InputError: there is no such file.
        FileFormatError: it is corrupt.
    """
    from benchmark.models import MODELS
    from vision.model.model_file import load_model

    shipped = MODELS / f"{name}.json"
    return load_model(shipped if not name.suffix and not name.exists() and shipped.is_file() else name)


def split_parts(text: str | None) -> tuple[str, ...] | None:
    """``"hub,cover1"`` as kinds of scene, each made of known part names or mesh files; None stays None.

    Raises:
        InputError: an unknown part, a mesh that cannot be one, or one with a comma or + in its name.
    """
    if text is None:
        return None
    from benchmark.meshes.mesh_file import MeshReference
    from benchmark.world.parts import PART_NAMES, get_part, unknown_part

    _check_no_file_is_cut(text)
    kinds = tuple(kind.strip() for kind in text.split(","))
    for name in (name for kind in kinds for name in kind.split("+")):
        if MeshReference.parse(name) is not None:
            get_part(name)
        elif name not in PART_NAMES:
            raise unknown_part(name, got=name or "nothing")
    return kinds


def fewest_and_most(pieces: str) -> tuple[int, int]:
    """``"4-6"`` as (4, 6), ``"5"`` as (5, 5).

    Raises:
        InputError: it is neither.
    """
    from benchmark.config import MOST_PIECES

    match = re.fullmatch(r"(\d{1,9})(?:-(\d{1,9}))?", pieces.strip(), flags=re.ASCII)
    fewest, most = (int(match[1]), int(match[2] or match[1])) if match else (0, 0)
    if not 1 <= fewest <= most <= MOST_PIECES:
        raise InputError(
            "pieces", got=pieces, expected=f"a number from 1 to {MOST_PIECES}, or two of them such as 4-6"
        )
    return fewest, most


def _check_no_file_is_cut(text: str) -> None:
    """Make sure that no comma or + is one in the name of a mesh file.

    Raises:
        InputError: one is.
    """
    from benchmark.meshes.mesh_file import MeshReference

    pieces = re.split("([,+])", text)
    for start, end in itertools.combinations(range(0, len(pieces) + 1), 2):
        name = "".join(pieces[start:end]).strip()
        mesh = MeshReference.parse(name)
        if re.search("[,+]", name) and mesh is not None and os.path.isfile(mesh.path):
            expected = "a name without comma and +: commas separate parts, and + mixes them"
            do = "Copy or link the file to another name, or go to its folder if that has them in its name."
            raise InputError("part", got=f"the file {mesh.path}", expected=expected, do=do)


def prepare_process() -> None:
    """Settle the OpenGL backend and keep numerical libraries to one thread, before any of them is imported.

    Raises:
        ResourceError: nothing can draw, or the vision kernels cannot be compiled.
    """
    kernel_cache.require()
    from benchmark.child_process import SINGLE_THREADED
    from benchmark.world.gl import require_backend

    for name, value in SINGLE_THREADED.items():
        os.environ.setdefault(name, value)
    require_backend()


def check_localizer(name: str, part_names: Sequence[str], models: str | None = None) -> None:
    """Make the localizer once, so that what is wrong with it or with the models shows before anything runs.

    Raises:
        InputError: no such localizer, or a part that it was not taught.
        FileFormatError: a vision model's file is corrupt.
    """
    from benchmark.localizers.registry import make_localizer
    from benchmark.models import load_model

    make_localizer(name, [load_model(part, models) for part in part_names], tuple)


def results_console() -> Console:
    """The console for results: as wide as the terminal; a pipe or log has no width, and 80 columns break the rows."""
    return make_console(width=None if sys.stdout.isatty() or "COLUMNS" in os.environ else 120)


def make_console(**settings: Any) -> Console:
    """Rich's console; when the reader has gone, as in `focalpick table DIR | head`, the command line answers it.

    Rich itself ends the program with 1 then, which stands for a check that has failed.
    """
    from rich.console import Console

    class Piped(Console):
        def on_broken_pipe(self) -> None:
            self.quiet = True
            raise BrokenPipeError

    return Piped(**settings)


def print_line(text: str) -> None:
    """One line on standard error, which keeps standard output for results."""
    print(text, file=sys.stderr, flush=True)
