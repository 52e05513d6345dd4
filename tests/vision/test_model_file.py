"""Vision models survive the way to a file and back; files that are wrong are refused, naming the field."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.schema_rules import follows
from vision.errors import FileFormatError, InputError
from vision.extraction import ExtractionThresholds
from vision.geometry.circle import Circle
from vision.model.model_file import load_model, model_from_json, model_to_json, save_model

MODELS = Path(__file__).resolve().parents[2] / "assets" / "models"
SCHEMA = json.loads((MODELS / "vision_model.schema.json").read_text(encoding="utf-8"))
SHIPPED = [MODELS / f"{name}.json" for name in ("hub", "cover1", "cover2")]
PATTERN = {
    "name": "vents",
    "normal": [0.0, 0.0, 1.0],
    "points_m": [[0.05, 0.01, 0.002], [0.052, 0.01, 0.002]],
    "directions": [[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]],
}
HUB = json.loads(SHIPPED[0].read_text(encoding="utf-8")) | {"patterns": [PATTERN]}


def objects(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The schema and all schemas within it."""
    yield schema
    inner = [*schema.get("properties", {}).values(), *schema.get("$defs", {}).values(), *schema.get("anyOf", [])]
    for child in inner + ([schema["items"]] if "items" in schema else []):
        yield from objects(child)


def changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """The hub's document, given a pattern, with the value at a path replaced; ``...`` deletes the key."""
    document = copy.deepcopy(HUB)
    target = document
    for step in path[:-1]:
        target = target[step]
    if value is ...:
        del target[path[-1]]
    else:
        target[path[-1]] = value
    return document


def written(path: tuple[Any, ...]) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path).removeprefix(".")


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_model_is_read_follows_the_schema_and_comes_back_byte_for_byte(path, tmp_path):
    model = load_model(path)
    assert model.part == path.stem
    assert follows(json.loads(path.read_text(encoding="utf-8")), SCHEMA)
    save_model(model, tmp_path / "copy.json")
    assert (tmp_path / "copy.json").read_bytes() == path.read_bytes()


def test_every_field_of_the_schema_is_documented_and_nothing_else_is_allowed():
    for schema in objects(SCHEMA):
        assert {"description", "$ref", "type"} & set(schema)
        for name, inner in schema.get("properties", {}).items():
            assert inner.get("description", "").endswith("."), name
        if "properties" in schema:
            assert schema["additionalProperties"] is False


WRONG = [
    (("format",), "coco"),
    (("format",), ...),
    (("version",), 1),
    (("version",), 2),
    (("version",), 4),
    (("version",), "1"),
    (("part",), ""),
    (("part",), 7),
    (("part",), ...),
    (("diameter_m",), 0),
    (("diameter_m",), -0.24),
    (("diameter_m",), "0.24"),
    (("diameter_m",), True),
    (("diameter_mm",), 240.0),
    (("symmetry_fold",), 0),
    (("symmetry_fold",), 5.5),
    (("symmetry_fold",), ...),
    (("features",), {}),
    (("features",), None),
    (("features", 3), 1),
    (("features", 3, "radius_m"), -1),
    (("features", 3, "radius_m"), ...),
    (("features", 3, "radius_m"), None),
    (("features", 3, "diameter_m"), 0.1),
    (("features", 0, "name"), ""),
    (("features", 0, "role"), "decorative"),
    (("features", 0, "role"), ["salient"]),
    (("features", 0, "extractor"), "hough"),
    (("features", 0, "centre_m"), [0, 0]),
    (("features", 0, "centre_m", 1), "0"),
    (("features", 0, "centre_m", 1), False),
    (("features", 0, "normal"), [0, 0, 1, 0]),
    (("features", 0, "copies"), 0),
    (("features", 0, "copies"), 1.0),
    (("features", 0, "support"), 1.01),
    (("features", 0, "support"), -0.1),
    (("features", 0, "attributes"), []),
    (("features", 0, "attributes", "weight_kg"), {"low": 0, "high": 1}),
    (("features", 0, "attributes", "area_px"), {"low": 0}),
    (("features", 0, "attributes", "area_px"), 5),
    (("patterns",), ...),
    (("patterns",), {}),
    (("patterns", 0, "name"), ""),
    (("patterns", 0, "normal"), [0, 1]),
    (("patterns", 0, "points_m"), []),
    (("patterns", 0, "points_m", 1), [0.0, 0.1]),
    (("patterns", 0, "points_m", 1, 2), None),
    (("patterns", 0, "points_mm"), [[1, 2, 3]]),
    (("patterns", 0, "directions"), ...),
    (("patterns", 0, "directions", 0), 1.0),
    (("grasps", 0, "kind"), "sideways"),
    (("grasps", 0, "width_m"), 0),
    (("grasps", 0, "copies"), -1),
    (("grasps", 0, "rotation_xyzw"), [0, 0, 1]),
    (("grasps", 0, "translation_m"), ...),
    (("bore",), []),
    (("bore", "depth_m"), 0),
    (("bore", "chamfer_m"), 0.001),
    (("thresholds",), ...),
    (("thresholds", "canny_low"), 0),
    (("thresholds", "homogeneity"), "6"),
    (("thresholds", "fitting_error_px"), ...),
    (("thresholds", "fitting_error_mm"), 1.0),
]


