"""The progress bar of a sweep, and where its time went."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType

from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table

from benchmark.commands.common import make_console
from benchmark.records.episode_record import STAGES, EpisodeRecord
from benchmark.report.grid import NOTHING


class Pace:
    """Predicts the time that remains, from the episodes of this run.

    The first episode of each worker also pays for compiling and loading; as soon as there are others, the pace is
    taken from those alone. Before anything is finished there is no prediction.
    """

    def __init__(self, workers: int, now: float) -> None:
        """Start the clock at ``now`` seconds."""
        self._warm_up = workers
        self._finished = [now]

    def finish(self, now: float) -> None:
        """Note that an episode was finished at ``now`` seconds."""
        self._finished.append(now)

    def remaining_s(self, episodes: int) -> float | None:
        """Predicted time for as many more episodes, None where nothing is known."""
        if len(self._finished) == 1:
            return None
        start = self._warm_up if len(self._finished) - 1 >= 2 * self._warm_up else 0
        measured = self._finished[start:]
        return episodes * (measured[-1] - measured[0]) / (len(measured) - 1)


class SweepProgress:
    """A progress bar on standard error; on anything but a terminal, a line now and then.

    Use it as a context manager and hand it to ``run_sweep`` as ``on_progress``.
    """

    def __init__(self, workers: int, console: Console | None = None) -> None:
        """Prepare for so many workers."""
        self._console = console or make_console(stderr=True)
        self._pace = Pace(workers, time.monotonic())
        self._failed = 0
        self._last_line = -1
        self._bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TextColumn("{task.fields[eta]}"),
            console=self._console,
            disable=not self._console.is_terminal,
        )
        self._task = self._bar.add_task("episodes", total=None, eta="starting")

    def __enter__(self) -> SweepProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._bar.stop()

    def __call__(self, done: int, total: int, record: EpisodeRecord | None) -> None:
        """Show that ``done`` of ``total`` episodes are recorded."""
        if record is not None:
            self._pace.finish(time.monotonic())
            self._failed += record.error is not None
        eta = self._eta(total - done)
        self._bar.update(self._task, completed=done, total=total, eta=eta)
        if not self._console.is_terminal:
            self._print_line(done, total, eta)

    def tell(self, text: str) -> None:
        """Show a line of its own."""
        self._console.print(text, highlight=False)

    def taught(self, done: int, total: int) -> None:
        """Show that ``done`` of the ``total`` models that a study needs are taught, before its first episode."""
        self._bar.update(self._task, completed=done, total=total, eta="models being taught")
        if not self._console.is_terminal and done == total:
            self._console.print(f"{total} models are taught", highlight=False)

    def _eta(self, remaining: int) -> str:
        failed = f", {self._failed} failed" if self._failed else ""
        if remaining == 0:
            return f"done{failed}"
        seconds = self._pace.remaining_s(remaining)
        return ("first episodes running" if seconds is None else f"about {duration(seconds)} left") + failed

    def _print_line(self, done: int, total: int, eta: str) -> None:
        """A line at the start, at every tenth of the way, and at the end: logs should stay readable."""
        tenth = 10 * done // total
        if tenth != self._last_line:
            self._last_line = tenth
            self._console.print(f"{done}/{total} episodes, {eta}", highlight=False)


def duration(seconds: float) -> str:
    """Seconds as people say them: ``45 s``, ``12 min``, ``1 h 05 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"


def timing_table(records: Sequence[EpisodeRecord]) -> Table:
    """Mean wall time per finished episode by kind of scene, split into drop, render, vision and motion."""
    table = Table(
        title="Mean wall time per episode (s)", title_justify="left", title_style="bold", box=box.SIMPLE_HEAD
    )
    table.add_column("Scene")
    for heading in ("n", *STAGES):
        table.add_column(heading, justify="right")
    finished = [record for record in records if record.error is None]
    for kind in dict.fromkeys("+".join(record.parts) for record in finished):
        _add_timings(table, kind, [record for record in finished if "+".join(record.parts) == kind])
    table.add_section()
    _add_timings(table, "all", finished)
    return table


def _add_timings(table: Table, name: str, records: Sequence[EpisodeRecord]) -> None:
    cells = []
    for stage in STAGES:
        values = [record.timings_s[stage] for record in records if stage in record.timings_s]
        cells.append(f"{sum(values) / len(values):.2f}" if values else NOTHING)
    table.add_row(name, str(len(records)), *cells)
