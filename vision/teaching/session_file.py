"""Teaching sessions as files: ``session.json`` in a lesson directory, one event a line; and their replay.

``assets/models/teaching_session.schema.json`` describes the format field by field.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

from vision.errors import FileFormatError, InputError
from vision.features import Extractor
from vision.files.json_reader import JsonValue, parse, read_text
from vision.model.grasp import GraspKind
from vision.model.model_file import thresholds_from, thresholds_to_dict
from vision.model.vision_model import Role, VisionModel
from vision.teaching import events as ev
from vision.teaching.session import Session, ViewDigest, build_model
from vision.teaching.view_directory import load_views

FORMAT = "focalpick-teaching-session"
VERSION = 1
SESSION_FILE = "session.json"


def load_session(path: Path) -> Session:
    """Read a session, every event done again.

    Args:
        path: the file, or the lesson directory that it is in.

    Raises:
        InputError: when there is no such file.
        FileFormatError: when it is not a session, with the path to the field or the event that is wrong.
    """
    path = path / SESSION_FILE if path.is_dir() else path
    text = read_text(path, "teaching session", "Begin one with `focalpick teach`.")
    return session_from_json(text, str(path))


def save_session(session: Session, path: Path) -> None:
    """Write a session; a crash leaves either the old file or the new one.

    Args:
        session: the session.
        path: the file, or the lesson directory that it belongs in.

    Raises:
        InputError: when the file cannot be written.
    """
    path = path / SESSION_FILE if path.is_dir() else path
    try:
        write_atomically(path, session_to_json(session))
    except OSError as error:
        raise InputError("teaching session", got=f"{path} ({error})", expected="a writable file") from error


def replay(path: Path) -> VisionModel:
    """The vision model that a recorded session teaches: every event once more, on the recorded views.

    Args:
        path: the lesson directory, or the session file in it.

    Raises:
        InputError: when a file is missing, the views are not those of the session, or the lesson is not complete.
        FileFormatError: when a file is not what its name says.
    """
    directory = path if path.is_dir() else path.parent
    return build_model(load_session(path), load_views(directory))


def session_to_json(session: Session) -> str:
    """The session as JSON text, one event a line, the same bytes for the same session."""
    head = {"format": FORMAT, "version": VERSION}
    views = [{"name": v.name, "sha256": v.sha256} for v in session.views]
    members = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in head.items()]
    members += [f'  "views": {_lines(views)}', f'  "events": {_lines([event_to_dict(e) for e in session.events])}']
    return "{\n" + ",\n".join(members) + "\n}\n"


def session_from_json(text: str, source: str = "teaching session") -> Session:
    """Read a session.

    Args:
        text: JSON.
        source: names the text in errors.

    Raises:
        FileFormatError: with the path to the field or the event that is wrong.
    """
    root = parse(text, source, "teaching session")
    root.check_header("teaching session", FORMAT, VERSION)
    d = root.members("format", "version", "views", "events")
    session = Session(tuple(_view_from(item) for item in d["views"].items()))
    for item in d["events"].items():
        event = event_from(item)
        try:
            session = session.do(event)
        except InputError as error:  # well formed, but it does not follow from what was done before
            where = f"{source}: {item.path}: {error.what}"
            raise FileFormatError(where, got=error.got, expected=error.expected) from error
    return session


def event_to_dict(event: ev.Event) -> dict[str, Any]:
    """An event as a JSON object: its type, its fields, and when it happened."""
    values = {key_of(type(event), f.name): getattr(event, f.name) for f in fields(event) if f.name != "time_s"}
    if isinstance(event, ev.SetThresholds):
        values["thresholds"] = thresholds_to_dict(event.thresholds)
    return {"event": type(event).__name__, **values, "time_s": event.time_s}


def event_from(item: JsonValue) -> ev.Event:
    """An event from a JSON object.

    Raises:
        FileFormatError: with the path to the field that is wrong.
    """
    found = item.mapping().get("event")
    item.check(found is not None, "an object with the key 'event'")
    kind = _TYPES[found.choice(tuple(_TYPES))]  # type: ignore[union-attr]
    keys = {f.name: key_of(kind, f.name) for f in fields(kind)}
    d = item.members("event", *keys.values())
    return kind(**{name: _READ[key](d[key]) for name, key in keys.items()})


def write_atomically(path: Path, content: str) -> None:
    """Write a text file; a crash leaves either the old file or the new one.

    Raises:
        OSError: when it cannot be written.
    """
    with tempfile.NamedTemporaryFile(
        "w", encoding="utf-8", newline="\n", dir=path.parent, prefix=f".{path.name}.", delete=False
    ) as file:
        temporary = Path(file.name)
        try:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
    temporary.chmod(0o644)  # temporary files are private, documents are not
    os.replace(temporary, path)


def _lines(values: list[dict[str, Any]]) -> str:
    lines = [f"    {json.dumps(value, allow_nan=False)}" for value in values]
    return "[\n" + ",\n".join(lines) + "\n  ]" if lines else "[]"


def _view_from(item: JsonValue) -> ViewDigest:
    d = item.members("name", "sha256")
    return ViewDigest(d["name"].text(), d["sha256"].text())


def _matrix(item: JsonValue) -> ev.Matrix:
    rows = item.items()
    item.check(len(rows) == 4, "four rows of four numbers")
    return tuple(tuple(float(v) for v in row.vector(4)) for row in rows)


def _ellipse(item: JsonValue) -> tuple[float, ...]:
    return tuple(float(v) for v in item.vector(5))


def key_of(kind: type[ev.Event], field: str) -> str:
    """What a field is called in the file; one has kept the name that it had in the first sessions."""
    return "process" if (kind, field) == (ev.ChooseCandidate, "extractor") else field


_TYPES = {kind.__name__: kind for kind in ev.EVENT_TYPES}
_READ: dict[str, Callable[[JsonValue], Any]] = {
    "time_s": JsonValue.number,
    "feature_id": JsonValue.text,
    "grasp_id": JsonValue.text,
    "name": JsonValue.text,
    "role": lambda item: item.choice(get_args(Role)),
    "kind": lambda item: item.choice(get_args(GraspKind)),
    "process": lambda item: item.choice(get_args(Extractor)),
    "extractor": lambda item: None if item.value is None else item.choice(get_args(Extractor)),
    "symmetry_fold": lambda item: None if item.value is None else item.count(),
    "copies": JsonValue.count,
    "view": lambda item: item.count(least=0),
    "index": lambda item: item.count(least=0),
    "x": JsonValue.number,
    "y": JsonValue.number,
    "diameter_m": JsonValue.positive,
    "width_m": JsonValue.positive,
    "depth_m": JsonValue.positive,
    "ellipse": _ellipse,
    "T_part_tcp": _matrix,
    "T_part_bore": _matrix,
    "thresholds": thresholds_from,
}