@pytest.mark.parametrize(("path", "value"), WRONG, ids=lambda x: written(x) if isinstance(x, tuple) else repr(x))
def test_wrong_field_is_named_and_refused_by_reader_and_schema_alike(path, value):
    document = changed(path, value)
    assert not follows(document, SCHEMA)
    with pytest.raises(FileFormatError) as refusal:
        model_from_json(json.dumps(document), source="hub.json")
    named = str(refusal.value).removeprefix("hub.json: ").partition(": got ")[0]
    inner = f"{written(path)}." if isinstance(value, dict) else written(path)
    assert named == written(path) or named.startswith(inner)


BEYOND_THE_SCHEMA = [
    (("diameter_m",), math.nan),
    (("diameter_m",), math.inf),
    (("diameter_m",), 10**400),
    (("features", 3, "radius_m"), math.nan),
    (("features", 0, "centre_m", 2), -math.inf),
    (("features", 0, "normal"), [0, 0, 0]),
    (("features", 0, "normal"), [0, 0, 1.001]),
    (("features", 0, "normal"), [1e308, 1e308, 1e308]),
    (("features", 0, "attributes", "area_px"), {"low": 2, "high": 1}),
    (("features", 0, "attributes", "area_px", "low"), math.nan),
    (("patterns", 0, "points_m", 0, 0), math.nan),
    (("patterns", 0, "directions"), [[1, 0, 0]]),
    (("patterns", 0, "directions", 1), [1, 1, 0]),
    (("grasps", 0, "rotation_xyzw"), [0, 0, 0, 0]),
    (("bore", "rotation_xyzw"), [0, 0, 0, 1.1]),
    (("thresholds", "noise_factor"), math.inf),
]


@pytest.mark.parametrize(
    ("path", "value"), BEYOND_THE_SCHEMA, ids=lambda x: written(x) if isinstance(x, tuple) else repr(x)[:20]
)
def test_reader_also_refuses_what_a_schema_cannot_say(path, value):
    with pytest.raises(FileFormatError, match=r"hub\.json: ") as refusal:
        model_from_json(json.dumps(changed(path, value)), source="hub.json")
    assert f"hub.json: {written(path)}: got" in str(refusal.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "7", '"hub"', "[" * 100_000], ids=lambda text: text[:6])
def test_text_that_is_no_model_is_refused(text):
    with pytest.raises(FileFormatError, match=r"^hub\.json: got"):
        model_from_json(text, source="hub.json")


def test_model_without_salient_features_is_refused():
    document = changed(("features",), [f for f in HUB["features"] if f["role"] == "supporting"])
    with pytest.raises(FileFormatError, match=r"hub\.json: .*no salient feature"):
        model_from_json(json.dumps(document), source="hub.json")


def test_salient_feature_off_the_axis_is_refused():
    with pytest.raises(FileFormatError, match=r"salient feature 'outline_front'"):
        model_from_json(json.dumps(changed(("features", 0, "centre_m"), [0.05, 0, 0])))


def test_file_that_is_missing_or_no_text_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"hub\.json"):
        load_model(tmp_path / "hub.json")
    (tmp_path / "hub.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match=r"hub\.json: got not UTF-8"):
        load_model(tmp_path / "hub.json")


def test_model_is_not_written_where_there_is_no_directory(tmp_path):
    with pytest.raises(InputError, match="writable"):
        save_model(load_model(SHIPPED[0]), tmp_path / "nowhere" / "hub.json")


def test_model_without_bore_grasps_or_symmetry_comes_back():
    document = changed(("bore",), None) | {"grasps": [], "symmetry_fold": None}
    assert follows(document, SCHEMA)
    assert json.loads(model_to_json(model_from_json(json.dumps(document)))) == document


def test_a_point_of_a_pattern_is_a_line_of_the_file_and_a_name_stays_what_it_is():
    name = "[\n  1,\n  2\n]"
    written_model = model_to_json(model_from_json(json.dumps(changed(("patterns", 0, "name"), name))))
    assert "        [0.052, 0.01, 0.002]\n" in written_model
    assert model_from_json(written_model).patterns[0].name == name


def test_adapted_thresholds_come_back():
    adapted = ExtractionThresholds(canny_low=2.5, canny_high=6.25, shortest_fragment_px=14.0, fitting_error_px=1.2)
    model = replace(load_model(SHIPPED[0]), thresholds=adapted)
    assert model_from_json(model_to_json(model)).thresholds == adapted
    assert load_model(SHIPPED[0]).thresholds == ExtractionThresholds()


def test_thresholds_that_contradict_each_other_are_refused():
    document = changed(("thresholds", "canny_low"), 9.0)
    with pytest.raises(FileFormatError, match=r"hub\.json: thresholds: got .* canny_low <= canny_high"):
        model_from_json(json.dumps(document), source="hub.json")


def test_last_bits_of_a_measurement_do_not_reach_the_file():
    model = load_model(SHIPPED[0])
    features = [
        replace(f, circle=Circle(f.circle.centre + 1e-11, f.circle.normal, f.circle.radius_m - 1e-11))
        for f in model.features
    ]
    assert model_to_json(replace(model, features=tuple(features))) == model_to_json(model)
