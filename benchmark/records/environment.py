"""Where a record was made: versions and hardware, for whoever compares two of them."""

from __future__ import annotations

import functools
import platform
from importlib import metadata
from pathlib import Path

_DISTRIBUTIONS = {
    "focalpick": "focalpick",
    "mujoco": "mujoco",
    "numpy": "numpy",
    "opencv": "opencv-python-headless",
    "scipy": "scipy",
}


def environment_stamp(gl_renderer: str = "") -> dict[str, str]:
    """Versions, platform, CPU model and, if given, the GL renderer string of the context that drew the images."""
    return {**_machine(), "gl_renderer": gl_renderer}


@functools.cache
def _machine() -> dict[str, str]:
    versions = {name: version(distribution) for name, distribution in _DISTRIBUTIONS.items()}
    machine = {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu_model(),
    }
    return {**versions, **machine}


def version(distribution: str) -> str:
    """The installed version of a distribution, or ``not installed``."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor() or "unknown"
