"""Runs the episodes of a sweep, in this process or on several, and resumes where an earlier run stopped."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from pathlib import Path

from benchmark.child_process import ended_by_signals
from benchmark.config import EpisodeConfig, SweepConfig, episodes
from benchmark.episodes import compiling
from benchmark.episodes.failures import RunEpisode, attempt, unfinished
from benchmark.episodes.pool import Lost, Pool
from benchmark.records.episode_record import EpisodeRecord
from benchmark.records.store import RecordWriter, read_records
from vision import kernel_cache
from vision.errors import InputError

OnProgress = Callable[[int, int, EpisodeRecord | None], None]


class SweepInterruptedError(KeyboardInterrupt):
    """The user stopped the sweep; what is recorded stays, and the same command goes on from there."""


def run_sweep(
    config: SweepConfig,
    out: Path,
    run_episode: RunEpisode | None = None,
    workers: int | None = None,
    on_progress: OnProgress | None = None,
    prepare: Callable[[], None] | None = None,
    episode_limit_s: float | None = None,
    tell: Callable[[str], None] | None = None,
) -> list[EpisodeRecord]:
    """Run the episodes of a sweep that are not yet recorded.

    An episode that raises, runs too long, or costs several workers their lives is recorded with its ``error`` and the
    sweep goes on. What would befall every episode, a missing resource or a corrupt file, ends the sweep and is not
    recorded.

    Args:
        config: what to run.
        out: the sweep's directory, made where it does not exist.
        run_episode: a function that can be pickled; the real one by default.
        workers: overrides ``config.workers``; 1 without a time limit runs in this process.
        on_progress: called with (done, total, record) at the start, with None, and after each episode.
        prepare: called once before any episode, when the directory has been found to be this sweep's own.
        episode_limit_s: how long an episode may run, in seconds; None: for ever.
        tell: is told in words when kernels are compiled before several processes start; without it each compiles
            what it needs.

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
        try:
            with closing(_run(remaining, run_episode, workers, episode_limit_s, tell)) as records:
                for record in records:
                    writer.append(record)
                    done += 1
                    notify(done, len(plan), record)
        except KeyboardInterrupt:
            raise SweepInterruptedError(
                f"stopped; {done} of {len(plan)} episodes are recorded in {out}. The same command goes on from there"
            ) from None
    return read_records(out)


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


def _run(
    configs: list[EpisodeConfig],
    run_episode: RunEpisode,
    workers: int,
    limit_s: float | None,
    tell: Callable[[str], None] | None,
) -> Generator[EpisodeRecord]:
    """Records in the order in which they are finished; as many episodes in flight as there are workers."""
    if limit_s is None and min(workers, len(configs)) <= 1:  # nothing could end an episode of this process
        yield from _compiled_first(configs, lambda some, _: (attempt(config, run_episode) for config in some), tell)
        return
    function = functools.partial(attempt, run_episode=run_episode)
    with ended_by_signals(), Pool(function, workers, limit_s) as pool:

        def run(some: list[EpisodeConfig], grace_s: float) -> Iterator[EpisodeRecord]:
            for config, result in pool.run(some, grace_s):
                yield unfinished(config, result.reason) if isinstance(result, Lost) else result

        yield from _compiled_first(configs, run, tell)


def _compiled_first(
    configs: list[EpisodeConfig],
    run: Callable[[list[EpisodeConfig], float], Iterator[EpisodeRecord]],
    tell: Callable[[str], None] | None,
) -> Iterator[EpisodeRecord]:
    """The first episode alone where there are kernels to compile, and the others side by side."""
    if tell is not None and configs and not compiling.is_done(localizers := _localizers(configs[0])):
        with compiling.alone(lambda: tell("another process is compiling the vision kernels; waiting for it")):
            if not compiling.is_done(localizers):
                kept = "" if kernel_cache.is_kept() else f"; {kernel_cache.ANEW}"
                tell(f"the first episode compiles the vision kernels, which may take minutes{kept}")
                begin = time.monotonic()
                for record in run(configs[:1], compiling.LIMIT_S):
                    if record.error is None:
                        compiling.note_done(localizers)
                        tell(f"the kernels are compiled; the first episode took {time.monotonic() - begin:.0f} s")
                    yield record
                configs = configs[1:]
    yield from run(configs, 0.0)


def _localizers(config: EpisodeConfig) -> str:
    """The localizers at work in an episode, which need one kernel or another."""
    return ",".join([config.localizer, *config.compared])
