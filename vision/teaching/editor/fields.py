"""Fields that show the document without taking a half-typed value away."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from nicegui import ui
from nicegui.elements.mixins.value_element import ValueElement
from nicegui.events import GenericEventArguments

F = TypeVar("F", bound=ValueElement)


def on_commit(field: F, handler: Callable[[], object]) -> F:
    """Call a handler when the person has finished with a field: Enter leaves it, so that keys are shortcuts again.

    What the field says then is taken from the browser: a letter that is typed while the page sends the field another
    value is in the field, but is not reported by itself.
    """

    def commit(event: GenericEventArguments) -> None:
        field.set_value(_value_of(field, str(event.args)))
        handler()

    field.on("blur", commit, js_handler="(event) => emit(event.target.value)")
    return field.on("keydown.enter", js_handler="(event) => event.target.blur()")


def _value_of(field: ValueElement, text: str) -> str | float | None:
    if not isinstance(field, ui.number):
        return text
    try:
        return float(text)
    except ValueError:
        return None


class Fields:
    """Sets the values of fields, each only when the document has another one than it was last shown."""

    def __init__(self) -> None:
        """Nothing has been shown."""
        self._shown: dict[int, tuple[object, Any]] = {}

    def show(self, field: ValueElement, value: Any, owner: object = None) -> None:
        """Show a value of the document.

        Args:
            field: in which to show it.
            value: of the document.
            owner: whose value it is; that of another owner is shown in any case.
        """
        if self._shown.get(field.id) != (owner, value):
            self._shown[field.id] = (owner, value)
            field.set_value(value)
