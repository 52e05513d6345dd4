"""One open page: the pictures, the panels beside them, and what goes on between them and the workshop."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nicegui import background_tasks, ui

from vision.errors import FocalpickError
from vision.teaching import events as ev
from vision.teaching.editor.browser_events import event_of_act
from vision.teaching.editor.drawing_state import State, difference, drawing_state, ellipse_numbers, guide
from vision.teaching.editor.feature_panel import FeaturePanel
from vision.teaching.editor.findings import Finding
from vision.teaching.editor.grasp_panel import GraspPanel
from vision.teaching.editor.header import Header
from vision.teaching.editor.shortcuts import shortcuts_dialog
from vision.teaching.editor.stage import Stage
from vision.teaching.editor.threshold_panel import ThresholdPanel
from vision.teaching.editor.trial_panel import TrialPanel
from vision.teaching.editor.workshop import Workshop

STYLE = Path(__file__).parent / "static" / "style.css"
AFTER_S = 0.005
TABS = ("Mark", "Grasp", "Thresholds", "Try it")


class Page:
    """What one browser tab shows. All tabs work on the same workshop."""

    def __init__(self, workshop: Workshop) -> None:
        """Build the page in the current client."""
        self.workshop = workshop
        self.view, self.feature = workshop.last_seen
        self._drawn: State = {}
        self._acknowledged = 0
        self._panels_wait = False
        self._ready = False
        self._warned = False
        self._client = ui.context.client
        self._build()
        self._client.on_delete(workshop.listen(self._on_news))
        self.refresh()

    # ---- layout

    def _build(self) -> None:
        ui.colors(primary="#2b7fa6", positive="#2f9e54", negative="#c94a4a", warning="#a8781c", dark="#141a22")
        ui.add_css(STYLE.read_text(encoding="utf-8"))
        ui.query(".nicegui-content").classes("teach")
        self._help = shortcuts_dialog()
        self._header = Header(self, TABS, self._show)
        self._panes = {name: ui.element("main").classes("teach-pane") for name in TABS}
        with self._panes["Mark"]:
            handlers = {
                "ready": self._on_ready,
                "acts": self._on_acts,
                "look": self._on_look,
                "preview": self._on_preview,
                "command": lambda message: self.command(message["command"]),
            }
            name = str(self.workshop.directory.resolve())
            self.stage = Stage(name, self.workshop.views, self.view, handlers).classes("teach-stage")
            self._features = FeaturePanel(self)
        with self._panes["Grasp"]:
            self._grasps = GraspPanel(self)
        with self._panes["Thresholds"]:
            self._thresholds = ThresholdPanel(self)
        with self._panes["Try it"]:
            self._trial = TrialPanel(self)
        self._show(TABS[0])

    def _show(self, tab: str) -> None:
        for name, pane in self._panes.items():
            pane.set_visibility(name == tab)
        self._tab = tab
        self._refresh_tab()
        if tab == "Grasp":
            self._grasps.appear()

    # ---- from the browser

    def _on_ready(self, _: dict[str, Any]) -> None:
        self._drawn, self._acknowledged = {}, 0
        self._ready = True
        self.refresh()

    def _on_acts(self, message: dict[str, Any]) -> None:
        problem = self.workshop.accept(message["acts"], self._events_of)
        if problem:
            self.complain(problem)

    def _events_of(self, act: Mapping[str, Any]) -> Sequence[ev.Event]:
        """The events of an act; one on no feature at all begins the first."""
        name = act["feature"] or self.feature
        if name is not None:
            return [event_of_act(act, name)]
        added = self.new_feature_event()
        self.feature = added.feature_id
        return [added, event_of_act(act, added.feature_id)]

    def _on_look(self, message: dict[str, Any]) -> None:
        self.view = message["view"]
        self._remember()
        self._send()
        self._features.refresh()

    def _on_preview(self, message: dict[str, Any]) -> None:
        mark = self.workshop.inspector.mark(message["view"], [(x, y) for x, y in message["points"]])
        ellipse = ellipse_numbers(mark.ellipse) if mark.ellipse is not None else None
        text = f"residual {mark.residual_px:.2f} px" if mark.ellipse is not None else mark.problem
        self.stage.patch(preview={"turn": message["turn"], "ellipse": ellipse, "text": text})

    def command(self, command: str) -> None:
        """Do what a key or a button means."""
        {
            "undo": self.workshop.undo,
            "redo": self.workshop.redo,
            "save": self.save,
            "help": self._help.open,
            "feature:new": self.add_feature,
            "feature:next": lambda: self._step(1),
            "feature:previous": lambda: self._step(-1),
        }[command]()

    # ---- features

    def new_feature_event(self) -> ev.AddFeature:
        """Begin a feature with a name that says little; the person knows better ones."""
        features = self.workshop.document.features
        feature_id = self.workshop.free_id("f", [f.feature_id for f in features])
        return ev.AddFeature(feature_id, f"circle {feature_id[1:]}", "salient")

    def add_feature(self) -> None:
        """Begin a new feature and turn to it."""
        added = self.new_feature_event()
        self.feature = added.feature_id
        self._remember()
        self.workshop.do(added)

    def choose(self, feature_id: str | None) -> None:
        """Turn to a feature."""
        self.feature = feature_id
        self._remember()
        self.refresh()

    def _remember(self) -> None:
        self.workshop.last_seen = (self.view, self.feature)

    def _step(self, step: int) -> None:
        names = [f.feature_id for f in self.workshop.document.features]
        if names:
            at = names.index(self.feature) + step if self.feature in names else 0
            self.choose(names[at % len(names)])

    def look(self, view: int) -> None:
        """Show a view on the stage."""
        self.stage.look(view)

    def finding(self) -> Finding | None:
        """What follows from the marks of the chosen feature."""
        for feature in self.workshop.document.features:
            if feature.feature_id == self.feature:
                return self.workshop.inspector.find(feature)
        return None

    # ---- to the browser

    def _on_news(self, changed: bool) -> None:
        """Something happened in the workshop, perhaps through another tab."""
        with self._client:
            if changed:
                self.refresh()
            else:
                self._header.refresh()
                self._acknowledge()

    def _acknowledge(self) -> None:
        """Tell the browser which of its acts are on the disk."""
        stored = self.workshop.stored_since(self._acknowledged)
        if self._ready and stored:
            self._acknowledged += len(stored)
            self.stage.patch(stored=stored)

    def refresh(self) -> None:
        """Show what the workshop holds now."""
        names = [f.feature_id for f in self.workshop.document.features]
        if self.feature not in names:
            self.feature = names[-1] if names else None
        self._send()
        if not self._panels_wait:
            self._panels_wait = True
            asyncio.get_running_loop().call_later(AFTER_S, self._refresh_panels)

    def _refresh_panels(self) -> None:
        """What is beside the picture follows when the answer to the click is on its way."""
        self._panels_wait = False
        if self._client.is_deleted:
            return
        with self._client:
            self._header.refresh()
            self._features.refresh()
            self._refresh_tab()
            self._warn()

    def _refresh_tab(self) -> None:
        """The panes that are out of sight wait until they are seen."""
        match self._tab:
            case "Grasp":
                self._grasps.refresh()
            case "Thresholds":
                self._thresholds.refresh()
            case "Try it":
                self._trial.refresh()

    def _send(self) -> None:
        if not self._ready:
            return
        findings = self.workshop.findings()
        workshop = self.workshop
        state = drawing_state(findings, workshop.colours(), workshop.inspector, workshop.patterns)
        changes, self._drawn = difference(self._drawn, state), state
        finding = self.finding()
        shown = (
            guide(finding, self.view, findings, self.workshop.views, self.workshop.document.diameter_m)
            if finding
            else None
        )
        self.stage.patch(
            changes=changes,
            feature=self.feature,
            guide=shown,
            overlays=self.workshop.overlay_tags,
            status=self._status(finding),
            unsaved=self.workshop.unsaved,
        )
        self._acknowledge()

    def _status(self, finding: Finding | None) -> str:
        """What to do next, in a line under the picture."""
        if finding is None:
            return "Press N to begin a feature, then click five points along its contour, or V to pick an ellipse."
        mark = finding.marks.get(self.view)
        if mark is None:
            return f"{finding.feature.name} is not marked here."
        if mark.ellipse is None:
            return mark.problem or f"{len(mark.points)} of 5 points."
        how = (
            f"snapped to {len(mark.edge_points)} edge points"
            if mark.snapped and mark.edge_points is not None
            else "through the points; no clear edge here"
        )
        return f"Ellipse {how}, residual {mark.residual_px:.2f} px."

    # ---- the rest

    def do(self, *events: ev.Event) -> bool:
        """Do events of a panel; complains, and says False, where that is not possible."""
        try:
            self.workshop.do(*events)
        except FocalpickError as error:
            self.complain(str(error))
            return False
        return True

    def save(self) -> None:
        """Build the model and write it, without keeping the person waiting."""
        background_tasks.create(self._save(), context=ui.context.client)

    async def _save(self) -> None:
        self._header.saving(True)
        try:
            await self.workshop.save()
        except FocalpickError as error:
            self.complain(str(error))
        else:
            ui.notify(f"Saved as {self.workshop.out}", type="positive", position="bottom")
        finally:
            self._header.saving(False)

    def _warn(self) -> None:
        """Say once what makes all teaching vain."""
        if self.workshop.pose_complaint and not self._warned:
            self._warned = True
            self.complain(f"Warning: {self.workshop.pose_complaint}")

    def complain(self, message: str) -> None:
        """Say what is wrong."""
        ui.notify(message, type="warning", position="bottom", multi_line=True, timeout=7000, close_button="OK")
