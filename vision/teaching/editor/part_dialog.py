"""Name, diameter and symmetry of the part."""

from __future__ import annotations

from nicegui import ui

from vision.teaching import events as ev
from vision.teaching.editor.page_context import PageContext


class PartDialog:
    """Asks what the part is."""

    def __init__(self, page: PageContext) -> None:
        """Lay it out, closed."""
        self._page = page
        with ui.dialog() as self._dialog, ui.card().classes("teach-dialog"):
            ui.label("The part").classes("teach-title")
            self._name = ui.input("Name").props("dense outlined").classes("w-full")
            self._diameter = ui.number("Outline diameter, mm", min=0.1, step=0.1, format="%.3g")
            self._diameter.props("dense outlined").classes("w-full")
            ui.label("Turned about its axis it looks the same").classes("teach-muted")
            with ui.row().classes("items-center no-wrap gap-3 w-full"):
                self._any = ui.checkbox("at every angle", on_change=self._on_any)
                self._fold = ui.number("times per turn", min=1, step=1, precision=0).props("dense outlined")
            with ui.row().classes("w-full justify-end gap-2"):
                ui.button("Cancel", on_click=self._dialog.close).props("flat no-caps")
                ui.button("Apply", on_click=self._apply).props("unelevated no-caps color=primary")

    def open(self) -> None:
        """Ask, starting from what is known."""
        document = self._page.workshop.document
        self._name.set_value(self._page.workshop.part_name)
        self._diameter.set_value(round(1e3 * document.diameter_m, 4) or None)
        self._any.set_value(document.symmetry_fold is None)
        self._fold.set_value(document.symmetry_fold or 1)
        self._on_any()
        self._dialog.open()

    def _on_any(self) -> None:
        self._fold.set_enabled(not self._any.value)

    def _apply(self) -> None:
        if not self._name.value or not self._diameter.value:
            self._page.complain("The part needs a name and a diameter.")
            return
        fold = None if self._any.value else int(self._fold.value or 1)
        if self._page.do(ev.DescribePart(self._name.value.strip(), float(self._diameter.value) / 1e3, fold)):
            self._dialog.close()
