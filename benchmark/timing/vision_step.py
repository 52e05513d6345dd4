"""How long the vision step takes on one core, stage by stage: ``python -m benchmark.timing.vision_step``.

The pictures are those of episodes with seeds of their own. What is timed is ``localize`` of the focal localizer,
without the two runs of single extractors that the benchmark adds for comparison. ``--photographs DIR`` times the
ellipse detector on the pictures of a directory, too.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmark.commands.common import prepare_process, results_console
from benchmark.config import EpisodeConfig, episode_seed
from benchmark.episodes.cells import workspace
from benchmark.episodes.episode import EpisodeObserver, run_episode
from benchmark.models import load_model
from benchmark.records.environment import environment_stamp
from benchmark.records.episode_record import SCHEMA, parse_object
from benchmark.report.grid import Grid, grids_as_markdown, part_title, print_grids
from benchmark.report.published import PARTS
from benchmark.seeds import SCENES
from benchmark.strict_json import decode
from benchmark.timing.detector_stages import detector_grid, measure_detector
from benchmark.timing.stage_clock import Place, StageClock
from benchmark.world.cell import WorkCell
from vision import extraction, localizer
from vision.errors import FocalpickError
from vision.geometry.camera import View
from vision.geometry.workspace import Workspace

TARGET_MS = 60.0
"""The whole vision step, for each 640x480 view."""

STAGES: dict[str, tuple[Place, ...]] = {
    "undistort": ((View, "undistorted"),),
    "region growing": ((extraction, "segment"), (extraction, "region_ellipses")),
    "edge grouping": ((extraction, "group_edges"),),
    "arcs": ((localizer, "arcs_of"),),
    "edge fields": ((localizer.EdgeField, "from_gray"),),
    "matching": ((localizer.Matcher, "__init__"), (localizer.Matcher, "match")),
}
TOTAL = "localize"
SEED = SCENES["timing"].start
Times = dict[str, list[float]]


@dataclass(frozen=True, eq=False)
class Scene:
    """What a localizer is given.

    Attributes:
        part: name of the pieces' type.
        views: the pictures.
        workspace: where pieces can lie.
    """

    part: str
    views: tuple[View, ...]
    workspace: Workspace


class _Photographer(EpisodeObserver):
    """Keeps an episode's pictures."""

    def __init__(self) -> None:
        self.views: list[View] = []
        self.workspace: Workspace | None = None

    def begin(self, cell: WorkCell, config: EpisodeConfig) -> None:  # noqa: ARG002
        self.workspace = workspace(cell.config)

    def looked(self, index: int, view: View) -> None:  # noqa: ARG002
        self.views.append(view)


def photograph(part: str, scene: int, views: int = 3) -> Scene:
    """Drop and photograph a scene as an episode does, with the sensor ``lab``.

    Args:
        part: name of the part.
        scene: number of the scene, which determines it.
        views: number of viewpoints.
    """
    seed = episode_seed(SEED, part, scene)
    config = EpisodeConfig((part,), scene=scene, seed=seed, localizer="oracle", views=views, task="none")
    photographer = _Photographer()
    # The oracle looks at no picture; the observer costs the physics some time, but nothing is timed here.
    run_episode(config, photographer)
    if photographer.workspace is None:
        raise RuntimeError("an episode ended without having begun")
    return Scene(part, tuple(photographer.views), photographer.workspace)


def time_scene(scene: Scene) -> dict[str, float]:
    """Seconds per view of ``localize`` and of the stages within it."""
    focal = localizer.EllipseLocalizer([load_model(scene.part)])
    with StageClock(STAGES) as clock:
        start = time.perf_counter()
        focal.localize(scene.views, scene.workspace)
        total = time.perf_counter() - start
    times = {stage: clock.seconds(stage) for stage in STAGES} | {TOTAL: total}
    return {stage: seconds / len(scene.views) for stage, seconds in times.items()}


def measure(part: str, scenes: int, views: int) -> Times:
    """The times of several scenes of a part, after one that is not counted: it compiles and fills caches."""
    cv2.setNumThreads(1)
    time_scene(photograph(part, scenes, views))
    measured = [time_scene(photograph(part, number, views)) for number in range(scenes)]
    return {stage: [times[stage] for times in measured] for stage in (*STAGES, TOTAL)}


