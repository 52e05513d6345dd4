"""The bore for peg-in-hole: from a circle, with a depth."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from vision.geometry.circle import Circle
from vision.teaching import events as ev
from vision.teaching.editor.fields import Fields, on_commit
from vision.teaching.editor.grasp_pose import bore_at
from vision.teaching.editor.page_context import PageContext


class BoreForm:
    """Diameter and depth, and a button that takes the chosen circle for the entry."""

    def __init__(self, page: PageContext, circle: Callable[[], Circle | None]) -> None:
        """Lay it out.

        Args:
            page: that it is on.
            circle: the one that the person has chosen.
        """
        self._page, self._circle, self._fields = page, circle, Fields()
        with ui.element("div").classes("teach-details"):
            with ui.row().classes("w-full items-center no-wrap"):
                ui.label("Bore for the peg").classes("teach-eyebrow")
                ui.space()
                take = ui.button("Take the circle", on_click=self._take).props("flat dense no-caps")
                take.classes("teach-add").tooltip("The circle chosen above is the entry of the bore")
                self._remove = ui.button(icon="delete_outline", on_click=lambda: page.do(ev.RemoveBore()))
                self._remove.props('flat round dense size=sm aria-label="Remove bore"')
            with ui.element("div").classes("teach-form") as self._numbers:
                self._diameter = ui.number("Diameter, mm").props("dense outlined")
                self._depth = ui.number("Depth, mm").props("dense outlined")
            for number in (self._diameter, self._depth):
                on_commit(number, self._apply)

    def refresh(self) -> None:
        """Show what is the case now."""
        bore = self._page.workshop.document.bore
        self._numbers.set_visibility(bore is not None)
        self._remove.set_visibility(bore is not None)
        if bore is not None:
            self._fields.show(self._diameter, round(1e3 * bore.diameter_m, 4))
            self._fields.show(self._depth, round(1e3 * bore.depth_m, 4))

    def _take(self) -> None:
        circle = self._circle()
        if circle is None:
            self._page.complain("There is no circle yet. Mark a feature in two views first.")
            return
        old = self._page.workshop.document.bore
        depth = old.depth_m if old is not None else round(circle.radius_m, 5)
        self._page.do(ev.SetBore(ev.matrix_of(bore_at(circle)), round(2 * circle.radius_m, 6), depth))

    def _apply(self) -> None:
        bore = self._page.workshop.document.bore
        if bore is None or not self._diameter.value or not self._depth.value:
            return
        diameter, depth = float(self._diameter.value) / 1e3, float(self._depth.value) / 1e3
        if max(abs(diameter - bore.diameter_m), abs(depth - bore.depth_m)) > 1e-7:
            self._page.do(ev.SetBore(bore.T_part_bore, diameter, depth))
