"""The choice of an OpenGL backend."""

from __future__ import annotations

import sys

import pytest

from benchmark.world import gl
from vision.errors import ResourceError


def test_a_display_comes_first_and_software_follows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gl.sys, "platform", "linux")
    assert gl.candidates({"DISPLAY": ":0"}) == ("glfw", "egl", "osmesa")
    assert gl.candidates({"WAYLAND_DISPLAY": "wayland-0"})[0] == "glfw"
    assert gl.candidates({"DISPLAY": ""}) == ("egl", "osmesa")


def test_the_users_choice_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(gl, "works", lambda _: pytest.fail("probed although the user has chosen"))
    assert gl.choose_backend() == "osmesa"


def test_the_first_that_works_is_kept_for_child_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "")
    monkeypatch.setattr(gl, "candidates", lambda _: ("broken", "egl"))
    monkeypatch.setattr(gl, "works", lambda backend: backend == "egl")
    # Where the tests draw with another backend, MuJoCo's module must not be loaded anew for this one.
    monkeypatch.delitem(sys.modules, "mujoco.rendering.classic.gl_context", raising=False)
    assert gl.choose_backend() == "egl"
    assert gl.os.environ["MUJOCO_GL"] == "egl"


def test_without_any_the_message_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "")
    monkeypatch.setattr(gl, "works", lambda *_, **__: False)
    with pytest.raises(ResourceError, match=r"apt-get install .*libegl1 .*libosmesa6"):
        gl.choose_backend()


def test_a_backend_that_mujoco_does_not_know_does_not_work() -> None:
    assert not gl.works("crayons")


def test_capitals_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "EGL")
    assert gl.choose_backend() == "egl"
    assert gl.os.environ["MUJOCO_GL"] == "egl"


@pytest.mark.parametrize("asked", ["vulkan", "crayons", "disable", "E GL"])
def test_a_backend_that_there_is_not_is_refused_before_anything_is_tried(
    asked: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", asked)
    monkeypatch.setattr(gl, "works", lambda *_, **__: pytest.fail("probed although there is no such backend"))
    for settle in (gl.choose_backend, gl.require_backend):
        with pytest.raises(ResourceError, match=f"MUJOCO_GL: got {asked}; expected glfw, egl, osmesa; unset it"):
            settle()


def test_a_chosen_backend_that_does_not_work_is_told_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(gl, "works", lambda *_, **__: False)
    with pytest.raises(ResourceError, match=r"MUJOCO_GL=glfw does not work here; unset it .* apt-get install"):
        gl.require_backend()


@pytest.mark.parametrize("asked", ["", "egl"])
def test_a_leftover_variable_is_named(asked: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def works_without_leftover(backend, environment=gl.os.environ):
        return "MUJOCO_EGL_DEVICE_ID" not in environment

    monkeypatch.setenv("MUJOCO_GL", asked)
    monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", "3")
    monkeypatch.setattr(gl, "works", works_without_leftover)
    with pytest.raises(ResourceError, match="unset MUJOCO_EGL_DEVICE_ID"):
        gl.require_backend()
