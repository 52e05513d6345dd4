"""Runs the episodes of a sweep, in this process or on several, and resumes where an earlier run stopped."""

from __future__ import annotations

import os
import traceback
import warnings
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from benchmark.child_process import ended_by_signals
from benchmark.config import EpisodeConfig, SweepConfig, episodes
from benchmark.localizers.errors import LocalizerError
from benchmark.records.episode_record import EpisodeRecord
from benchmark.records.store import RecordWriter, read_records
from vision.errors import FileFormatError, InputError, ResourceError

if TYPE_CHECKING:
    from distributed import Client, Future

RunEpisode = Callable[[EpisodeConfig], EpisodeRecord]
OnProgress = Callable[[int, int, EpisodeRecord | None], None]

SINGLE_THREADED = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS"), "1")
"""One thread for each process: the sweep itself fills the cores, and sums do not depend on the number of threads.
``LP_NUM_THREADS`` is that of Mesa's software renderer."""

_BEGIN_WORKER = """
from benchmark.child_process import begin_worker

begin_worker()
"""
"""Runs in every worker before its first episode."""

_STOPPING = (ResourceError, FileFormatError)
"""Errors of the machine and of files, which every further episode would meet too; they end the sweep."""


class SweepInterruptedError(KeyboardInterrupt):
    """The user stopped the sweep; what is recorded stays, and the same command goes on from there."""


def run_sweep(
    config: SweepConfig,
    out: Path,
    run_episode: RunEpisode | None = None,
    workers: int | None = None,
    on_progress: OnProgress | None = None,
    prepare: Callable[[], None] | None = None,
) -> list[EpisodeRecord]:
    """Run the episodes of a sweep that are not yet recorded.

    An episode that raises, or kills its worker again and again, is recorded with its ``error`` and the sweep goes
    on. What would befall every episode, a missing resource or a corrupt file, ends the sweep and is not recorded.

    Args:
        config: what to run.
        out: the sweep's directory, made where it does not exist.
        run_episode: a function that can be pickled; the real one by default.
        workers: overrides ``config.workers``; 1 runs in this process.
        on_progress: called with (done, total, record) at the start, with None, and after each episode.
        prepare: called once before any episode, when the directory has been found to be this sweep's own.

    Returns:
        All records of the sweep, old and new, sorted by key.

    Raises:
        InputError: ``out`` cannot be written or holds another sweep, or one that began with other files.
        ResourceError: the disk is full, or an episode missed something that the machine lacks.
        FileFormatError: a file is corrupt.
        SweepInterruptedError: Ctrl-C.
    """
    run_episode = run_episode or _real_run_episode()
    workers = workers or config.workers
    plan = episodes(config)
    with RecordWriter(out, config) as writer:
        recorded = read_records(out)
        remaining = _remaining(plan, recorded, out)
        _keep_inputs(writer, config, out, recorded)
        done = len(plan) - len(remaining)
        notify = on_progress or (lambda *_: None)
        if prepare is not None:
            prepare()
        notify(done, len(plan), None)
        run = _run_parallel if min(workers, len(remaining)) > 1 else _run_here
        try:
            with closing(run(remaining, run_episode, workers)) as records:
                for record in records:
                    writer.append(record)
                    done += 1
                    notify(done, len(plan), record)
        except KeyboardInterrupt:
            raise SweepInterruptedError(
                f"stopped; {done} of {len(plan)} episodes are recorded in {out}. The same command goes on from there"
            ) from None
    return read_records(out)


def failed_episode(config: EpisodeConfig, error: BaseException) -> EpisodeRecord:
    """The record of an episode that did not finish, with the kind, text and place of its error in one line."""
    text, place = " ".join(f"{type(error).__name__}: {error}".split()), ""
    frames = traceback.extract_tb(error.__traceback__)
    if frames and not isinstance(error, LocalizerError):  # which names a place of the user's by itself
        place = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return EpisodeRecord(
        key=config.key,
        parts=config.parts,
        scene=config.scene,
        seed=config.seed,
        config_hash=config.config_hash,
        error=text + place,
    )


