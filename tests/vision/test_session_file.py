"""Sessions survive the way to a file and back; the shipped ones give the shipped models, byte for byte."""

from __future__ import annotations

import json
import math
import os
import stat
from dataclasses import fields
from pathlib import Path

import pytest

from tests.same_model import assert_same
from tests.schema_rules import follows
from vision.errors import FileFormatError, InputError
from vision.extraction import ExtractionThresholds
from vision.files.json_reader import JsonValue
from vision.model.model_file import model_to_json
from vision.teaching import events as ev
from vision.teaching.session import Session, ViewDigest
from vision.teaching.session_file import (
    event_from,
    event_to_dict,
    key_of,
    load_session,
    replay,
    save_session,
    session_from_json,
    session_to_json,
)

MODELS = Path(__file__).resolve().parents[2] / "assets" / "models"
SCHEMA = json.loads((MODELS / "teaching_session.schema.json").read_text(encoding="utf-8"))
PARTS = ("hub", "cover1", "cover2")
POSE = ((0.0, -1.0, 0.0, 0.1), (1.0, 0.0, 0.0, -0.2), (0.0, 0.0, 1.0, 1 / 3), (0.0, 0.0, 0.0, 1.0))
EVERY = [
    ev.DescribePart("plate", 0.06, None, time_s=0.25),
    ev.AddFeature("f1", "rim", "salient"),
    ev.AddFeature("f2", "hole", "supporting"),
    ev.RenameFeature("f1", "bördel"),
    ev.SetRole("f2", "supporting"),
    ev.SetCopies("f2", 5),
    ev.SetExtractor("f1", "group"),
    ev.SetExtractor("f1", None),
    ev.AddPoint("f1", 0, 1 / 3, 2.0),
    ev.MovePoint("f1", 0, 0, 0.1, -2.5),
    ev.AddPoint("f1", 0, 7.0, 7.0),
    ev.RemovePoint("f1", 0, 1),
    ev.ClearMarks("f1", 0),
    ev.ChooseCandidate("f1", 1, "region", (30.0, 20.0, 12.0, 9.0, 0.4)),
    ev.PlaceGrasp("g1", "rim", POSE, 0.06, "outside", 12),
    ev.RemoveGrasp("g1"),
    ev.SetBore(POSE, 0.02, 0.01),
    ev.RemoveBore(),
    ev.SetThresholds(ExtractionThresholds(homogeneity=5.5)),
    ev.Undo(),
    ev.Redo(),
    ev.RemoveFeature("f2"),
]
SESSION = Session((ViewDigest("a", "00"), ViewDigest("b", "01"))).do(*EVERY)


def document():
    return json.loads(session_to_json(SESSION))


def test_every_kind_of_event_is_tried_here():
    assert {type(e) for e in EVERY} == set(ev.EVENT_TYPES)


@pytest.mark.parametrize("event", EVERY, ids=lambda e: type(e).__name__)
def test_an_event_comes_back(event):
    assert event_from(JsonValue(json.loads(json.dumps(event_to_dict(event))), "event")) == event


def test_a_session_comes_back_and_follows_its_schema(tmp_path):
    save_session(SESSION, tmp_path / "session.json")
    assert load_session(tmp_path / "session.json") == SESSION
    assert load_session(tmp_path) == SESSION
    assert follows(document(), SCHEMA)
    assert session_to_json(load_session(tmp_path)) == session_to_json(SESSION)


def test_an_empty_session_comes_back():
    empty = Session(SESSION.views)
    assert session_from_json(session_to_json(empty)) == empty


def test_undo_history_survives_the_file(tmp_path):
    save_session(SESSION.do(ev.Undo(), ev.Undo()), tmp_path)
    loaded = load_session(tmp_path)
    assert loaded.do(ev.Redo(), ev.Redo()).document == SESSION.document
    assert loaded.do(*[ev.Undo()] * len(loaded.past)).document == Session(SESSION.views).document


def test_saving_replaces_the_file_in_one_step(tmp_path, monkeypatch):
    path = tmp_path / "session.json"
    save_session(Session(SESSION.views), path)
    before = path.read_bytes()

    def crash(*_):
        raise OSError("power cut")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", crash)
        with pytest.raises(InputError, match="power cut"):
            save_session(SESSION, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["session.json"]
    save_session(SESSION, path)
    assert load_session(path) == SESSION
    assert stat.S_IMODE(path.stat().st_mode) & 0o444 == 0o444


WRONG = [
    ({"format": "coco"}, "format"),
    ({"version": 2}, "version"),
    ({"views": 5}, "views"),
    ({"views": [{"name": "a"}]}, "views[0].sha256"),
    ({"events": {}}, "events"),
    ({"events": [5]}, "events[0]"),
    ({"events": [{"event": "Fly", "time_s": 0}]}, "events[0].event"),
    ({"events": [{"event": "Undo"}]}, "events[0].time_s"),
    ({"events": [{"event": "Undo", "time_s": 0, "view": 1}]}, "events[0].view"),
    (
        {"events": [{"event": "AddPoint", "feature_id": "f1", "view": -1, "x": 1, "y": 2, "time_s": 0}]},
        "events[0].view",
    ),
    (
        {"events": [{"event": "AddPoint", "feature_id": "f1", "view": 0, "x": "1", "y": 2, "time_s": 0}]},
        "events[0].x",
    ),
    (
        {"events": [{"event": "AddFeature", "feature_id": "f", "name": "", "role": "salient", "time_s": 0}]},
        "events[0].name",
    ),
    (
        {"events": [{"event": "SetExtractor", "feature_id": "f", "extractor": "x", "time_s": 0}]},
        "events[0].extractor",
    ),
    (
        {"events": [{"event": "SetBore", "T_part_bore": [[1, 2]], "diameter_m": 1, "depth_m": 1, "time_s": 0}]},
        "events[0].T_part_bore",
    ),
]


@pytest.mark.parametrize(("change", "path"), WRONG, ids=lambda x: x if isinstance(x, str) else "")
def test_wrong_field_is_named_and_refused_by_reader_and_schema_alike(change, path):
    wrong = document() | change
    assert not follows(wrong, SCHEMA)
    with pytest.raises(FileFormatError) as refusal:
        session_from_json(json.dumps(wrong), "session.json")
    assert str(refusal.value).startswith(f"session.json: {path}: got")


def test_an_event_that_cannot_have_happened_is_named():
    wrong = document()
    wrong["events"][8]["feature_id"] = "f9"
    with pytest.raises(FileFormatError, match=r"session\.json: events\[8\]: feature: got f9"):
        session_from_json(json.dumps(wrong), "session.json")


def test_numbers_that_are_none_are_refused():
    wrong = document()
    wrong["events"][8]["x"] = math.nan
    with pytest.raises(FileFormatError, match=r"events\[8\]\.x: got nan"):
        session_from_json(json.dumps(wrong))


def test_schema_and_reader_know_the_same_events_and_fields():
    kinds = {kind.__name__: kind for kind in ev.EVENT_TYPES}
    assert set(SCHEMA["$defs"]) == set(kinds) | {"view", "thresholds"}
    for name, kind in kinds.items():
        assert set(SCHEMA["$defs"][name]["required"]) == {"event"} | {key_of(kind, f.name) for f in fields(kind)}


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_the_shipped_session_gives_the_shipped_model(part):
    directory = MODELS / "sessions" / part
    assert follows(json.loads((directory / "session.json").read_text(encoding="utf-8")), SCHEMA)
    shipped = (MODELS / f"{part}.json").read_text(encoding="utf-8")
    assert_same(json.loads(shipped), json.loads(model_to_json(replay(directory))), part)
