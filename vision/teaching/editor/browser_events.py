"""From what the browser sends to events."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vision.errors import InputError
from vision.teaching import events as ev


def event_of_act(act: Mapping[str, Any], feature_id: str) -> ev.Event:
    """The event behind an act on a picture.

    Args:
        act: ``kind``, ``view``, and what the kind needs.
        feature_id: the feature that it is about.

    Raises:
        InputError: the act makes no sense.
    """
    try:
        view = int(act["view"])
        match act["kind"]:
            case "point":
                return ev.AddPoint(feature_id, view, _pixel(act["x"]), _pixel(act["y"]))
            case "move":
                return ev.MovePoint(feature_id, view, int(act["index"]), _pixel(act["x"]), _pixel(act["y"]))
            case "remove":
                return ev.RemovePoint(feature_id, view, int(act["index"]))
            case "choose":
                ellipse = tuple(float(v) for v in act["ellipse"])
                return ev.ChooseCandidate(feature_id, view, act["extractor"], ellipse)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("act of the page", got=dict(act), expected="kind, view and place", do=str(error)) from error
    raise InputError("act of the page", got=act["kind"], expected="point, move, remove or choose")


def _pixel(value: object) -> float:
    """A hundredth of a pixel is more than any hand can do."""
    return round(float(value), 2)  # type: ignore[arg-type]
