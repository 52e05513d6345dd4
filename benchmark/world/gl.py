"""Choose how MuJoCo gets its OpenGL context: a display if there is one, otherwise EGL, otherwise OSMesa."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from collections.abc import Mapping

from vision.errors import ResourceError

APT_PACKAGES = ("libegl1", "libegl-mesa0", "libgl1", "libgl1-mesa-dri", "libosmesa6")
INSTALL = f"run: sudo apt-get install -y {' '.join(APT_PACKAGES)}"
BACKENDS = ("glfw", "egl", "osmesa")
"""Those that MuJoCo and dm_control both know."""
_VARIABLE = "MUJOCO_GL"
_LEFTOVERS = ("PYOPENGL_PLATFORM", "MUJOCO_EGL_DEVICE_ID")
_PROBE = """
import mujoco
context = mujoco.GLContext(16, 16)
context.make_current()
model = mujoco.MjModel.from_xml_string("<mujoco/>")
mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
"""


def choose_backend() -> str:
    """Settle ``MUJOCO_GL`` for this process and its children, and return it.

    A backend that the user has chosen is left alone. Otherwise each candidate is tried in a process of its own,
    because a failing OpenGL library can take the whole process with it; the answer is kept in the environment, so
    child processes do not probe again. MuJoCo reads the variable when it is imported; where that has already
    happened its context module is loaded anew.

    Returns:
        The name of the backend: ``glfw``, ``egl`` or ``osmesa``.

    Raises:
        ResourceError: the user has chosen what is no backend, or no candidate can draw; the message has the remedy.
    """
    if chosen := _chosen():
        os.environ[_VARIABLE] = chosen  # MuJoCo passes over capitals, not everything that reads the variable does
        return chosen
    for backend in candidates(os.environ):
        if works(backend):
            os.environ[_VARIABLE] = backend
            if context_module := sys.modules.get("mujoco.rendering.classic.gl_context"):
                importlib.reload(context_module)
            return backend
    _blame_a_leftover()
    raise ResourceError(
        f"OpenGL: got no working backend of {', '.join(candidates(os.environ))}; expected one to draw with; {INSTALL}"
    )


def require_backend() -> str:
    """The backend of :func:`choose_backend`, tried even where the user has set it.

    Raises:
        ResourceError: there is no such backend, or it cannot draw; the message has the remedy.
    """
    chosen = _chosen()
    if chosen and not works(chosen):
        _blame_a_leftover(chosen)
        raise ResourceError(
            f"OpenGL: {_VARIABLE}={chosen} does not work here; unset it to let focalpick choose, or {INSTALL}"
        )
    return choose_backend()


def _chosen() -> str:
    """The backend that the user has chosen, or "".

    Raises:
        ResourceError: there is no such backend.
    """
    asked = os.environ.get(_VARIABLE, "")
    chosen = asked.strip().lower()
    if chosen and chosen not in BACKENDS:
        raise ResourceError(
            f"OpenGL: {_VARIABLE}: got {asked}; expected {', '.join(BACKENDS)}; unset it to let focalpick choose"
        )
    return chosen


def _blame_a_leftover(*backends: str) -> None:
    """Name a variable, left over from other software, without which one of these backends, or any, would work.

    Raises:
        ResourceError: there is one.
    """
    for name in (name for name in _LEFTOVERS if name in os.environ):
        without = {key: value for key, value in os.environ.items() if key != name}
        if any(works(backend, environment=without) for backend in backends or candidates(without)):
            raise ResourceError(f"OpenGL: {name}={os.environ[name]} keeps it from working. Run: unset {name}")


def candidates(environment: Mapping[str, str]) -> tuple[str, ...]:
    """The backends worth trying in this environment, best first."""
    if sys.platform != "linux":
        return ("glfw",)
    has_display = bool(environment.get("DISPLAY") or environment.get("WAYLAND_DISPLAY"))
    return ("glfw", "egl", "osmesa") if has_display else ("egl", "osmesa")


def works(backend: str, timeout_s: float = 60.0, environment: Mapping[str, str] | None = None) -> bool:
    """Whether MuJoCo can make an OpenGL context with this backend, tried in a process of its own."""
    environment = {**(os.environ if environment is None else environment), _VARIABLE: backend}
    try:
        probe = subprocess.run(
            [sys.executable, "-c", _PROBE], env=environment, capture_output=True, timeout=timeout_s, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return probe.returncode == 0


def drawn_by() -> dict[str, str]:
    """What draws in the current OpenGL context: its vendor, renderer and version, by their names in a record.

    Mesa's software renderer says for how wide vectors it compiles: ``llvmpipe (LLVM 15.0.6, 256 bits)``. Empty texts
    without a context.
    """
    from OpenGL import GL  # needs the platform that MuJoCo's context has settled

    names = {"gl_vendor": GL.GL_VENDOR, "gl_renderer": GL.GL_RENDERER, "gl_version": GL.GL_VERSION}
    texts = {key: GL.glGetString(name) for key, name in names.items()}
    return {key: text.decode() if isinstance(text, bytes) else "" for key, text in texts.items()}


def main() -> int:
    """Print the backend that works here; 1 and the remedy where none does."""
    try:
        print(require_backend())
    except ResourceError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
