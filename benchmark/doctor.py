"""The checks of ``focalpick doctor``. Each is independent, and a broken one is a finding too."""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from vision import kernel_cache
from vision.errors import FocalpickError, ResourceError

ROOT = Path(__file__).resolve().parents[1]
RESTORE = (
    "Restore it: git checkout -- assets"
    if (ROOT / ".git").exists()
    else "Install again: pip install --force-reinstall --no-deps focalpick's address or folder"
)
LEAST_FREE_MB = 200
REINSTALL = "Run: make clean && make test, or pip install -e . -c constraints.txt"

_DRAW = """
import mujoco, numpy as np
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 2'/><geom type='sphere' size='.3' rgba='1 0 0 1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 64, 64) as renderer:
    renderer.update_scene(data)
    assert np.ptp(renderer.render()) > 0, "the picture is empty"
"""


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes:
        subject: what was checked.
        ok: whether it is as it should be.
        text: what was found, in a few words.
        remedy: what to do where it is not ok, as an imperative sentence; empty where the text says it.
    """

    subject: str
    ok: bool
    text: str
    remedy: str = ""


def examine() -> Iterator[Finding]:
    """All findings, each as soon as it is there."""
    for subject, check in CHECKS.items():
        try:
            yield from check()
        except FocalpickError as error:
            yield Finding(subject, False, str(error), "Follow the advice above")
        except Exception as error:
            yield Finding(subject, False, f"{type(error).__name__}: {error}", REINSTALL)


def check_python() -> Iterator[Finding]:
    """Python 3.11 or newer."""
    remedy = "Install Python 3.11 or newer and make the environment anew"
    yield Finding("python", sys.version_info >= (3, 11), platform.python_version(), remedy)


def check_versions() -> Iterator[Finding]:
    """Every requirement of the distribution is installed in a version that it allows."""
    wrong = []
    requirements = [r for r in metadata.requires("focalpick") or [] if "extra ==" not in r]
    for requirement in requirements:
        name, bounds = _parse(requirement)
        try:
            installed = metadata.version(name)
        except metadata.PackageNotFoundError:
            wrong.append(f"{name} is missing")
            continue
        if not all(_holds(installed, operator, bound) for operator, bound in bounds):
            wrong.append(f"{name} {installed} is not {','.join(o + b for o, b in bounds)}")
    yield Finding("libraries", not wrong, "; ".join(wrong) or f"all {len(requirements)} as required", REINSTALL)


def check_pins() -> Iterator[Finding]:
    """The installed versions are those of the constraints file, with which the published tables were made."""
    path = ROOT / "constraints.txt"
    if not path.exists():
        return
    different = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if match := re.match(r"([A-Za-z0-9._-]+)==([^\s;#]+)", line):
            name, pinned = match.groups()
            try:
                installed = metadata.version(name)
            except metadata.PackageNotFoundError:
                continue  # of an extra that is not installed
            if installed != pinned:
                different.append(f"{name} {installed} instead of {pinned}")
    yield Finding("pinned versions", not different, "; ".join(different) or "as in constraints.txt", REINSTALL)


def check_gl() -> Iterator[Finding]:
    """A small picture can be drawn, in a process of its own that may crash."""
    from benchmark.world.gl import INSTALL, require_backend

    try:
        backend = require_backend()
    except ResourceError as error:
        yield Finding("OpenGL", False, str(error).removeprefix("OpenGL: "))
        return
    environment = {**os.environ, "MUJOCO_GL": backend}
    command = [sys.executable, "-c", _DRAW]
    drawn = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    text = f"draws with MUJOCO_GL={backend}"
    if drawn.returncode != 0:
        last = (drawn.stderr.strip().splitlines() or ["no message"])[-1]
        text = f"MUJOCO_GL={backend} cannot draw ({last})"
    yield Finding("OpenGL", drawn.returncode == 0, text, f"Unset MUJOCO_GL, or {INSTALL}")


def check_kernels() -> Iterator[Finding]:
    """The vision kernels can be compiled, and are kept."""
    kernel_cache.require()
    text = f"kept in {kernel_cache.folder()}" if kernel_cache.is_kept() else kernel_cache.ANEW
    yield Finding("compiled kernels", kernel_cache.is_kept(), text, "Set NUMBA_CACHE_DIR to a folder of your own")


def check_assets() -> Iterator[Finding]:
    """The files of every part and of the cell are there."""
    from benchmark.world.parts import PART_NAMES, get_part, vertices

    for name in PART_NAMES:
        part = get_part(name)
        missing = [path.name for path in (part.visual_mesh, *part.collision_meshes) if not path.exists()]
        text = f"missing {', '.join(missing)}" if missing else f"{len(vertices(part))} vertices"
        yield Finding(f"part {name}", not missing, text, "Run: focalpick assets build")
    for name in ("puma761.xml", "gripper.xml"):
        found = (ROOT / "assets" / "scenes" / name).exists()
        yield Finding(f"scene {name}", found, "there" if found else "missing", RESTORE)


def check_models() -> Iterator[Finding]:
    """Every part's taught vision model loads."""
    kernel_cache.require()
    from benchmark.world.parts import PART_NAMES
    from vision.model.model_file import load_model

    for name in PART_NAMES:
        path = ROOT / "assets" / "models" / f"{name}.json"
        remedy = RESTORE
        if not path.exists():
            yield Finding(f"vision model {name}", False, f"no {path.name}", remedy)
            continue
        try:
            load_model(path)
        except FocalpickError as error:
            yield Finding(f"vision model {name}", False, str(error), remedy)
        else:
            yield Finding(f"vision model {name}", True, "loads")


def check_disk() -> Iterator[Finding]:
    """Results can be written where sweeps put them by default."""
    directory = Path("results") if Path("results").is_dir() else Path()
    free_mb = shutil.disk_usage(directory).free // 2**20
    writable = os.access(directory, os.W_OK)
    text = f"{directory.absolute()} is {'writable' if writable else 'not writable'}, {free_mb} MB free"
    remedy = f"Make {LEAST_FREE_MB} MB room, or work in a directory that you may write to"
    yield Finding("disk", writable and free_mb >= LEAST_FREE_MB, text, remedy)


CHECKS: dict[str, Callable[[], Iterator[Finding]]] = {
    "python": check_python,
    "libraries": check_versions,
    "pinned versions": check_pins,
    "OpenGL": check_gl,
    "compiled kernels": check_kernels,
    "parts": check_assets,
    "vision models": check_models,
    "disk": check_disk,
}


def _parse(requirement: str) -> tuple[str, list[tuple[str, str]]]:
    """``"mujoco<4,>=3.17"`` as its name and its bounds."""
    name = re.split(r"[^A-Za-z0-9._-]", requirement, maxsplit=1)[0]
    return name, re.findall(r"(>=|<=|==|<|>)\s*([0-9][0-9.]*)", requirement.partition(";")[0])


def _holds(installed: str, operator: str, bound: str) -> bool:
    have, want = ([int(n) for n in re.findall(r"\d+", text)] for text in (installed, bound))
    length = max(len(have), len(want))
    a, b = (numbers + [0] * (length - len(numbers)) for numbers in (have, want))
    return {">=": a >= b, "<=": a <= b, "==": a == b, "<": a < b, ">": a > b}[operator]
