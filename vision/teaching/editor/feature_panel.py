"""The features of the part: a list, and everything about the chosen one."""

from __future__ import annotations

from nicegui import ui

from vision.teaching.editor.feature_details import FeatureDetails
from vision.teaching.editor.findings import Finding
from vision.teaching.editor.page_context import PageContext


class FeaturePanel:
    """The column on the right of the pictures."""

    def __init__(self, page: PageContext) -> None:
        """Lay it out."""
        self._page = page
        self._shown: list[tuple[object, ...]] = []
        with ui.element("aside").classes("teach-side"):
            with ui.row().classes("w-full items-center no-wrap"):
                ui.label("Features").classes("teach-eyebrow")
                ui.space()
                add = ui.button("New", icon="add", on_click=lambda: page.command("feature:new"))
                add.props("flat dense no-caps").classes("teach-add").tooltip("New feature (N)")
            self._rows = ui.element("div").classes("teach-features keeps-arrows")
            self._rows.props('role=listbox tabindex=0 aria-label="Features"')
            self._rows.on("keydown.down.prevent", lambda: page.command("feature:next"))
            self._rows.on("keydown.up.prevent", lambda: page.command("feature:previous"))
            self._details = FeatureDetails(page)

    def refresh(self) -> None:
        """Show what is the case now; rows are made again only when something in them has changed."""
        findings = self._page.workshop.findings()
        shown = [self._row_key(finding) for finding in findings]
        if shown != self._shown or not findings:
            self._shown = shown
            self._rows.clear()
            colours = self._page.workshop.colours()
            with self._rows:
                for finding in findings:
                    self._row(finding, colours[finding.feature.feature_id])
                if not findings:
                    ui.label("None yet. Press N, or click on a contour.").classes("teach-muted teach-none")
        self._details.refresh(self._page.finding())

    def _row_key(self, finding: Finding) -> tuple[object, ...]:
        feature = finding.feature
        chosen = feature.feature_id == self._page.feature
        shown = (feature.name, feature.role, feature.copies, len(feature.contours))
        return (feature.feature_id, *shown, chosen, *_state(finding))

    def _row(self, finding: Finding, colour: str) -> None:
        feature = finding.feature
        chosen = feature.feature_id == self._page.feature
        icon, kind, hint = _state(finding)
        row = ui.element("div").classes("teach-feature" + (" is-chosen" if chosen else ""))
        row.props(f"role=option aria-selected={'true' if chosen else 'false'}")
        row.on("click", lambda: self._page.choose(feature.feature_id))
        with row:
            ui.element("span").classes("teach-swatch").style(f"background: {colour}")
            ui.label(feature.name).classes("teach-feature-name")
            if feature.copies > 1:
                ui.label(f"× {feature.copies}").classes("teach-muted")
            if feature.role == "supporting":
                ui.label("supporting").classes("teach-chip")
            ui.label(str(len(feature.contours))).classes("teach-count").tooltip("views with an ellipse")
            ui.icon(icon).classes(f"teach-state {kind}").tooltip(hint)


def _state(finding: Finding) -> tuple[str, str, str]:
    """An icon, its class, and a few words."""
    if finding.trouble:
        return "error_outline", "is-bad", finding.message
    if finding.circle is not None:
        return "check_circle_outline", "is-good", "its circle is known"
    return "radio_button_unchecked", "is-open", "mark it in two views"