def _real_run_episode() -> RunEpisode:
    from benchmark.episodes.episode import run_episode

    return run_episode


def _remaining(plan: list[EpisodeConfig], recorded: list[EpisodeRecord], out: Path) -> list[EpisodeConfig]:
    """The planned episodes without a record, or with one that says that they did not finish.

    Raises:
        InputError: a record is of an episode that is not planned.
    """
    planned = {config.key: config.config_hash for config in plan}
    for record in recorded:
        if planned.get(record.key) != record.config_hash:
            do = "Choose another --out; the directory was changed by hand or by another version."
            expected = "only episodes of this sweep"
            raise InputError(
                f"records in {out}", got=f"episode {record.key} of another one", expected=expected, do=do
            )
    done = {record.key for record in recorded if record.error is None}
    return [config for config in plan if config.key not in done]


def _keep_inputs(writer: RecordWriter, config: SweepConfig, out: Path, recorded: list[EpisodeRecord]) -> None:
    """Refuse to go on with a mesh, model or localizer that has changed: a table is of one part and one system.

    As long as nothing was finished or taught, nothing can be mixed: whoever mends a file may run the sweep again.
    """
    from benchmark.episodes.inputs import input_digests
    from benchmark.study.taught_models import MODELS

    begun = any(record.error is None for record in recorded) or (out / MODELS).exists()
    writer.keep_inputs(input_digests(config), begun)


def _attempt(config: EpisodeConfig, run_episode: RunEpisode) -> EpisodeRecord:
    try:
        return run_episode(config)
    except _STOPPING:
        raise
    except Exception as error:
        return failed_episode(config, error)


def _run_here(configs: list[EpisodeConfig], run_episode: RunEpisode, workers: int) -> Generator[EpisodeRecord]:  # noqa: ARG001
    for config in configs:
        yield _attempt(config, run_episode)


def _run_parallel(configs: list[EpisodeConfig], run_episode: RunEpisode, workers: int) -> Generator[EpisodeRecord]:
    """Records in the order in which they are finished; as many episodes in flight as there are workers.

    A worker that dies is replaced, and its episode run again, until the scheduler gives it up with KilledWorker.
    """
    from distributed import as_completed

    with _client(min(workers, len(configs))) as client:
        waiting = iter(configs)
        running: dict[str, EpisodeConfig] = {}

        def submit_next() -> list[Future]:
            config = next(waiting, None)
            if config is None:
                return []
            running[config.key] = config
            return [client.submit(_attempt, config, run_episode, key=config.key, pure=False)]

        futures = as_completed([f for _ in range(min(workers, len(configs))) for f in submit_next()])
        for future in futures:
            for successor in submit_next():
                futures.add(successor)
            yield _result(future, running.pop(future.key))
            future.release()


def _result(future: Future, config: EpisodeConfig) -> EpisodeRecord:
    error = future.exception()
    if error is None:
        return future.result()
    if isinstance(error, _STOPPING):
        raise error
    return failed_episode(config, error)


@contextmanager
def _without_port_warning() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"\s*Port \d+ is already in use", category=UserWarning)
        yield


@contextmanager
def _client(workers: int) -> Iterator[Client]:
    """A cluster of processes on this machine, without dashboard and without log lines on the terminal."""
    import dask
    from distributed import Client, LocalCluster

    environment = {name: os.environ.get(name, value) for name, value in SINGLE_THREADED.items()}
    # The status server that nobody looks at takes another port when two sweeps run side by side, and says so.
    settings = {
        "logging.distributed": "critical",
        "distributed.nanny.pre-spawn-environ": environment,
        "distributed.worker.preload": [_BEGIN_WORKER],
        "distributed.worker.memory.target": False,  # an episode cannot be spilled or paused half-way
        "distributed.worker.memory.spill": False,
        "distributed.worker.memory.pause": False,
        "distributed.worker.memory.terminate": False,
    }
    with (
        ended_by_signals(),
        _without_port_warning(),
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs="CRITICAL",
            memory_limit=0,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client
