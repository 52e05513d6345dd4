from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmark.config import EpisodeConfig, SweepConfig, episodes, preset
from benchmark.episodes.sweep import SweepInterruptedError, run_sweep
from benchmark.records.episode_record import (
    EpisodeRecord,
    LocalizerResult,
    PickRecord,
    PieceRecord,
    PoseErrors,
)
from benchmark.records.store import EPISODES_FILE, read_records
from benchmark.report.tables import build_table, to_dict
from vision.errors import InputError, ResourceError

CONFIG = SweepConfig(parts=("hub", "cover1"), scenes=3, seed=5)


def fake_episode(config: EpisodeConfig) -> EpisodeRecord:
    rng = np.random.default_rng(config.seed)
    pieces = []
    for index in range(config.pieces):
        results = {}
        for name in ("focal-region", "focal-group", "focal"):
            matched = bool(rng.random() < 0.8)
            errors = PoseErrors(*rng.random(2), None, *rng.random(2)) if matched else None
            results[name] = LocalizerResult(matched or bool(rng.random() < 0.5), matched, errors)
        pieces.append(PieceRecord(index, config.parts[0], float(rng.random()), True, results))
    return EpisodeRecord(
        key=config.key,
        parts=config.parts,
        scene=config.scene,
        seed=config.seed,
        config_hash=config.config_hash,
        pieces=tuple(pieces),
        picks=(PickRecord(True, 0, bool(rng.random() < 0.7)),),
        false_positives={"focal": 1},
        timings_s={"total": time.perf_counter()},
    )


def failing_episode(config: EpisodeConfig) -> EpisodeRecord:
    if config.scene == 1:
        raise ZeroDivisionError("over\nthere")
    return fake_episode(config)


def killing_episode(config: EpisodeConfig) -> EpisodeRecord:
    if config.key == "hub/001":
        os._exit(1)
    return fake_episode(config)


def missing_gl_episode(config: EpisodeConfig) -> EpisodeRecord:
    if config.scene == 1:
        raise ResourceError("OpenGL: none")
    return fake_episode(config)


def comparable(records: list[EpisodeRecord]) -> list[EpisodeRecord]:
    return [replace(record, timings_s={}) for record in records]


def test_episode_seeds_depend_on_what_identifies_an_episode_and_on_nothing_else() -> None:
    both = {e.key: e for e in episodes(SweepConfig(parts=("hub", "cover1"), scenes=4))}
    alone = {e.key: e for e in episodes(SweepConfig(parts=("cover1",), scenes=9, workers=3))}
    assert all(both[key] == alone[key] for key in both.keys() & alone.keys())
    assert len({e.seed for e in both.values()}) == len(both) == 8
    assert episodes(SweepConfig(parts=("hub",), seed=1))[0].seed != both["hub/000"].seed


def test_order_is_round_robin_over_parts() -> None:
    assert [e.key for e in episodes(CONFIG)][:4] == ["hub/000", "cover1/000", "hub/001", "cover1/001"]


def test_config_hash_covers_everything_but_workers() -> None:
    assert replace(CONFIG, workers=7).config_hash == CONFIG.config_hash
    changes = {
        "parts": ("hub",),
        "scenes": 4,
        "pieces": 5,
        "sensor": "ideal",
        "localizer": "focal-region",
        "views": 2,
    }
    changes |= {"seed": 6, "task": "none"}
    hashes = {replace(CONFIG, **{name: value}).config_hash for name, value in changes.items()}
    assert len(hashes | {CONFIG.config_hash}) == len(changes) + 1


def test_config_hash_is_the_same_on_every_machine() -> None:
    assert SweepConfig(parts=("hub",)).config_hash.startswith("5092883052a04657")


def test_preset_keeps_what_is_not_changed() -> None:
    config = preset("table1", scenes=2, sensor=None)
    assert (config.scenes, config.pieces, config.sensor, config.views) == (2, 4, "lab", 3)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("parts", ()),
        ("parts", ("hub", "hub")),
        ("parts", ("hub+",)),
        ("scenes", 0),
        ("pieces", 0),
        ("pieces", 2.5),
        ("sensor", "moon"),
        ("localizer", "two words"),
        ("views", 4),
        ("task", "dance"),
        ("workers", 0),
        ("seed", -1),
    ],
)
def test_configuration_without_sense_is_refused(field: str, value: object) -> None:
    with pytest.raises(InputError, match="expected"):
        replace(CONFIG, **{field: value})


def test_parallel_equals_serial(tmp_path: Path) -> None:
    serial = run_sweep(CONFIG, tmp_path / "serial", fake_episode, workers=1)
    parallel = run_sweep(CONFIG, tmp_path / "parallel", fake_episode, workers=2)
    assert comparable(serial) == comparable(parallel)
    assert len(serial) == 6
    assert not any(record.error for record in serial)


def test_a_failing_episode_is_recorded_and_the_others_run(tmp_path: Path) -> None:
    records = run_sweep(CONFIG, tmp_path, failing_episode, workers=1)
    failed = {record.key: record.error for record in records if record.error}
    assert failed.keys() == {"hub/001", "cover1/001"}
    assert failed["hub/001"].startswith("ZeroDivisionError: over there (test_sweep.py:")


