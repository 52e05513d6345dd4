"""Everything about the chosen feature, and what can be changed about it."""

from __future__ import annotations

import numpy as np
from nicegui import ui

from vision.teaching import events as ev
from vision.teaching.editor.extractor_choice import how_often_found
from vision.teaching.editor.fields import Fields, on_commit
from vision.teaching.editor.findings import Finding
from vision.teaching.editor.page_context import PageContext

ROLES = {"salient": "Salient", "supporting": "Supporting"}
EXTRACTORS = {"": "Propose", "region": "Regions", "group": "Groups"}


class FeatureDetails:
    """The lower part of the column on the right."""

    def __init__(self, page: PageContext) -> None:
        """Lay it out."""
        self._page = page
        self._residual_rows: list[tuple[object, ...]] = []
        self._fields = Fields()
        self._found_key: tuple[object, object] | None = None
        with ui.element("div").classes("teach-details") as self._box:
            self._message = ui.label().classes("teach-message").props("role=alert")
            self._name = ui.input("Name").props("dense outlined").classes("w-full")
            on_commit(self._name, self._rename)
            with ui.row().classes("w-full no-wrap items-center gap-2"):
                self._role = ui.toggle(ROLES, on_change=self._set_role).props("dense no-caps unelevated spread")
                self._role.tooltip("Salient features find the part; supporting ones confirm it").classes("grow")
                self._copies = ui.number("Copies", min=1, step=1, precision=0).props("dense outlined")
                self._copies.classes("teach-copies").tooltip("How many of them are evenly spaced around the axis")
                on_commit(self._copies, self._set_copies)
            with ui.column().classes("w-full gap-1"):
                ui.label("Extractor to be tried first").classes("teach-muted")
                self._extractor = ui.toggle(EXTRACTORS, on_change=self._set_extractor)
                self._extractor.props("dense no-caps unelevated spread").classes("w-full")
                self._found = ui.label().classes("teach-muted")
            self._circle = ui.element("div").classes("teach-circle")
            self._residuals = ui.element("div").classes("teach-residuals")
            with ui.row().classes("w-full no-wrap gap-2"):
                self._clear = ui.button("Clear this view", on_click=self._clear_view)
                self._remove = ui.button("Remove feature", on_click=self._remove_feature)
                for button in (self._clear, self._remove):
                    button.props("outline dense no-caps").classes("grow teach-quiet")

    def refresh(self, finding: Finding | None) -> None:
        """Show a feature, or nothing."""
        self._finding = finding
        self._box.set_visibility(finding is not None)
        if finding is None:
            return
        feature = finding.feature
        self._message.set_text(finding.message)
        self._message.set_visibility(finding.trouble)
        self._fields.show(self._name, feature.name, feature.feature_id)
        self._fields.show(self._copies, feature.copies, feature.feature_id)
        self._role.set_value(feature.role)
        self._copies.set_visibility(feature.role == "supporting" or feature.copies > 1)
        self._extractor.set_value(feature.extractor or "")
        self._found.set_text(self._found_text(finding))
        self._clear.set_enabled(self._page.view in feature.marks)
        self._show_circle(finding)
        self._show_residuals(finding)

    def _found_text(self, finding: Finding) -> str:
        workshop = self._page.workshop
        tags = workshop.overlay_tags
        key = (finding.solution, tuple(tags.items()))
        if self._found_key is not None and self._found_key[0] is key[0] and self._found_key[1] == key[1]:
            return self._found.text
        self._found_key = key
        candidates = {v: workshop.extraction.overlay(tag, v) for v, tag in tags.items()}
        counts = how_often_found(finding, workshop.inspector, candidates)
        if counts is None:
            return "Known when the circle is."
        proposal = "groups" if counts["group"] > counts["region"] else "regions"
        found = f"Regions found it in {counts['region']}, groups in {counts['group']} of {counts['views']} views"
        return f"{found}: {proposal}."

    def _show_circle(self, finding: Finding) -> None:
        self._circle.clear()
        solution = finding.solution
        if solution is None:
            return
        circle = solution.circle
        x, y, z = 1e3 * circle.centre
        tilt = np.degrees(np.arccos(min(abs(circle.normal[2]), 1.0)))
        values = (
            ("Diameter", f"{2e3 * circle.radius_m:.3f}", f"± {2e3 * solution.radius_sigma_m:.3f} mm"),
            ("Height z", f"{z:.3f}", f"± {1e3 * solution.centre_sigma_m:.3f} mm"),
            ("Off axis", f"{np.hypot(x, y):.3f}", "mm"),
            ("Tilt", f"{tilt:.2f}", f"± {np.degrees(solution.normal_sigma_rad):.2f}°"),
        )
        with self._circle:
            for name, value, unit in values:
                ui.label(name).classes("teach-muted")
                ui.label(value).classes("teach-number")
                ui.label(unit).classes("teach-muted")

    def _show_residuals(self, finding: Finding) -> None:
        views = self._page.workshop.views
        bad = {v for v, mark in finding.marks.items() if mark.suspects or v in finding.inconsistent}
        rows = [(v, views[v].name, self._residual(finding, v), v in bad) for v in finding.marks]
        key: list[tuple[object, ...]] = [(*row, self._page.view == row[0]) for row in rows]
        if key == self._residual_rows:
            return
        self._residual_rows = key
        self._residuals.clear()
        with self._residuals:
            for v, name, residual, wrong in rows:
                row = ui.element("div").classes("teach-residual")
                row.classes(add=("is-bad " if wrong else "") + ("is-here" if v == self._page.view else ""))
                row.on("click", lambda v=v: self._page.look(v))
                with row:
                    ui.label(name)
                    ui.label(residual).classes("teach-number")

    def _residual(self, finding: Finding, view: int) -> str:
        error, mark = finding.errors.get(view), finding.marks[view]
        if error is not None:
            return f"{error.rms_px:.2f} px   {error.rms_mm:.3f} mm"
        return f"{mark.residual_px:.2f} px" if mark.ellipse is not None else f"{len(mark.points)} of 5 points"

    # ---- changes

    def _rename(self) -> None:
        name = (self._name.value or "").strip()
        if self._finding and name and name != self._finding.feature.name:
            self._page.do(ev.RenameFeature(self._finding.feature.feature_id, name))

    def _set_role(self) -> None:
        if self._finding and self._role.value != self._finding.feature.role:
            self._page.do(ev.SetRole(self._finding.feature.feature_id, self._role.value))

    def _set_copies(self) -> None:
        if self._finding and self._copies.value and int(self._copies.value) != self._finding.feature.copies:
            self._page.do(ev.SetCopies(self._finding.feature.feature_id, int(self._copies.value)))

    def _set_extractor(self) -> None:
        chosen = self._extractor.value or None
        if self._finding and chosen != self._finding.feature.extractor:
            self._page.do(ev.SetExtractor(self._finding.feature.feature_id, chosen))

    def _clear_view(self) -> None:
        if self._finding:
            self._page.do(ev.ClearMarks(self._finding.feature.feature_id, self._page.view))

    def _remove_feature(self) -> None:
        if self._finding:
            self._page.do(ev.RemoveFeature(self._finding.feature.feature_id))
