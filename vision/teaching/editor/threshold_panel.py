"""Thresholds of the extractors: by hand, or proposed so that they find what the person marked."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING

from nicegui import background_tasks, ui

from vision.errors import FocalpickError
from vision.extraction import ExtractionThresholds
from vision.teaching import events as ev
from vision.teaching.editor.fields import Fields, on_commit
from vision.teaching.editor.page_context import PageContext
from vision.teaching.editor.workers import StoppedError

if TYPE_CHECKING:
    from vision.teaching.threshold_search import Proposal

MEANINGS = {
    "canny_low": ("Canny, lower", "Region growing: edges are followed down to this slope, grey levels per pixel"),
    "canny_high": ("Canny, upper", "Region growing: edges begin at this slope, grey levels per pixel"),
    "homogeneity": ("Homogeneity", "Region growing: largest deviation of the grey level within a block"),
    "boundary_error_px": ("Boundary error, px", "Region growing: how far a boundary may be from its ellipse"),
    "noise_factor": ("Edge over noise", "Edge grouping: edges begin at this many times the noise of the picture"),
    "shortest_fragment_px": ("Shortest fragment, px", "Edge grouping: shorter pieces of contour are dropped"),
    "fitting_error_px": ("Fitting error, px", "Edge grouping: how far edges may be from their ellipse"),
}

EXTRACTORS = {"region": "Region growing", "group": "Edge grouping"}


class ThresholdPanel:
    """A table of thresholds, and what the extractors find with the present and the proposed ones."""

    def __init__(self, page: PageContext) -> None:
        """Lay it out."""
        self._page = page
        self._fields = Fields()
        self._proposal: Proposal | None = None
        self._busy = False
        with ui.element("div").classes("teach-sheet"), ui.element("div").classes("teach-sheet-narrow"):
            with ui.row().classes("w-full items-center no-wrap gap-3"):
                self._propose = ui.button("Propose", icon="auto_fix_high", on_click=self._start)
                self._propose.props("unelevated no-caps color=primary")
                self._accept = ui.button("Accept the proposal", icon="check", on_click=self._take)
                self._accept.props("outline no-caps")
                self._reset = ui.button("Back to the usual ones", on_click=self._back).props("flat no-caps")
                self._reset.classes("teach-quiet")
                ui.space()
                self._state = ui.label().classes("teach-muted")
            ui.label(
                "The extractors run with these on the taught pictures and, later, in the bin. "
                "A proposal looks for the ones with which they find what you marked."
            ).classes("teach-muted")
            self._progress = ui.linear_progress(0, show_value=False, size="3px")
            self._numbers, self._proposed = self._table()
            self._effect = ui.element("div").classes("teach-effect")

    def _table(self) -> tuple[dict[str, ui.number], dict[str, ui.label]]:
        numbers, proposed = {}, {}
        with ui.element("div").classes("teach-table teach-thresholds"):
            for title in ("Threshold", "Usual", "Now", "Proposed"):
                ui.label(title).classes("teach-eyebrow")
            usual = asdict(ExtractionThresholds())
            for name, (title, meaning) in MEANINGS.items():
                with ui.column().classes("gap-0"):
                    ui.label(title)
                    ui.label(meaning).classes("teach-muted")
                ui.label(f"{usual[name]:g}").classes("teach-number teach-muted")
                numbers[name] = ui.number(min=0).props(f'dense outlined aria-label="{title}"')
                on_commit(numbers[name], self._apply)
                proposed[name] = ui.label("–").classes("teach-number")
        return numbers, proposed

    def refresh(self) -> None:
        """Show what is the case now."""
        thresholds = self._page.workshop.document.thresholds
        for name, value in asdict(thresholds).items():
            self._fields.show(self._numbers[name], round(value, 6))
        self._progress.set_visibility(self._busy)
        self._propose.set_enabled(not self._busy and self._can_propose())
        self._accept.set_enabled(self._proposal is not None and self._proposal.thresholds != thresholds)
        self._reset.set_enabled(thresholds != ExtractionThresholds())
        if not self._busy:
            self._state.set_text("" if self._can_propose() else "Mark at least one feature in two views first.")

    def _can_propose(self) -> bool:
        return any(finding.circle is not None for finding in self._page.workshop.findings())

    def _apply(self) -> None:
        values = {name: number.value for name, number in self._numbers.items()}
        thresholds = self._page.workshop.document.thresholds
        if None in values.values():
            return
        changes = {name: float(v) for name, v in values.items() if abs(v - getattr(thresholds, name)) > 1e-6}
        if not changes:
            return
        try:
            self._page.do(ev.SetThresholds(replace(thresholds, **changes)))
        except FocalpickError as error:
            self._page.complain(str(error))

    def _back(self) -> None:
        self._page.do(ev.SetThresholds(ExtractionThresholds()))

    def _take(self) -> None:
        if self._proposal is not None:
            self._page.do(ev.SetThresholds(self._proposal.thresholds))

    def _start(self) -> None:
        background_tasks.create(self._search(), context=ui.context.client)

    async def _search(self) -> None:
        self._busy = True
        self._state.set_text("looking for thresholds …")
        self._progress.set_value(0.0)
        self._propose.props("loading")
        self.refresh()
        try:
            self._proposal = await self._page.workshop.propose(self._progress.set_value)
            self._show(self._proposal)
        except StoppedError:
            pass
        except FocalpickError as error:
            self._page.complain(str(error))
        finally:
            self._busy = False
            self._propose.props(remove="loading")
            self.refresh()

    def _show(self, proposal: Proposal) -> None:
        """The proposed values, and what they change."""
        now = asdict(self._page.workshop.document.thresholds)
        for name, value in asdict(proposal.thresholds).items():
            self._proposed[name].set_text(f"{value:g}")
            same = abs(value - now[name]) < 1e-9
            self._proposed[name].classes(remove="is-new teach-muted").classes("teach-muted" if same else "is-new")
        self._effect.clear()
        with self._effect, ui.element("div").classes("teach-table teach-before-after"):
            for title in ("Feature", "Extractor", "Found before", "Found after"):
                ui.label(title).classes("teach-eyebrow")
            for feature in dict.fromkeys(f.feature for f in proposal.changes):
                mine = [f for f in proposal.changes if f.feature == feature]
                self._row(feature, EXTRACTORS[mine[0].extractor], [f.before for f in mine], [f.after for f in mine])
            ui.label("Ellipses of salient size that nobody marked").classes("teach-muted")
            ui.label()
            ui.label(str(proposal.before.spurious)).classes("teach-number teach-muted")
            ui.label(str(proposal.after.spurious)).classes("teach-number teach-muted")

    def _row(self, feature: str, extractor: str, before: list[bool], after: list[bool]) -> None:
        ui.label(feature)
        ui.label(extractor).classes("teach-muted")
        ui.label(f"{sum(before)} of {len(before)} views").classes("teach-number")
        changed = {1: "is-good", 0: "", -1: "is-worse"}[(sum(after) > sum(before)) - (sum(after) < sum(before))]
        ui.label(f"{sum(after)} of {len(after)} views").classes(f"teach-number {changed}")