def timing_grid(times: Mapping[str, Mapping[str, Sequence[float]]], target_ms: float = TARGET_MS) -> Grid:
    """Median and 90th percentile over the scenes, in milliseconds per view, for every part and stage."""
    rows = []
    for part, by_stage in times.items():
        is_met = 1000 * np.median(by_stage[TOTAL]) <= target_ms
        cells = [_cell(by_stage[stage]) for stage in (*STAGES, TOTAL)]
        rows.append((part_title(part), *cells, f"{target_ms:.0f}, {'met' if is_met else 'missed'}"))
    return Grid(
        title="Vision step on one core, ms per 640x480 view: median (90th percentile) over scenes",
        columns=("Object", *STAGES, TOTAL, "target"),
        rows=tuple(rows),
        quiet=frozenset({"target"}),
        note="localize is timed as a whole; what the stages leave over is spent between them.",
    )


def _cell(seconds: Sequence[float]) -> str:
    median, high = 1000 * np.quantile(seconds, [0.5, 0.9])
    return f"{median:.1f} ({high:.1f})"


@dataclass(frozen=True)
class TimingRecord:
    """All times as a file keeps them, in seconds.

    Attributes:
        environment: ``benchmark.records.environment.environment_stamp``.
        vision: by part and stage, of every scene, for each view.
        detector: by stage, of every photograph; empty where none was timed.
    """

    environment: dict[str, str]
    vision: dict[str, dict[str, tuple[float, ...]]]
    detector: tuple[dict[str, float], ...]

    @classmethod
    def read(cls, path: Path) -> TimingRecord:
        """From what :meth:`write` has written.

        Raises:
            FileFormatError: it is corrupt.
        """
        return decode(cls, parse_object(path.read_text(encoding="utf-8"), str(path)), str(path))

    def write(self, path: Path) -> None:
        """As JSON."""
        path.write_text(f"{json.dumps({'schema': SCHEMA, **asdict(self)}, indent=1)}\n", encoding="utf-8")


def timing_grids(record: TimingRecord) -> list[Grid]:
    """The vision step by stages, and the detector where it was timed."""
    return [timing_grid(record.vision), *([detector_grid(record.detector)] if record.detector else [])]


def main() -> None:
    """Measure and print, from the command line."""
    parser = argparse.ArgumentParser(description="How long the vision step takes on one core, stage by stage.")
    parser.add_argument("--scenes", type=int, default=4, help="scenes of each part")
    parser.add_argument("--parts", default=",".join(PARTS), help="names, separated by commas")
    parser.add_argument("--views", type=int, default=3, choices=(2, 3), help="pictures of each scene")
    parser.add_argument("--photographs", type=Path, metavar="DIR", help="time the ellipse detector on these, too")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write all times into this file, too")
    parser.add_argument("--format", default="text", choices=("text", "md"), help="md for Markdown")
    arguments = parser.parse_args()
    prepare_process()
    try:
        record = _measured(arguments)
    except FocalpickError as error:
        raise SystemExit(str(error)) from None
    if arguments.out is not None:
        record.write(arguments.out)
    shown = timing_grids(record)
    if arguments.format == "md":
        print(grids_as_markdown(shown, ()), end="")
    else:
        print_grids(shown, (), results_console())


def _measured(arguments: argparse.Namespace) -> TimingRecord:
    # A new process, because numerical libraries settle how many threads they use when they are loaded.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        parts = arguments.parts.split(",")
        times = {part: pool.submit(measure, part, arguments.scenes, arguments.views).result() for part in parts}
        photographs = arguments.photographs
        detector = () if photographs is None else pool.submit(measure_detector, photographs).result()
    vision = {
        part: {stage: tuple(seconds) for stage, seconds in by_stage.items()} for part, by_stage in times.items()
    }
    return TimingRecord(environment_stamp({}), vision, tuple(detector))


if __name__ == "__main__":
    main()
