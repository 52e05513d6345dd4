from __future__ import annotations

import contextlib
import errno
import json
import os
import resource
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmark.config import SweepConfig
from benchmark.records.episode_record import (
    EpisodeRecord,
    LocalizerResult,
    NormalizedError,
    PickRecord,
    PieceRecord,
    PoseErrors,
    PoseOffset,
    from_json,
    to_json,
)
from benchmark.records.store import EPISODES_FILE, RecordWriter, read_config, read_records
from vision.errors import FileFormatError, InputError, ResourceError

CONFIG = SweepConfig(parts=("hub",), scenes=3)
ERRORS = PoseErrors(0.4, 0.3, None, 0.3, 0.9)
RECORD = EpisodeRecord(
    key="hub/000",
    parts=("hub",),
    scene=0,
    seed=17,
    config_hash="abc",
    environment={"numpy": "2"},
    pieces=(PieceRecord(0, "hub", 0.75, True, {"focal": LocalizerResult(True, True, ERRORS)}, None),),
    picks=(PickRecord(True, 0, False, "grip", "rim"),),
    false_positives={"focal": 1},
    timings_s={"drop": 0.5, "total": 2.0},
)

texts = st.none() | st.text(max_size=8)
lengths = st.floats(0, 1e6)
errors = st.builds(PoseErrors, lengths, lengths, st.none() | lengths, lengths, lengths)
vectors = st.tuples(*3 * [st.floats(-1e6, 1e6)])
results = st.builds(LocalizerResult, st.booleans(), st.just(False)) | st.builds(
    LocalizerResult,
    st.booleans(),
    st.booleans(),
    errors,
    st.none() | st.builds(NormalizedError, lengths, st.sampled_from([5, 6])),
    st.none() | st.builds(PoseOffset, vectors, vectors),
)
pieces = st.builds(
    PieceRecord, st.integers(0, 9), st.text(max_size=5), st.floats(0, 1), st.booleans(), st.just({}), texts
) | st.builds(
    PieceRecord,
    st.integers(0, 9),
    st.text(max_size=5),
    st.floats(0, 1),
    st.booleans(),
    st.dictionaries(st.text(max_size=5), results, max_size=3),
)
records = st.builds(
    EpisodeRecord,
    key=st.text(),
    parts=st.lists(st.text(max_size=5), max_size=3).map(tuple),
    scene=st.integers(0, 99),
    seed=st.integers(0, 2**63 - 1),
    config_hash=st.text(max_size=5),
    pieces=st.lists(pieces, max_size=3).map(tuple),
    picks=st.lists(
        st.builds(PickRecord, st.booleans(), st.none() | st.integers(0, 9), st.booleans(), texts, texts), max_size=2
    ).map(tuple),
    timings_s=st.dictionaries(st.sampled_from(["drop", "total"]), lengths),
    error=texts,
)


@given(record=records)
@settings(deadline=None)
def test_round_trip(record: EpisodeRecord) -> None:
    line = to_json(record)
    assert "\n" not in line
    assert from_json(line) == record


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("seed",), "seven", r"line 4: field seed: got 'seven'; expected int"),
        (("seed",), True, r"field seed"),
        (("pieces", 0, "visibility"), None, r"field pieces\[0\].visibility: got None; expected float"),
        (("pieces", 0, "results", "focal", "matched"), 1, r"field pieces\[0\].results.focal.matched: got 1"),
        (("pieces", 0, "results", "focal", "errors", "tilt_deg"), -1.0, r"results.focal.errors .*tilt_deg.*got -1.0"),
        (("pieces", 0, "results", "focal", "errors"), None, r"got no errors"),
        (("picks",), {}, r"field picks"),
        (("picks", 0, "speed"), 3, r"field picks\[0\].speed: got an unknown field"),
        (("schema",), 99, r"field schema: got 99; expected 1\. Use the focalpick that wrote"),
    ],
)
def test_a_bad_field_is_named_with_its_line(path: tuple[str | int, ...], value: object, message: str) -> None:
    fields = json.loads(to_json(RECORD))
    target = fields
    for step in path[:-1]:
        target = target[step]
    target[path[-1]] = value
    with pytest.raises(FileFormatError, match=message):
        from_json(json.dumps(fields), "episodes.jsonl line 4")


@pytest.mark.parametrize("newer", [',"normalized":null', ',"offset":null'])
def test_records_of_before_a_field_are_read(newer: str) -> None:
    line = to_json(RECORD)
    assert newer in line
    assert from_json(line.replace(newer, "")) == RECORD


def test_a_missing_field_is_named() -> None:
    fields = json.loads(to_json(RECORD))
    del fields["pieces"][0]["part"]
    with pytest.raises(FileFormatError, match=r"field pieces\[0\].part: got nothing"):
        from_json(json.dumps(fields))


