"""Where a record was made: what decides its last bits, for whoever compares two of them.

Two records of one seed are equal to the last bit where their stamps are equal. Software OpenGL, Numba, OpenBLAS,
numpy and the C library compile or choose code for the processor that they find, and fuse or order additions
differently on another. The stamp says which processor that was and what each of them made of it. It leaves out what
changes nothing, such as the kernel of the operating system and the number of workers.
"""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import re
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path

import llvmlite.binding
import numba
import numpy as np

_DISTRIBUTIONS = {
    "focalpick": "focalpick",
    "mujoco": "mujoco",
    "numpy": "numpy",
    "opencv": "opencv-python-headless",
    "scipy": "scipy",
    "numba": "numba",
    "llvmlite": "llvmlite",
}
_VECTOR_FEATURE = re.compile(r"(avx|sse|ssse|fma|f16c|amx|neon|asimd|sve|sme(?!p)|altivec|vsx|rvv)")
_OVERRIDES = ("GALLIUM_OVERRIDE_CPU_CAPS", "OPENCV_CPU_DISABLE", "OPENCV_IPP", "OPENBLAS_L2_SIZE")
"""Variables by which a library takes the processor for another one without telling so in what it says of itself."""
_OPENBLAS_NAMES = ("scipy_openblas_get_{}64_", "scipy_openblas_get_{}", "openblas_get_{}")


def environment_stamp(drawn_by: Mapping[str, str]) -> dict[str, str]:
    """Versions, platform, processor and what the libraries made of it.

    Args:
        drawn_by: ``benchmark.world.gl.drawn_by()`` of the context that drew the images; empty where none did.
    """
    return {**_machine(), "mujoco_gl": os.environ.get("MUJOCO_GL", ""), **drawn_by}


@functools.cache
def _machine() -> dict[str, str]:
    versions = {name: version(distribution) for name, distribution in _DISTRIBUTIONS.items()}
    first_core = _cpuinfo()
    machine = {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "libc": " ".join(platform.libc_ver()).strip(),
        "cpu": cpu_model(first_core),
        "cpu_stepping": cpu_stepping(first_core),
        "cpu_features": vector_features(first_core),
        "numpy_simd": " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])),
        "blas": _blas(),
        "numba_cpu": _numba_cpu(),
        "overrides": " ".join(f"{name}={os.environ[name]}" for name in _OVERRIDES if name in os.environ),
    }
    return {**versions, **machine}


def version(distribution: str) -> str:
    """The installed version of a distribution, or ``not installed``."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def cpu_model(core: Mapping[str, str]) -> str:
    """The name that the processor gives itself, from what ``/proc/cpuinfo`` says of a core."""
    return core.get("model name") or core.get("cpu") or platform.processor() or platform.machine() or "unknown"


def cpu_stepping(core: Mapping[str, str]) -> str:
    """What tells apart processors of one name, such as those that a cloud calls "AMD EPYC"; empty where not said."""
    names = ("cpu family", "model", "stepping", "CPU implementer", "CPU part", "CPU variant", "CPU revision")
    return ", ".join(f"{name.removeprefix('cpu ')} {core[name]}" for name in names if name in core)


def vector_features(core: Mapping[str, str]) -> str:
    """The vector instructions among a core's features, sorted, such as ``avx avx2 fma``; empty where not said."""
    features = core.get("flags") or core.get("Features") or ""
    return " ".join(sorted(name for name in features.split() if _VECTOR_FEATURE.match(name)))


def _cpuinfo() -> dict[str, str]:
    """What Linux says of the first core; empty elsewhere."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return {}
    lines = (line.partition(":") for line in text.partition("\n\n")[0].splitlines())
    return {name.strip(): value.strip() for name, _, value in lines}


def _numba_cpu() -> str:
    """The processor for which Numba compiles: this one, unless ``NUMBA_CPU_NAME`` says otherwise."""
    name = numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    return " ".join(filter(None, (name, numba.config.CPU_FEATURES)))


def _blas() -> str:
    """What multiplies numpy's matrices, such as ``scipy-openblas 0.3.31, kernels for Haswell, threads: 1``.

    What it was built for numpy tells itself; what it chose here only the OpenBLAS in numpy's wheel can be asked.
    """
    built = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    package = Path(np.__file__).parent
    for path in sorted([*package.parent.glob("numpy.libs/*openblas*"), *package.glob(".dylibs/*openblas*")]):
        library = ctypes.CDLL(str(path))  # the one that numpy has loaded, not a second one
        core, threads = _ask(library, "corename", ctypes.c_char_p), _ask(library, "num_threads", ctypes.c_int)
        if isinstance(core, bytes):
            return f"{built['name']} {built['version']}, kernels for {core.decode()}, threads: {threads}"
    return f"{built['name']} {built['version']}"


def _ask(library: ctypes.CDLL, what: str, kind: type[ctypes.c_char_p | ctypes.c_int]) -> object:
    """The answer of OpenBLAS's function ``openblas_get_WHAT``, which wheels rename; None where it is not there."""
    for name in _OPENBLAS_NAMES:
        if function := getattr(library, name.format(what), None):
            function.restype = kind
            return function()
    return None
