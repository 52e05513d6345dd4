"""``focalpick teach``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from benchmark.child_process import ended_by_signals
from benchmark.commands.common import OptionalPath, prepare_process, print_line
from benchmark.interrupts import ended_in_order
from vision import kernel_cache
from vision.errors import InputError

_OptionalName = Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="(optional)")]
_OptionalUnit = Annotated[str | None, tyro.conf.arg(metavar="UNIT", help_behavior_hint="(optional)")]
_OptionalPort = Annotated[
    int | None, tyro.conf.arg(metavar="N", help_behavior_hint="(default: a free one from 8765)")
]
_OptionalSize = Annotated[float | None, tyro.conf.arg(metavar="MM", help_behavior_hint="(optional)")]


def teach(
    part: _OptionalName = None,
    views: OptionalPath = None,
    mesh: OptionalPath = None,
    unit: _OptionalUnit = None,
    diameter_mm: _OptionalSize = None,
    dir: OptionalPath = None,
    out: OptionalPath = None,
    port: _OptionalPort = None,
    show: bool = True,
    replay: OptionalPath = None,
) -> int:
    """Teach a part on a page in the browser: mark its circles in a few pictures, place grasps, try it, save it.

    The pictures of a part of the benchmark, or of a mesh, are rendered into a directory; --views opens a directory
    with pictures of your own. Everything that is done there is kept in its session.json, at once.

    Example: focalpick teach --part cover2

    Args:
        part: a part of the benchmark.
        views: a directory with pictures and views.json.
        mesh: an OBJ, STL or PLY file of a new part.
        unit: of the mesh, m or mm; m when left out. pulley.stl:mm says it, too.
        diameter_mm: outline diameter of the part in the pictures of --views.
        dir: where the pictures of --part or --mesh go; teaching/NAME by default.
        out: the model that is saved; model.json in the directory by default.
        port: of the page, which only this machine can reach.
        show: open the browser; --no-show leaves that to you.
        replay: a recorded session, or the directory that it is in: make its model without a page.
    """
    if replay is not None:
        return _replay(replay, out)
    given = [name for name, value in (("--part", part), ("--views", views), ("--mesh", mesh)) if value is not None]
    if len(given) != 1:
        expected = "exactly one of --part, --views, --mesh and --replay"
        raise InputError("arguments", got=" and ".join(given) or "none of them", expected=expected)
    prepare_process()
    _open_page(part, views, mesh, unit, diameter_mm, dir, out, port, show)
    return 0


def _open_page(
    part: str | None,
    views: Path | None,
    mesh: Path | None,
    unit: str | None,
    diameter_mm: float | None,
    dir: Path | None,
    out: Path | None,
    port: int | None,
    show: bool,
) -> None:
    from benchmark.lessons.page_services import LessonServices, open_mesh, open_part, open_views
    from vision.teaching.editor.server import serve

    services: LessonServices
    if views is not None:
        directory, services = open_views(views, diameter_mm)
    elif mesh is not None:
        directory, services = open_mesh(mesh, unit, dir)
    else:
        directory, services = open_part(str(part), dir)
    with ended_in_order(), ended_by_signals():
        serve(directory, out or directory / "model.json", services, port, show)


def _replay(session: Path, out: Path | None) -> int:
    kernel_cache.require()
    from vision.model.model_file import model_to_json, save_model
    from vision.teaching.session_file import replay

    model = replay(session)
    if out is None:
        print(model_to_json(model), end="")
        return 0
    save_model(model, out)
    print_line(f"Taught {model.part}: {len(model.features)} features, saved as {out}")
    return 0
