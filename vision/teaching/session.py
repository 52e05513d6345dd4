"""The state of a teaching session: what was done so far, and the document that follows from it. Nothing here changes.

A session is its events. Doing one more gives a new session; undo is an event like any other and restores the very
document that was there before.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vision.errors import InputError
from vision.geometry.camera import View
from vision.localizer import extract_features
from vision.model.vision_model import VisionModel
from vision.teaching import events as ev
from vision.teaching.document import Document, MarkedFeature, Point
from vision.teaching.edits import apply
from vision.teaching.lesson import acquire

__all__ = ["Document", "MarkedFeature", "Point", "Session", "ViewDigest", "build_model", "digests"]


@dataclass(frozen=True)
class ViewDigest:
    """By what a session recognises a view that it was recorded on.

    Attributes:
        name: of the view.
        sha256: of its grey levels, intrinsics and pose.
    """

    name: str
    sha256: str


@dataclass(frozen=True)
class Session:
    """Everything that a person did, on which views, and where that leads.

    Make one with :meth:`start`, carry it on with :meth:`do`.

    Attributes:
        views: the views that the events refer to.
        events: in the order in which they happened.
        document: what has been taught so far, undo and redo resolved.
        past: the documents that undo goes back to, the last one first.
        future: the documents that redo goes forward to, the next one first.
    """

    views: tuple[ViewDigest, ...]
    events: tuple[ev.Event, ...] = ()
    document: Document = field(default_factory=Document)
    past: tuple[Document, ...] = field(default=(), repr=False)
    future: tuple[Document, ...] = field(default=(), repr=False)

    @classmethod
    def start(cls, views: Sequence[View]) -> Session:
        """An empty session on some views."""
        return cls(digests(views))

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to take back."""
        return bool(self.past)

    @property
    def can_redo(self) -> bool:
        """Whether a change was taken back that nothing else has followed."""
        return bool(self.future)

    def do(self, *events: ev.Event) -> Session:
        """The session after some more events.

        An event that changes nothing is recorded, but is no step for undo.

        Raises:
            InputError: when an event refers to something that is not there; the session stays as it was.
        """
        session = self
        for event in events:
            session = session._do(event)
        return session

    def check(self, views: Sequence[View]) -> None:
        """Make sure that these are the views that the session was recorded on.

        Raises:
            InputError: naming the first view that is not.
        """
        present = digests(views)
        if len(present) != len(self.views):
            raise InputError("views of the session", got=f"{len(present)} views", expected=f"{len(self.views)}")
        for mine, other in zip(self.views, present, strict=True):
            if mine != other:
                raise InputError(
                    f"view {other.name!r}",
                    got="another picture, camera or pose",
                    expected=f"the view {mine.name!r} that the session was recorded on",
                    do="Restore the directory, or begin a new session.",
                )

    def _do(self, event: ev.Event) -> Session:
        recorded = (*self.events, event)
        if isinstance(event, ev.Undo):
            if not self.past:
                raise InputError("undo", got="no change left", expected="a change to take back")
            return Session(self.views, recorded, self.past[0], self.past[1:], (self.document, *self.future))
        if isinstance(event, ev.Redo):
            if not self.future:
                raise InputError("redo", got="no change left", expected="a change that was taken back")
            return Session(self.views, recorded, self.future[0], (self.document, *self.past), self.future[1:])
        if isinstance(event, ev.AddPoint | ev.MovePoint | ev.RemovePoint | ev.ClearMarks | ev.ChooseCandidate):
            self._check_view(event.view)
        document = apply(self.document, event)
        if document == self.document:
            return replace(self, events=recorded)
        return Session(self.views, recorded, document, (self.document, *self.past), ())

    def _check_view(self, number: int) -> None:
        if not 0 <= number < len(self.views):
            raise InputError("view", got=number, expected=f"a number from 0 to {len(self.views) - 1}")


def build_model(session: Session, views: Sequence[View]) -> VisionModel:
    """The vision model that a session teaches.

    Args:
        session: the session.
        views: those that it was recorded on, with distortion-free lenses.

    Raises:
        InputError: when the views are others, or the document is not complete.
    """
    session.check(views)
    lesson = session.document.lesson()
    found = [extract_features(view, ("region", "group"), thresholds=lesson.thresholds) for view in views]
    return acquire(lesson, views, found)


def digests(views: Sequence[View]) -> tuple[ViewDigest, ...]:
    """What a session remembers of its views."""
    return tuple(ViewDigest(view.name, _sha256(view)) for view in views)


def _sha256(view: View) -> str:
    camera = view.camera
    numbers = np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])
    pose = view.T_world_camera.as_matrix()[:3]
    content = hashlib.sha256(view.gray.tobytes())
    # Rounded, for a pose does not come back from a file to the last bit; 0.0 is added because -0.0 reads differently.
    content.update(",".join(f"{v + 0.0:.6f}" for v in np.round([*numbers, *pose.ravel()], 6)).encode())
    content.update(f"{camera.width_px}x{camera.height_px}".encode())
    return content.hexdigest()
