from __future__ import annotations

import json
import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from benchmark.records.environment import cpu_model, cpu_stepping, environment_stamp, vector_features
from benchmark.records.episode_record import from_json
from benchmark.world import gl

ROOT = Path(__file__).resolve().parents[2]
EPYC = {
    "model name": "AMD EPYC",
    "cpu family": "25",
    "model": "1",
    "stepping": "1",
    "flags": "fpu smep sse4_2 avx2 fma avx bmi1",
}
GRAVITON = {"CPU implementer": "0x41", "CPU part": "0xd40", "Features": "fp asimd evtstrm sve aes"}


def stamp_in_another_process(**environment: str) -> dict[str, str]:
    """The stamp of a process that is told to play another machine; nothing is drawn there."""
    code = "import json, benchmark.records.environment as e; print(json.dumps(e.environment_stamp({})))"
    run = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | environment | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(json.loads(run.stdout))


def test_stamp_is_the_same_in_every_process() -> None:
    drawn_by = {"gl_renderer": "llvmpipe"}
    stamp = environment_stamp(drawn_by)
    assert stamp["gl_renderer"] == "llvmpipe"
    assert stamp["numpy"][0].isdigit()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(environment_stamp, (drawn_by,)) == stamp


def test_a_processor_that_numba_and_the_renderer_are_told_to_compile_for_shows() -> None:
    here = environment_stamp({})
    there = stamp_in_another_process(NUMBA_CPU_NAME="generic", MUJOCO_GL="osmesa")
    assert there["numba_cpu"] == "generic"
    assert there["mujoco_gl"] == "osmesa"
    assert {name for name in here if here[name] != there[name]} <= {"numba_cpu", "mujoco_gl"}


def test_what_makes_a_library_take_the_processor_for_another_shows() -> None:
    stamp = stamp_in_another_process(GALLIUM_OVERRIDE_CPU_CAPS="sse4.1", OPENCV_CPU_DISABLE="AVX2")
    assert "GALLIUM_OVERRIDE_CPU_CAPS=sse4.1 OPENCV_CPU_DISABLE=AVX2" in stamp["overrides"]


@pytest.mark.skipif("openblas" not in environment_stamp({})["blas"], reason="numpy came with another library")
@pytest.mark.skipif("avx2" not in environment_stamp({})["cpu_features"], reason="the kernels need AVX2")
def test_the_kernels_of_openblas_show() -> None:
    stamp = stamp_in_another_process(OPENBLAS_CORETYPE="Haswell", OPENBLAS_NUM_THREADS="2")
    assert stamp["blas"].endswith("kernels for Haswell, threads: 2")


def test_two_processors_of_one_name_differ() -> None:
    newer = EPYC | {"cpu family": "26", "flags": EPYC["flags"] + " avx512f"}
    assert cpu_model(EPYC) == cpu_model(newer) == "AMD EPYC"
    assert cpu_stepping(EPYC) == "family 25, model 1, stepping 1"
    assert cpu_stepping(newer) != cpu_stepping(EPYC)
    assert vector_features(EPYC) == "avx avx2 fma sse4_2"
    assert vector_features(newer) == "avx avx2 avx512f fma sse4_2"


def test_an_arm_processor_is_described_too() -> None:
    assert cpu_model(GRAVITON)
    assert cpu_stepping(GRAVITON) == "CPU implementer 0x41, CPU part 0xd40"
    assert vector_features(GRAVITON) == "asimd sve"


def test_nothing_is_said_where_the_system_says_nothing() -> None:
    assert cpu_model({})
    assert cpu_stepping({}) == vector_features({}) == ""


def test_what_draws_is_told_by_the_current_context() -> None:
    context = mujoco.GLContext(16, 16)
    context.make_current()
    try:
        drawn_by = gl.drawn_by()
    finally:
        context.free()
    assert list(drawn_by) == ["gl_vendor", "gl_renderer", "gl_version"]
    assert all(drawn_by.values())


def test_records_of_before_are_read() -> None:
    line = (ROOT / "results" / "table1" / "episodes.jsonl").read_text(encoding="utf-8").partition("\n")[0]
    assert from_json(line).environment["cpu"]
