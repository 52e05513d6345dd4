"""What `?` shows. ``static/shortcuts.js`` has the keys themselves."""

from __future__ import annotations

from nicegui import ui

SHORTCUTS = {
    "Pictures": (
        ("PgDn  PgUp", "next, previous view (also ] and [)"),
        ("+  -  wheel", "zoom"),
        ("0", "whole picture"),
        ("Space + drag", "pan (also the middle button, the arrow keys)"),
        ("1  2  3", "regions, groups, edges"),
        ("4  5  6", "taught circles, guides, patterns"),
        ("L", "magnifier"),
    ),
    "Marking": (
        ("V", "pick what an extractor found"),
        ("P", "click points along the contour, five or more"),
        ("drag", "move a point"),
        ("right click", "delete a point"),
        ("Del", "delete the point under the pointer, or the last one"),
        ("C", "keyboard cursor: arrows move it by a pixel, with Shift by ten"),
        ("Enter", "click at the keyboard cursor"),
    ),
    "Features": (
        ("N", "new feature"),
        ("J  K", "next, previous feature"),
    ),
    "Everything": (
        ("Ctrl+Z", "undo"),
        ("Ctrl+Shift+Z", "redo (also Ctrl+Y)"),
        ("Ctrl+S", "save the model"),
        ("Esc", "leave what was begun"),
        ("?", "this list"),
    ),
}


def shortcuts_dialog() -> ui.dialog:
    """A dialog that lists the keys."""
    with ui.dialog() as dialog, ui.card().classes("teach-help"):
        with ui.row().classes("w-full items-center no-wrap"):
            ui.label("Keyboard and mouse").classes("teach-title")
            ui.space()
            ui.button(icon="close", on_click=dialog.close).props("flat round dense aria-label=Close")
        with ui.element("div").classes("teach-help-grid"):
            for title, entries in SHORTCUTS.items():
                with ui.column().classes("gap-1"):
                    ui.label(title).classes("teach-eyebrow")
                    for keys, meaning in entries:
                        with ui.row().classes("no-wrap items-baseline gap-3"):
                            ui.label(keys).classes("teach-keys")
                            ui.label(meaning).classes("teach-muted")
    return dialog
