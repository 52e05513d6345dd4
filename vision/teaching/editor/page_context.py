"""What a panel may know of the page that it stands on: so panels need not know the page, which knows them all."""

from __future__ import annotations

from typing import Protocol

from vision.teaching import events as ev
from vision.teaching.editor.findings import Finding
from vision.teaching.editor.workshop import Workshop


class PageContext(Protocol):
    """The page as its panels see it; `vision.teaching.editor.page.Page` is one.

    Attributes:
        workshop: shared by all open pages.
        view: number of the view on the stage.
        feature: name of the chosen feature, None where there is none.
    """

    workshop: Workshop
    view: int
    feature: str | None

    def do(self, *events: ev.Event) -> bool:
        """Do events; complains, and says False, where that is not possible."""

    def complain(self, message: str) -> None:
        """Say what is wrong."""

    def command(self, command: str) -> None:
        """Do what a key or a button means."""

    def choose(self, feature_id: str | None) -> None:
        """Turn to a feature."""

    def look(self, view: int) -> None:
        """Show a view on the stage."""

    def finding(self) -> Finding | None:
        """What follows from the marks of the chosen feature."""
