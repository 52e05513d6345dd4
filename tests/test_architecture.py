"""docs/architecture.md names the rooms that there are."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
NAMED = set(re.findall(r"`((?:vision|robot|benchmark)(?:/[a-z_]+(?:\.py)?)*)`", TEXT))
ROOMS = {
    path.relative_to(ROOT).as_posix()
    for package in ("vision", "benchmark")
    for path in (ROOT / package).iterdir()
    if path.is_dir() and path.name != "__pycache__"
} | {"robot"}


@pytest.mark.parametrize("name", sorted(NAMED))
def test_every_room_that_the_page_names_exists(name):
    assert (ROOT / name).exists()


def test_the_page_has_a_row_for_every_room():
    rows = set(re.findall(r"^\| `([a-z_/]+)` \|", TEXT, flags=re.MULTILINE))
    assert rows == ROOMS
