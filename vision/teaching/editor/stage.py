"""The stage as an element of the page; ``stage.js`` draws it in the browser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments

from vision.geometry.camera import View

Handler = Callable[[dict[str, Any]], Any]


class Stage(ui.element, component="stage.js", esm={"focalpick-stage": "static"}):
    """Thumbnails, one large picture with zoom and pan, overlays and clicks."""

    def __init__(self, lesson: str, views: Sequence[View], view: int, handlers: dict[str, Handler]) -> None:
        """Lay it out.

        Args:
            lesson: names the lesson, for what the browser keeps of it.
            views: shown under the address ``picture/NUMBER.png``.
            view: which one is large at first.
            handlers: by event: "ready", "acts" (actions to be stored), "look" (another view), "preview" (points being
                dragged) and "command" (a key that means something elsewhere on the page).
        """
        super().__init__()
        self._props["lesson"] = lesson
        self._props["pictures"] = [
            {"name": v.name, "url": f"picture/{n}.png", "width": v.camera.width_px, "height": v.camera.height_px}
            for n, v in enumerate(views)
        ]
        self._props["start"] = {"view": view}
        for name, handler in handlers.items():
            self.on(name, _unpacked(handler))

    def patch(self, **message: Any) -> None:
        """Send what changed: ``changes``, ``feature``, ``guide``, ``overlays``, ``stored``, ``status`` and others."""
        self.run_method("patch", message)

    def look(self, view: int) -> None:
        """Show a view."""
        self.run_method("look", view)


def _unpacked(handler: Handler) -> Callable[[GenericEventArguments], Any]:
    return lambda event: handler(event.args)