def test_failed_episodes_run_again_once_the_cause_is_mended(tmp_path: Path) -> None:
    sweep = SweepConfig(parts=("hub",), scenes=3, workers=1)
    broken = run_sweep(sweep, tmp_path, failing_episode)
    assert [record.error is None for record in broken] == [True, False, True]
    mended = run_sweep(sweep, tmp_path, fake_episode)
    assert comparable(mended) == comparable(run_sweep(sweep, tmp_path / "undisturbed", fake_episode))


@pytest.mark.slow
def test_an_episode_that_kills_its_workers_is_recorded_and_the_others_run(tmp_path: Path) -> None:
    records = run_sweep(CONFIG, tmp_path, killing_episode, workers=2)
    assert len(records) == 6
    (failed,) = (record for record in records if record.error)
    assert failed.key == "hub/001"
    assert failed.error == "3 workers were lost with it; the last ended with exit code 1"


@pytest.mark.parametrize("workers", [1, 2])
def test_a_missing_resource_ends_the_sweep_unrecorded(tmp_path: Path, workers: int) -> None:
    with pytest.raises(ResourceError, match="OpenGL"):
        run_sweep(CONFIG, tmp_path, missing_gl_episode, workers=workers)
    assert not any(record.error for record in read_records(tmp_path))
    assert len(run_sweep(CONFIG, tmp_path, fake_episode)) == 6


def test_interrupt_keeps_what_is_recorded_and_the_rest_runs_later(tmp_path: Path) -> None:
    def interrupt(done: int, total: int, record: EpisodeRecord | None) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(SweepInterruptedError, match="2 of 6 episodes are recorded"):
        run_sweep(CONFIG, tmp_path, fake_episode, on_progress=interrupt)
    ran = []
    records = run_sweep(CONFIG, tmp_path, lambda config: ran.append(config.key) or fake_episode(config))
    assert len(ran) == 4
    assert comparable(records) == comparable(run_sweep(CONFIG, tmp_path / "whole", fake_episode))


def test_a_directory_of_another_sweep_is_refused(tmp_path: Path) -> None:
    run_sweep(CONFIG, tmp_path, fake_episode)
    with pytest.raises(InputError, match="got scenes=3, sensor=lab; expected scenes=4, sensor=ideal"):
        run_sweep(replace(CONFIG, scenes=4, sensor="ideal"), tmp_path, fake_episode)


def test_a_record_of_another_sweep_is_refused(tmp_path: Path) -> None:
    run_sweep(CONFIG, tmp_path, fake_episode)
    file = tmp_path / EPISODES_FILE
    lines = file.read_text().splitlines(keepends=True)
    changed = json.loads(lines[0]) | {"config_hash": "0"}
    file.write_text("".join([json.dumps(changed) + "\n", *lines[1:]]))
    with pytest.raises(InputError, match="episode hub/000 of another one"):
        run_sweep(CONFIG, tmp_path, fake_episode)


def test_progress_counts_resumed_episodes(tmp_path: Path) -> None:
    seen = []

    def note(done: int, total: int, record: EpisodeRecord | None) -> None:
        seen.append((done, total))

    run_sweep(CONFIG, tmp_path, fake_episode, on_progress=note)
    assert seen == [(i, 6) for i in range(7)]
    seen.clear()
    run_sweep(CONFIG, tmp_path, fake_episode, on_progress=note)
    assert seen == [(6, 6)]


SCRIPT = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_sweep import CONFIG, fake_episode
from benchmark.episodes.sweep import run_sweep

def slow_episode(config):
    time.sleep(0.5)
    return fake_episode(config)

if __name__ == "__main__":
    run_sweep(CONFIG, Path(sys.argv[1]), slow_episode, workers=int(sys.argv[2]))
"""


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_in_the_middle_and_run_again_gives_the_same_table(tmp_path: Path, workers: int) -> None:
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT.format(tests=str(Path(__file__).parent))))
    out = tmp_path / "out"
    process = subprocess.Popen([sys.executable, str(script), str(out), str(workers)])
    try:
        _wait_for_lines(out / EPISODES_FILE, 2)
    finally:
        process.kill()
    assert process.wait() == -signal.SIGKILL
    assert 2 <= len(read_records(out)) < 6
    with open(out / EPISODES_FILE, "a") as file:
        file.write('{"schema":1,"key":"hub/00')  # as if it had been killed while it wrote
    records = run_sweep(CONFIG, out, fake_episode)
    whole = run_sweep(CONFIG, tmp_path / "whole", fake_episode)
    assert comparable(records) == comparable(whole)
    assert to_dict(build_table(CONFIG, records)) == to_dict(build_table(CONFIG, whole))


def _wait_for_lines(path: Path, count: int, timeout_s: float = 60) -> None:
    deadline = time.monotonic() + timeout_s
    while not path.exists() or path.read_bytes().count(b"\n") < count:
        assert time.monotonic() < deadline, "the sweep did not get going"
        time.sleep(0.05)
