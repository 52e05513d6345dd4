"""Only what Numba compiles goes without types: mypy asks for them elsewhere, this test also in rooms with kernels."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

VISION = Path(__file__).resolve().parents[1] / "vision"


def untyped(source: str) -> list[str]:
    """Names of the functions of a file that are neither compiled nor typed throughout."""
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    return [f.name for f in functions if not _is_compiled(f) and not _is_typed(f)]


def _is_compiled(function: ast.FunctionDef) -> bool:
    called = [d.func if isinstance(d, ast.Call) else d for d in function.decorator_list]
    return any(isinstance(name, ast.Name) and name.id == "njit" for name in called)


def _is_typed(function: ast.FunctionDef) -> bool:
    given = function.args
    arguments = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    asked = [a for a in arguments if a.arg not in ("self", "cls")]
    return function.returns is not None and all(a.annotation is not None for a in asked)


@pytest.mark.parametrize("path", sorted(p.relative_to(VISION).as_posix() for p in VISION.rglob("*.py")))
def test_whatever_is_not_compiled_has_types(path):
    assert untyped((VISION / path).read_text(encoding="utf-8")) == []


def test_a_function_without_types_is_found():
    source = "@njit(cache=True)\ndef a(x): ...\n@njit\ndef b(x): ...\ndef c(x) -> None: ...\ndef d(*, x: int): ..."
    assert untyped(source) == ["c", "d"]
