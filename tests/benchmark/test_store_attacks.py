"""Files and file systems that a sweep's directory should not meet, and does."""

from __future__ import annotations

import errno
import json
import os

import pytest

from benchmark.config import SweepConfig
from benchmark.records import store
from benchmark.records.episode_record import EpisodeRecord, from_json, parse_object, to_json
from benchmark.records.store import EPISODES_FILE, RecordWriter, read_records
from vision.errors import FileFormatError, InputError

CONFIG = SweepConfig(parts=("hub",), scenes=1, workers=1)
RECORD = EpisodeRecord(key="hub-0", parts=("hub",), scene=0, seed=1, config_hash="0" * 64)


def write(directory, text):
    (directory / EPISODES_FILE).write_text(text, encoding="utf-8")


def test_a_blank_line_and_a_byte_order_mark_are_passed_over(tmp_path):
    other = EpisodeRecord(key="hub-1", parts=("hub",), scene=1, seed=2, config_hash="0" * 64)
    write(tmp_path, f"\ufeff{to_json(RECORD)}\n\n{to_json(other)}\n")
    assert [record.key for record in read_records(tmp_path)] == ["hub-0", "hub-1"]


def test_a_pipe_in_the_records_place_is_refused(tmp_path):
    os.mkfifo(tmp_path / EPISODES_FILE)
    with pytest.raises(InputError, match="regular file"):
        read_records(tmp_path)
    with pytest.raises(InputError, match="regular file"):
        RecordWriter(tmp_path, CONFIG)


def test_a_file_system_without_locks_is_told_from_a_running_sweep(tmp_path, monkeypatch):
    def no_locks(*_):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(store.fcntl, "flock", no_locks)
    with pytest.raises(InputError, match="without locks"):
        RecordWriter(tmp_path, CONFIG)


def test_the_working_directory_is_not_littered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="working directory"):
        RecordWriter(tmp_path, CONFIG)
    assert list(tmp_path.iterdir()) == []


def test_deeply_nested_json_is_bad_input():
    with pytest.raises(FileFormatError):
        parse_object("[" * 200_000, "records")


@pytest.mark.parametrize("field", ["seed", "timings_s"])
def test_a_number_of_400_digits_is_bad_input(field):
    fields = json.loads(to_json(RECORD))
    fields[field] = 10**400 if field == "seed" else {"vision": 10**400}
    with pytest.raises(FileFormatError, match="401 digits"):
        from_json(json.dumps(fields))


def test_a_visibility_above_one_is_refused():
    piece = {"index": 0, "part": "hub", "visibility": 17.5, "in_bin": True, "results": {}, "failed_stage": None}
    fields = json.loads(to_json(RECORD)) | {"pieces": [piece]}
    with pytest.raises(FileFormatError, match=r"17\.5"):
        from_json(json.dumps(fields))


def test_a_sweep_of_a_billion_scenes_is_refused():
    with pytest.raises(InputError, match="scenes"):
        SweepConfig(parts=("hub",), scenes=10**9)
