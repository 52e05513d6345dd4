"""``focalpick localize``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from benchmark.commands.common import Name, print_line, results_console
from vision import kernel_cache
from vision.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from vision.geometry.camera import View
    from vision.geometry.workspace import Workspace
    from vision.model.vision_model import VisionModel
    from vision.pose.estimate import PoseEstimate


def localize(
    views: Annotated[Path, tyro.conf.arg(metavar="DIR")],
    part: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="(or --model)")] = None,
    model: Annotated[
        tuple[Path, ...], tyro.conf.arg(metavar="FILE [FILE ...]", help_behavior_hint="(or --part)")
    ] = (),
    workspace: Annotated[
        tuple[float, float, float, float, float, float] | None,
        tyro.conf.arg(metavar="X0 Y0 Z0 X1 Y1 Z1", help_behavior_hint="(optional)"),
    ] = None,
    localizer: Name = "focal",
    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="(optional)")] = None,
    format: Literal["table", "json"] = "table",
) -> int:
    """Find taught parts in pictures of your own and print their poses.

    The directory holds the pictures and a views.json with the intrinsics and the pose of the camera for each, as
    docs/vision.md explains. Poses are in the world frame of these. The rotation is a rotation vector in degrees;
    sigma is one standard deviation in the worst direction, as far as the pictures tell.

    Example: focalpick localize --views docs/images/three_views --part cover2 --out found

    Args:
        views: directory with views.json and the pictures.
        part: hub, cover1 or cover2, whose models are shipped; several with commas.
        model: files of models that you taught.
        workspace: two corners of the box in which parts can be, in metres, in the world frame.
        localizer: finds the poses: focal, focal-region, focal-group, paper, previous, or module:name of your own.
        out: directory in which to draw the poses over the pictures; made where it is missing.
        format: table for the terminal, json for programs, in metres and radians and with the whole covariance.
    """
    kernel_cache.require()
    from benchmark.localizers.registry import make_localizer
    from vision.files.views import load_views

    models = _models(part, model)
    box = None if workspace is None else _box(workspace)
    if localizer == "oracle":
        raise InputError(
            "localizer",
            got="oracle",
            expected="one that needs no truth: focal, focal-region, focal-group, paper, previous, or your own",
        )
    finder = make_localizer(localizer, models, tuple)
    pictures = load_views(views)
    found = finder.localize(pictures, box).estimates
    if all(estimate.views < 2 for estimate in found):  # under wrong poses no two views agree on a piece
        _doubt_poses(pictures, box, models)
    if format == "json":
        print(json.dumps([_as_json(estimate) for estimate in found], indent=2, allow_nan=False))
    else:
        results_console().print(_as_table(found, pictures))
    if out is not None:
        _draw(out, pictures, found, models)
    return 0


def _models(part: str | None, files: Sequence[Path]) -> list[VisionModel]:
    from benchmark.commands.common import split_parts
    from benchmark.meshes.mesh_file import MeshReference
    from benchmark.models import load_model as load_shipped
    from vision.model.model_file import load_model

    if (part is None) == (not files):
        got = "neither" if part is None else "both"
        raise InputError("--part and --model", got=got, expected="one of them")
    names = dict.fromkeys(name for kind in split_parts(part) or () for name in kind.split("+"))
    for name in names:
        if MeshReference.parse(name) is not None:
            expected = "a part whose model is shipped: hub, cover1 or cover2"
            raise InputError("--part", got=name, expected=expected, do="Give the model that you taught with --model.")
    return [load_shipped(name) for name in names] + [load_model(file) for file in files]


def _box(numbers: Sequence[float]) -> Workspace:
    from vision.geometry.workspace import Workspace

    x0, y0, z0, x1, y1, z1 = numbers
    return Workspace((x0, y0, z0), (x1, y1, z1))


def _doubt_poses(views: Sequence[View], box: Workspace | None, models: Sequence[VisionModel]) -> None:
    """Say so where the pictures contradict the poses of their cameras."""
    from vision.matching.pose_check import check_poses

    radii = [feature.circle.radius_m for model in models for feature in model.salient]
    complaint = check_poses(views, box, (min(radii), max(radii))).complaint
    if complaint:
        print_line(f"focalpick: warning: {complaint} (docs/vision.md, 'Conventions')")


def _as_table(found: Sequence[PoseEstimate], views: Sequence[View]) -> Table:
    import numpy as np
    from rich import box
    from rich.table import Table

    title = f"{len(found)} found in {len(views)} view{'s' if len(views) > 1 else ''}"
    table = Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    headings = ("x y z (mm)", "rotation (°)", "sigma (mm)", "sigma (°)", "Score", "Views", "Turn known")
    table.add_column("Part")
    for heading in headings:
        table.add_column(heading, justify="right")
    for e in found:
        at = " ".join(f"{1e3 * v:8.2f}" for v in e.T_world_part.translation)
        turned = " ".join(f"{v:7.2f}" for v in np.degrees(e.T_world_part.rotation.as_rotvec()))
        sigma_mm, sigma_deg = 1e3 * _sigma(e.covariance[:3, :3]), np.degrees(_sigma(e.covariance[3:, 3:]))
        known = "yes" if e.inplane_known else "no"
        table.add_row(
            e.part, at, turned, f"{sigma_mm:.2f}", f"{sigma_deg:.2f}", f"{e.score:.2f}", str(e.views), known
        )
    return table


def _sigma(covariance: Any) -> float:
    """Standard deviation in the worst direction."""
    import numpy as np

    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))


def _as_json(estimate: PoseEstimate) -> dict[str, object]:
    return {
        "part": estimate.part,
        "T_world_part": estimate.T_world_part.as_matrix().tolist(),
        "covariance": estimate.covariance.tolist(),
        "score": float(estimate.score),
        "probability": estimate.probability,
        "process": estimate.extractor,
        "residual_px": float(estimate.residual_px),
        "views": int(estimate.views),
        "inplane_known": bool(estimate.inplane_known),
    }


def _draw(
    directory: Path, views: Sequence[View], found: Sequence[PoseEstimate], models: Sequence[VisionModel]
) -> None:
    """A picture with the poses for each view.

    Raises:
        InputError: the directory cannot be written.
    """
    import cv2

    from vision.drawing.superimpose import superimpose

    try:
        directory.mkdir(parents=True, exist_ok=True)
        for number, view in enumerate(views, start=1):
            drawn = cv2.cvtColor(superimpose(view, found, models), cv2.COLOR_RGB2BGR)
            name = f"{number}_{re.sub(r'[^A-Za-z0-9-]+', '_', view.name)}.png"
            (directory / name).write_bytes(cv2.imencode(".png", drawn)[1].tobytes())
    except OSError as error:
        do = "Choose another --out."
        raise InputError(f"directory {directory}", got=error.strerror, expected="a writable one", do=do) from None
    print_line(f"Drawn in {directory}: {len(views)} picture{'s' if len(views) > 1 else ''}")
