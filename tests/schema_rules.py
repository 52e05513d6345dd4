"""Whether a document follows a JSON Schema, for the keywords that ours use."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_TYPES: dict[str, Callable[[Any], bool]] = {
    "object": lambda v: isinstance(v, dict),
    "array": lambda v: isinstance(v, list),
    "string": lambda v: isinstance(v, str),
    "number": lambda v: isinstance(v, int | float) and not isinstance(v, bool),
    "integer": lambda v: isinstance(v, int) and not isinstance(v, bool),
    "null": lambda v: v is None,
}
_RULES: dict[str, Callable[[Any, Any], bool]] = {
    "type": lambda v, want: any(_TYPES[t](v) for t in ([want] if isinstance(want, str) else want)),
    "const": lambda v, want: v == want,
    "enum": lambda v, want: v in want,
    "minLength": lambda v, want: not isinstance(v, str) or len(v) >= want,
    "minimum": lambda v, want: not _TYPES["number"](v) or v >= want,
    "maximum": lambda v, want: not _TYPES["number"](v) or v <= want,
    "exclusiveMinimum": lambda v, want: not _TYPES["number"](v) or v > want,
    "minItems": lambda v, want: not isinstance(v, list) or len(v) >= want,
    "maxItems": lambda v, want: not isinstance(v, list) or len(v) <= want,
    "required": lambda v, want: not isinstance(v, dict) or set(want) <= set(v),
}
_NESTED: dict[str, Callable[[Any, Any, Any], bool]] = {
    "items": lambda v, want, root: not isinstance(v, list) or all(follows(item, want, root) for item in v),
    "anyOf": lambda v, want, root: any(follows(v, option, root) for option in want),
    "$ref": lambda v, want, root: follows(v, root["$defs"][want.removeprefix("#/$defs/")], root),
}
_SILENT = {"$schema", "$defs", "title", "description", "properties", "additionalProperties"}


def follows(value: Any, schema: dict[str, Any], root: dict[str, Any] | None = None) -> bool:
    """Whether a document follows a schema; KeyError for keywords that ours do not use."""
    root = root or schema
    if isinstance(value, dict) and "properties" in schema:
        unknown = set(value) - set(schema["properties"])
        if unknown or not all(follows(v, schema["properties"][k], root) for k, v in value.items()):
            return False
    rules = [(keyword, want) for keyword, want in schema.items() if keyword not in _SILENT]
    return all(
        _NESTED[keyword](value, want, root) if keyword in _NESTED else _RULES[keyword](value, want)
        for keyword, want in rules
    )
