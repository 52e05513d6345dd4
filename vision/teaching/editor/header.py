"""The bar at the top: what is taught, the steps, undo and redo, saving."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from nicegui import ui

from vision.teaching.editor.page_context import PageContext
from vision.teaching.editor.part_dialog import PartDialog


class Header:
    """The bar at the top."""

    def __init__(self, page: PageContext, tabs: Sequence[str], on_tab: Callable[[str], None]) -> None:
        """Lay it out."""
        self._page = page
        self._part_dialog = PartDialog(page)
        with ui.element("header").classes("teach-header"):
            ui.label("focalpick").classes("teach-brand")
            self._part = ui.button(on_click=self._part_dialog.open).props("flat no-caps dense").classes("teach-part")
            self._part.tooltip("Name, diameter and symmetry of the part")
            ui.space()
            with ui.tabs().props("dense no-caps inline-label") as bar:
                steps = [ui.tab(name) for name in tabs]
            bar.set_value(steps[0])
            bar.on_value_change(lambda e: on_tab(e.value))
            ui.space()
            self._stored = ui.label().classes("teach-stored")
            self._undo = self._icon("undo", "Undo (Ctrl+Z)", "undo")
            self._redo = self._icon("redo", "Redo (Ctrl+Shift+Z)", "redo")
            self._icon("keyboard", "Keyboard and mouse (?)", "help")
            self._save = ui.button("Save model", on_click=lambda: page.command("save"))
            self._save.props("unelevated no-caps dense color=primary").classes("teach-save")

    def _icon(self, icon: str, hint: str, command: str) -> ui.button:
        button = ui.button(icon=icon, on_click=lambda: self._page.command(command))
        button.props(f'flat round dense aria-label="{hint}"').tooltip(hint)
        return button

    def refresh(self) -> None:
        """Show what is the case now."""
        workshop = self._page.workshop
        document = workshop.document
        size = f"⌀ {1e3 * document.diameter_m:.1f} mm" if document.diameter_m else "size not set"
        self._part.set_text(f"{workshop.part_name}   {size}")
        self._undo.set_enabled(workshop.can_undo)
        self._redo.set_enabled(workshop.session.can_redo)
        self._stored.set_text(workshop.stored_problem or ("model not saved yet" if workshop.unsaved else ""))
        self._stored.classes(
            toggle=None,
            add="is-bad" if workshop.stored_problem else "",
            remove="" if workshop.stored_problem else "is-bad",
        )
        self._save.set_enabled(bool(document.features))

    def saving(self, busy: bool) -> None:
        """Show that the model is being built."""
        self._save.props(add="loading" if busy else "", remove="" if busy else "loading")
