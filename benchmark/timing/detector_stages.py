"""How long ``vision.detect_ellipses`` takes on photographs, stage by stage."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmark.report.grid import Grid
from benchmark.timing.stage_clock import Place, StageClock
from vision.edges.edge_map import as_gray
from vision.errors import InputError
from vision.files.picture import read_picture
from vision.grouping import detector
from vision.grouping import edge_grouping as grouping

TARGET_MS = 20.0
"""For a photograph of 640x480 pixels."""

TOTAL = "detect_ellipses"
HALF = "half-resolution look"
SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm", ".ppm")
STAGES: dict[str, tuple[Place, ...]] = {
    "edges": ((grouping, "detect_edges"),),
    "fragments": ((grouping, "extract_fragments"),),
    "hypotheses": ((grouping, "representatives"), (grouping, "_hypotheses")),
    "verification": (
        (grouping.EdgeArrays, "of"),
        (grouping, "verify_hypotheses"),
        (grouping, "select_survivors"),
        (grouping, "_filter_survivors"),
    ),
}
_LOOK: dict[str, tuple[Place, ...]] = {"look": ((detector, "group_edges"),)}

Times = dict[str, float]


def read_photographs(directory: Path) -> dict[str, NDArray[np.uint8]]:
    """All pictures of a directory by name, as grey levels.

    Raises:
        InputError: it holds none, or one that cannot be read.
    """
    paths = sorted(p for p in directory.glob("*") if p.suffix.lower() in SUFFIXES)
    if not paths:
        raise InputError(f"photographs {directory}", got="none", expected=f"pictures ({', '.join(SUFFIXES)})")
    pictures = {}
    for path in paths:
        pictures[path.name] = as_gray(read_picture(path))
    return pictures


def time_detector(gray: NDArray[np.uint8]) -> Times:
    """Seconds of one call, by the stages of its first look; the second, at half the resolution, is a stage itself."""
    with StageClock({**STAGES, **_LOOK}) as clock:
        start = time.perf_counter()
        detector.detect_ellipses(gray)
        total = time.perf_counter() - start
    looks = sorted((call for call in clock.calls if call.stage == "look"), key=lambda call: call.start_s)
    second = looks[1] if len(looks) > 1 else None
    before = float("inf") if second is None else second.start_s
    times = {stage: clock.seconds(stage, before) for stage in STAGES}
    return {**times, HALF: 0.0 if second is None else second.seconds, TOTAL: total}


def measure_detector(directory: Path, repeats: int = 3) -> list[Times]:
    """Of every photograph of a directory, the median of each stage's times over some repetitions."""
    cv2.setNumThreads(1)
    pictures = list(read_photographs(directory).values())
    time_detector(pictures[0])  # compiles, and is not counted
    measured = []
    for gray in pictures:
        runs = [time_detector(gray) for _ in range(repeats)]
        measured.append({stage: float(np.median([run[stage] for run in runs])) for stage in runs[0]})
    return measured


def detector_grid(measured: Sequence[Mapping[str, float]], target_ms: float = TARGET_MS) -> Grid:
    """Mean over the photographs and the worst of them, in milliseconds."""
    stages = (*STAGES, HALF, TOTAL)
    rows = []
    for label, of_all in (("mean", np.mean), ("worst", np.max)):
        values = [1000 * float(of_all([times[stage] for times in measured])) for stage in stages]
        verdict = f"{target_ms:.0f}, {'met' if values[-1] <= target_ms else 'missed'}"
        rows.append((label, *(f"{value:.1f}" for value in values), verdict))
    return Grid(
        title=f"Ellipse detector on one core, ms for each of {len(measured)} photographs",
        columns=("", *stages, "target"),
        rows=tuple(rows),
        quiet=frozenset({"target"}),
        note="The worst of each stage by itself. Of each photograph, the median of several runs.",
    )
