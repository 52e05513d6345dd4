"""Vision models survive the way to a file and back; files that are wrong are refused, naming the field."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from vision.errors import FileFormatError, InputError
from vision.model_file import load_model, model_from_json, model_to_json, save_model

MODELS = Path(__file__).resolve().parents[2] / "assets" / "models"
SCHEMA = json.loads((MODELS / "vision_model.schema.json").read_text(encoding="utf-8"))
SHIPPED = [MODELS / f"{name}.json" for name in ("hub", "cover1", "cover2")]
HUB = json.loads(SHIPPED[0].read_text(encoding="utf-8"))

TYPES: dict[str, Callable[[Any], bool]] = {
    "object": lambda v: isinstance(v, dict),
    "array": lambda v: isinstance(v, list),
    "string": lambda v: isinstance(v, str),
    "number": lambda v: isinstance(v, int | float) and not isinstance(v, bool),
    "integer": lambda v: isinstance(v, int) and not isinstance(v, bool),
    "null": lambda v: v is None,
}
RULES: dict[str, Callable[[Any, Any], bool]] = {
    "type": lambda v, want: any(TYPES[t](v) for t in ([want] if isinstance(want, str) else want)),
    "const": lambda v, want: v == want,
    "enum": lambda v, want: v in want,
    "minLength": lambda v, want: not isinstance(v, str) or len(v) >= want,
    "minimum": lambda v, want: not TYPES["number"](v) or v >= want,
    "maximum": lambda v, want: not TYPES["number"](v) or v <= want,
    "exclusiveMinimum": lambda v, want: not TYPES["number"](v) or v > want,
    "minItems": lambda v, want: not isinstance(v, list) or len(v) >= want,
    "maxItems": lambda v, want: not isinstance(v, list) or len(v) <= want,
    "required": lambda v, want: not isinstance(v, dict) or set(want) <= set(v),
    "items": lambda v, want: not isinstance(v, list) or all(follows(item, want) for item in v),
    "anyOf": lambda v, want: any(follows(v, option) for option in want),
    "$ref": lambda v, want: follows(v, SCHEMA["$defs"][want.removeprefix("#/$defs/")]),
}
SILENT = {"$schema", "$defs", "title", "description", "properties", "additionalProperties"}


def follows(value: Any, schema: dict[str, Any]) -> bool:
    """Whether a document follows the schema, for the keywords that ours uses; KeyError for any other keyword."""
    if isinstance(value, dict) and "properties" in schema:
        unknown = set(value) - set(schema["properties"])
        if unknown or not all(follows(v, schema["properties"][k]) for k, v in value.items()):
            return False
    return all(RULES[keyword](value, want) for keyword, want in schema.items() if keyword not in SILENT)


def objects(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The schema and all schemas within it."""
    yield schema
    inner = [*schema.get("properties", {}).values(), *schema.get("$defs", {}).values(), *schema.get("anyOf", [])]
    for child in inner + ([schema["items"]] if "items" in schema else []):
        yield from objects(child)


def changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    """The hub's document with the value at a path replaced; ``...`` deletes the key."""
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
    (("version",), 2),
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
    (("grasps", 0, "kind"), "sideways"),
    (("grasps", 0, "width_m"), 0),
    (("grasps", 0, "copies"), -1),
    (("grasps", 0, "rotation_xyzw"), [0, 0, 1]),
    (("grasps", 0, "translation_m"), ...),
    (("bore",), []),
    (("bore", "depth_m"), 0),
    (("bore", "chamfer_m"), 0.001),
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
    (("grasps", 0, "rotation_xyzw"), [0, 0, 0, 0]),
    (("bore", "rotation_xyzw"), [0, 0, 0, 1.1]),
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
    text = json.dumps(document, indent=2) + "\n"
    assert follows(document, SCHEMA)
    assert model_to_json(model_from_json(text)) == text
