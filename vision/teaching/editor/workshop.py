"""The one session of a lesson directory: every page that is open works on it and shows it."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from vision.errors import InputError
from vision.model.model_file import save_model
from vision.model.vision_model import Pattern, VisionModel
from vision.teaching import events as ev
from vision.teaching.document import Document
from vision.teaching.editor.autosave import Autosave
from vision.teaching.editor.background_extraction import BackgroundExtraction
from vision.teaching.editor.drawing_state import PALETTE
from vision.teaching.editor.findings import Finding, Inspector
from vision.teaching.editor.services import Description, SceneOutcome, Services, run_trial
from vision.teaching.editor.workers import Worker
from vision.teaching.session import Session, build_model
from vision.teaching.session_file import SESSION_FILE, load_session
from vision.teaching.threshold_search import Proposal, propose_thresholds
from vision.teaching.view_directory import load_part_name, load_views

Listener = Callable[[bool], None]

TOGETHER_S = 0.004
PAUSE_S = 0.3
"""After this long without a change, circles are settled."""


class Workshop:
    """Holds the session, stores it after every event, and tells the pages about changes.

    Everything but the workers runs in the event loop of the page, one event after the other.

    Attributes:
        directory: with the pictures and the session.
        out: where the model is saved.
        views: of the lesson, distortion-free.
        inspector: works out what follows from marks.
        session: as it stands.
        stored_problem: why the session could not be stored, or "".
        last_seen: the view and the feature that a page turned to last; the next one begins there.
    """

    def __init__(self, directory: Path, out: Path, services: Services) -> None:
        """Open a lesson directory and take up its session, where there is one.

        Raises:
            InputError: the directory has no views, or the session is of other views.
            FileFormatError: a file is not what its name says.
        """
        self.directory, self.out, self.services = directory, out, services
        self.views = load_views(directory)
        self.inspector = Inspector(self.views)
        self.session = self._open()
        self.stored_problem = ""
        self.last_seen: tuple[int, str | None] = (0, None)
        self.thinking = Worker()
        self.extraction = BackgroundExtraction(self.views)
        self._built: tuple[Document, VisionModel] | None = None
        self._saved: Document | None = self.session.document if out.exists() else None
        self._began = time.monotonic() - max((e.time_s for e in self.session.events), default=0.0)
        self._known: set[str] = set()
        self._stored: list[str] = []
        self._listeners: list[Listener] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._pause: asyncio.TimerHandle | None = None
        self._news: bool | None = None
        self._autosave = Autosave(directory / SESSION_FILE, self._on_stored)

    def _open(self) -> Session:
        path = self.directory / SESSION_FILE
        if path.exists():
            session = load_session(path)
            session.check(self.views)
            return session
        session = Session.start(self.views)
        described: Description | None = self.services.description
        if described is None:
            return session
        return session.do(ev.DescribePart(described.name, described.diameter_m, described.symmetry_fold))

    # ---- what happens

    def do(self, *events: ev.Event) -> None:
        """Do events, store them, and show them everywhere.

        Raises:
            InputError: when an event refers to something that is not there; nothing has changed then.
        """
        self._advance(events)
        self.tell()

    def accept(
        self, acts: Sequence[Mapping[str, Any]], events_of: Callable[[Mapping[str, Any]], Sequence[ev.Event]]
    ) -> str:
        """Do what a page sent, leaving out what it has sent before.

        Args:
            acts: oldest first, each with a "uid" of its own.
            events_of: the events behind an act.

        Returns:
            What is wrong with an act that could not be done, or "".
        """
        problem = ""
        repeated = [act["uid"] for act in acts if act["uid"] in self._known]
        for act in acts:
            if act["uid"] in self._known:
                continue
            self._known.add(act["uid"])
            try:
                self._advance(events_of(act), [act["uid"]])
            except InputError as error:
                problem = str(error)
                self._autosave.store(self.session, [act["uid"]])
        if repeated:
            self._autosave.store(self.session, repeated)
        self.tell()
        return problem

    def _advance(self, events: Sequence[ev.Event], tokens: Sequence[str] = ()) -> None:
        now = round(time.monotonic() - self._began, 2)
        self.session = self.session.do(*(replace(event, time_s=now) for event in events))
        self._autosave.store(self.session, tokens)

    def undo(self) -> None:
        """Take the last change back, where there is one."""
        if self.can_undo:
            self.do(ev.Undo())

    def redo(self) -> None:
        """Make the change again that was taken back."""
        if self.session.can_redo:
            self.do(ev.Redo())

    # ---- what there is

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to take back; the description that the session began with stays."""
        return self.session.can_undo and self.session.past[0] != Document()

    @property
    def document(self) -> Document:
        """What has been taught so far."""
        return self.session.document

    @property
    def unsaved(self) -> bool:
        """Whether the model on the disk lacks something of the document."""
        return bool(self.document.features) and self.document != self._saved

    @property
    def patterns(self) -> tuple[Pattern, ...]:
        """Those of the model that was built last; none once something else has been taught."""
        return self._built[1].patterns if self._built and self._built[0] == self.document else ()

    @property
    def part_name(self) -> str:
        """What the part is called, by the person or by the directory."""
        return self.document.part or load_part_name(self.directory)

    def findings(self) -> list[Finding]:
        """What follows from the marks of every feature."""
        return [self.inspector.find(feature) for feature in self.document.features]

    def colours(self) -> dict[str, str]:
        """The colour of every feature there ever was, in the order in which they were begun."""
        begun = dict.fromkeys(e.feature_id for e in self.session.events if isinstance(e, ev.AddFeature))
        return {name: PALETTE[i % len(PALETTE)] for i, name in enumerate(begun)}

    def free_id(self, prefix: str, taken: Sequence[str]) -> str:
        """An identifier that is not taken."""
        numbers = [int(t[len(prefix) :]) for t in taken if t.startswith(prefix) and t[len(prefix) :].isdigit()]
        return f"{prefix}{max(numbers, default=0) + 1}"

    # ---- who looks on

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Be told when something happened, and whether it changed what is drawn; returns how to stop that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def tell(self, *, changed: bool = True) -> None:
        """Tell all pages that something happened; what happens in one go is told once."""
        if self._loop is None:
            return
        if self._news is None:
            self._loop.call_later(TOGETHER_S, self._tell)
        self._news = changed or bool(self._news)
        if changed:
            if self._pause is not None:
                self._pause.cancel()
            self._pause = self._loop.call_later(PAUSE_S, self._refine)

    def _tell(self) -> None:
        changed, self._news = bool(self._news), None
        for listener in list(self._listeners):
            listener(changed)

    def _refine(self) -> None:
        if self.inspector.refine(self.document.features):
            self.tell()

    @property
    def pose_complaint(self) -> str:
        """How the pictures contradict the poses of the views; "" where they do not, or before that is known."""
        return self.extraction.pose_complaint

    def stored_since(self, count: int) -> list[str]:
        """The acts that are on the disk, without the first ones; pages drop them from their queues."""
        return self._stored[count:]

    def _on_stored(self, tokens: Sequence[str], problem: str) -> None:
        """In the autosave's thread."""

        def in_loop() -> None:
            self._stored.extend(tokens)
            changed, self.stored_problem = problem != self.stored_problem, problem
            if tokens or changed:
                self.tell(changed=False)

        if self._loop is not None and not self._loop.is_closed():
            self._loop.call_soon_threadsafe(in_loop)

    # ---- what is slow

    async def run(self) -> None:
        """Serve the pages: keep the overlays up to date with the document's thresholds, as long as the loop runs."""
        self._loop = asyncio.get_running_loop()
        await self.extraction.keep_up(lambda: self.document.thresholds, self.tell, lambda: self.document.diameter_m)

    @property
    def overlay_tags(self) -> dict[int, str]:
        """The overlays that are there for the document's thresholds, by number of the view."""
        return self.extraction.ready(self.document.thresholds)

    async def propose(self, on_progress: Callable[[float], object]) -> Proposal:
        """Look for thresholds with which the extractors find what was marked, in two views or more.

        Args:
            on_progress: called with the share of the search that is done.

        Raises:
            InputError: nothing was marked in two views.
        """
        complete = tuple(f for f in self.document.features if len(f.contours) >= 2)
        lesson = replace(self.document, features=complete).lesson()
        return await self.thinking.run(propose_thresholds, lesson, self.views, on_report=on_progress)

    async def build(self) -> VisionModel:
        """The model as taught.

        Raises:
            InputError: something is missing, or marks do not make a circle.
        """
        document = self.document
        document.lesson()  # says at once what is missing
        model = await self.thinking.run(build_model, self.session, self.views)
        self._built = (document, model)
        self.tell()
        return model

    async def save(self) -> None:
        """Write the model.

        Raises:
            InputError: the document is not complete, or the file cannot be written.
        """
        document = self.document
        model = await self.build()
        try:
            self.out.parent.mkdir(parents=True, exist_ok=True)
            save_model(model, self.out)
        except OSError as error:
            raise InputError(f"model {self.out}", got=error.strerror, expected="a writable file") from None
        self._saved = document
        self.tell()

    async def try_model(self, scenes: int, seed: int, on_scene: Callable[[SceneOutcome], None]) -> None:
        """Localise the part in fresh scenes with the model as taught."""
        model = await self.build()
        await self.thinking.run(run_trial, self.services, model, self.views, scenes, seed, on_report=on_scene)

    def close(self) -> None:
        """Store what is left and end the workers."""
        self._loop = None
        self._autosave.close()
        self.extraction.close()
        self.thinking.close()
