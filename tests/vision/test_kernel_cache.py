import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from vision import kernel_cache
from vision.kernel_cache import digest


def test_the_digest_changes_with_every_source_file(tmp_path):
    (tmp_path / "a.py").write_text("one = 1\n")
    (tmp_path / "b.py").write_text("two = 2\n")
    before = digest(tmp_path)
    assert digest(tmp_path) == before
    (tmp_path / "b.py").write_text("two = 3\n")
    changed = digest(tmp_path)
    assert changed != before
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "a.py").write_text("one = 1\n")
    nested = digest(tmp_path)
    assert nested != changed
    (tmp_path / "room" / "a.py").write_text("one = 2\n")
    assert digest(tmp_path) != nested


def cache_directory(**environment):
    base = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    code = "import vision, os; print(os.environ['NUMBA_CACHE_DIR'])"
    done = subprocess.run(
        [sys.executable, "-c", code], env=base | environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_kernels_are_kept_apart_by_their_sources_wherever_they_are_kept(tmp_path):
    assert Path(cache_directory()).name.startswith("kernels-")
    inside = Path(cache_directory(NUMBA_CACHE_DIR=str(tmp_path)))
    assert inside.parent == tmp_path
    assert inside.name == Path(cache_directory()).name


def test_a_child_process_keeps_its_parents_folder(tmp_path):
    parents = cache_directory(NUMBA_CACHE_DIR=str(tmp_path))
    assert cache_directory(NUMBA_CACHE_DIR=parents) == parents


@pytest.mark.parametrize("home", ["", "/proc/no/such/home"])
def test_without_a_place_to_write_kernels_go_to_a_temporary_folder(home, tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_cache, "__file__", "/proc/no/such/package/kernel_cache.py")
    monkeypatch.setattr(kernel_cache.tempfile, "gettempdir", lambda: str(tmp_path))
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", home)
    monkeypatch.setattr(kernel_cache, "sys", SimpleNamespace(modules={}))
    kernel_cache.settle()
    assert Path(os.environ["NUMBA_CACHE_DIR"]).is_relative_to(tmp_path)


def test_numba_may_be_imported_before():
    code = "import numba, vision; print(numba.config.CACHE_DIR)"
    base = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run([sys.executable, "-c", code], env=base, capture_output=True, text=True, check=True)
    assert "kernels-" in done.stdout
