"""Fields that show the document without taking a half-typed value away."""

from __future__ import annotations

from typing import Any

from nicegui.elements.mixins.value_element import ValueElement


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