@pytest.mark.parametrize("line", ["", "{", "[1]", "null", '{"schema":1,"key":NaN}'])
def test_what_is_no_record_is_refused(line: str) -> None:
    with pytest.raises(FileFormatError):
        from_json(line)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -0.1])
def test_errors_without_sense_are_refused(value: float) -> None:
    with pytest.raises(InputError, match="tilt_deg"):
        PoseErrors(0.0, value, None, 0.0, 0.0)


@pytest.mark.parametrize("vector", [(), (1.0, 2.0), (0.0, float("nan"), 0.0), (0.0, 0.0, 0.0, 0.0)])
def test_offsets_without_sense_are_refused(vector: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="rotation_deg"):
        PoseOffset((0.0, 0.0, 0.0), vector)


def write(directory: Path, *keys: str, config: SweepConfig = CONFIG) -> None:
    with RecordWriter(directory, config) as writer:
        for key in keys:
            writer.append(replace(RECORD, key=key))


def test_what_is_written_is_read_sorted(tmp_path: Path) -> None:
    write(tmp_path / "a" / "b", "hub/002", "hub/000")
    write(tmp_path / "a" / "b", "hub/001")
    assert [r.key for r in read_records(tmp_path / "a" / "b")] == ["hub/000", "hub/001", "hub/002"]
    assert read_config(tmp_path / "a" / "b") == CONFIG


@pytest.mark.parametrize("kept", [1, 10, -1])
def test_a_torn_last_line_is_passed_over_and_then_cut_off(tmp_path: Path, kept: int) -> None:
    write(tmp_path, "hub/000", "hub/001")
    file = tmp_path / EPISODES_FILE
    first, second, _ = file.read_text().split("\n")
    file.write_text(f"{first}\n{second[:kept] if kept > 0 else second}")
    assert [r.key for r in read_records(tmp_path)] == ["hub/000"]
    write(tmp_path, "hub/002")
    assert [r.key for r in read_records(tmp_path)] == ["hub/000", "hub/002"]


def test_a_broken_line_in_the_middle_is_an_error(tmp_path: Path) -> None:
    write(tmp_path, "hub/000", "hub/001", "hub/002")
    file = tmp_path / EPISODES_FILE
    lines = file.read_text().split("\n")
    file.write_text("\n".join([lines[0], lines[1][:30], *lines[2:]]))
    with pytest.raises(FileFormatError, match=r"episodes.jsonl line 2"):
        read_records(tmp_path)


def test_bytes_that_are_no_text_are_an_error(tmp_path: Path) -> None:
    write(tmp_path, "hub/000")
    (tmp_path / EPISODES_FILE).write_bytes(b"\xff\xfe\n")
    with pytest.raises(FileFormatError, match="UTF-8"):
        read_records(tmp_path)


def test_nothing_there_is_an_input_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="focalpick sweep --out"):
        read_records(tmp_path)


def test_a_second_writer_is_refused(tmp_path: Path) -> None:
    with RecordWriter(tmp_path, CONFIG), pytest.raises(InputError, match="one that is running"):
        RecordWriter(tmp_path, CONFIG)
    write(tmp_path, "hub/000")


def test_another_configuration_is_refused(tmp_path: Path) -> None:
    write(tmp_path)
    with pytest.raises(InputError, match="got seed=0; expected seed=9"):
        RecordWriter(tmp_path, replace(CONFIG, seed=9))


def test_a_path_that_is_a_file_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="writable directory"):
        RecordWriter(tmp_path / "file", CONFIG)


def test_a_full_disk_is_a_resource_error_and_keeps_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_space(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with RecordWriter(tmp_path, CONFIG) as writer:
        writer.append(RECORD)
        monkeypatch.setattr(os, "fsync", no_space)
        with pytest.raises(ResourceError, match="No space left"):
            writer.append(replace(RECORD, key="hub/001"))
    assert RECORD in read_records(tmp_path)


def test_a_file_that_may_not_grow_is_a_resource_error_and_is_repaired(tmp_path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with RecordWriter(tmp_path, CONFIG) as writer:
        writer.append(RECORD)
        resource.setrlimit(resource.RLIMIT_FSIZE, ((tmp_path / EPISODES_FILE).stat().st_size + 50, hard))
        try:
            with pytest.raises(ResourceError, match="make room"):
                writer.append(replace(RECORD, key="hub/001"))
            with contextlib.suppress(ResourceError):  # what is still in the buffer cannot be written either
                writer.close()
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    write(tmp_path, "hub/002")
    assert [r.key for r in read_records(tmp_path)] == ["hub/000", "hub/002"]
