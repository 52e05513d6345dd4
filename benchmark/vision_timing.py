"""How long the vision step takes on one core, stage by stage: ``python -m benchmark.vision_timing``.

The pictures are those of episodes with seeds of their own. What is timed is what the dual localizer does with them,
without the two runs of single extractors that the benchmark adds for comparison.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from rich import box
from rich.table import Table

from benchmark.commands.common import prepare_process, results_console
from benchmark.config import EpisodeConfig, episode_seed
from benchmark.episode import EpisodeObserver, run_episode, workspace
from benchmark.localizers import load_model
from benchmark.report.grid import part_title
from benchmark.report.published import PARTS
from benchmark.world.cell import WorkCell
from vision.camera import View
from vision.candidates import Workspace
from vision.evidence import EdgeField
from vision.localizer import EllipseLocalizer
from vision.matching import Matcher

TARGET_MS = 60.0
"""The whole vision step, for each 640x480 view."""

STAGES = ("undistort", "region extraction", "edge grouping", "edge field", "matching")
TOTAL = "total"
SEED = 60_000
T = TypeVar("T")
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


def time_scene(scene: Scene) -> Times:
    """Seconds per view of every stage; matching and the total are shared out evenly among the views."""
    model = load_model(scene.part)
    region, group, dual = (EllipseLocalizer([model], p) for p in (("region",), ("group",), ("region", "group")))
    times: Times = {stage: [] for stage in (*STAGES, TOTAL)}

    def timed(stage: str, action: Callable[[], T], views: int = 1) -> T:
        start = time.perf_counter()
        result = action()
        times[stage].append((time.perf_counter() - start) / views)
        return result

    flat, features, arcs, fields = [], [], [], []
    for view in scene.views:
        flat.append(timed("undistort", view.undistorted))
        found = timed("region extraction", lambda: region.extract(flat[-1], scene.workspace))
        found = found + timed("edge grouping", lambda: group.extract(flat[-1], scene.workspace))
        features.append(found)
        # Edge grouping has them already; the localizer asks once for both.
        arcs.append(dual.features_and_arcs(flat[-1], scene.workspace)[1])
        fields.append(timed("edge field", lambda: EdgeField.from_gray(flat[-1].gray)))
    parameters = replace(dual.parameters, joint_edges=True)
    matcher = Matcher(flat, fields, model, scene.workspace, parameters)
    timed("matching", lambda: matcher.match(features, arcs), len(scene.views))
    times[TOTAL] = [sum(sum(times[s]) for s in STAGES[:-1]) / len(scene.views) + times["matching"][0]]
    return times


def measure(part: str, scenes: int, views: int) -> Times:
    """The times of several scenes of a part, after one that is not counted: it compiles and fills caches."""
    cv2.setNumThreads(1)
    time_scene(photograph(part, scenes, views))
    measured = [time_scene(photograph(part, number, views)) for number in range(scenes)]
    return {stage: [seconds for times in measured for seconds in times[stage]] for stage in (*STAGES, TOTAL)}


def timing_table(times: dict[str, Times], target_ms: float = TARGET_MS) -> Table:
    """Median and 90th percentile in milliseconds per view, for every part and stage."""
    title = "Vision step on one core, ms per 640x480 view: median (90th percentile)"
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("Object", no_wrap=True)
    for stage in (*STAGES, TOTAL):
        table.add_column(stage, justify="right", no_wrap=True)
    table.add_column("target", justify="right", style="dim")
    for part, by_stage in times.items():
        cells = [_cell(by_stage[stage]) for stage in (*STAGES, TOTAL)]
        is_met = 1000 * np.median(by_stage[TOTAL]) <= target_ms
        table.add_row(part_title(part), *cells, f"{target_ms:.0f}, {'met' if is_met else 'missed'}")
    return table


def _cell(seconds: Sequence[float]) -> str:
    median, high = 1000 * np.quantile(seconds, [0.5, 0.9])
    return f"{median:.1f} ({high:.1f})"


def main() -> None:
    """Measure and print, from the command line."""
    parser = argparse.ArgumentParser(description="How long the vision step takes on one core, stage by stage.")
    parser.add_argument("--scenes", type=int, default=4, help="scenes of each part")
    parser.add_argument("--parts", default=",".join(PARTS), help="names, separated by commas")
    parser.add_argument("--views", type=int, default=3, choices=(2, 3), help="pictures of each scene")
    arguments = parser.parse_args()
    prepare_process()
    # A new process, because numerical libraries settle how many threads they use when they are loaded.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        parts = arguments.parts.split(",")
        times = {part: pool.submit(measure, part, arguments.scenes, arguments.views).result() for part in parts}
    results_console().print(timing_table(times))


if __name__ == "__main__":
    main()
