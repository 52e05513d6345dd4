import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from vision import kernel_cache
from vision.errors import ResourceError
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


@pytest.fixture
def nowhere_to_write(monkeypatch):
    monkeypatch.setattr(kernel_cache, "__file__", "/proc/no/such/package/kernel_cache.py")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/no/such/folder/kernels-0")
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/no/such/cache")
    monkeypatch.setenv("HOME", "/proc/no/such/home")
    monkeypatch.setattr(kernel_cache, "sys", SimpleNamespace(modules={}))

    def no_place(*_, **__):
        raise FileNotFoundError("No usable temporary directory found")

    monkeypatch.setattr(kernel_cache.tempfile, "gettempdir", no_place)
    monkeypatch.setattr(kernel_cache.tempfile, "mkdtemp", no_place)


def test_without_any_place_to_write_only_who_needs_kernels_is_refused(nowhere_to_write):
    kernel_cache.settle()
    assert kernel_cache.folder() is None
    with pytest.raises(ResourceError, match="Set NUMBA_CACHE_DIR to a folder"):
        kernel_cache.require()


def test_a_temporary_folder_is_gone_afterwards(tmp_path):
    code = (
        "import os, sys, tempfile; from vision import kernel_cache\n"
        "kernel_cache._roots = lambda package: iter(())\n"
        "kernel_cache.settle(); kernel_cache.require()\n"
        "print(kernel_cache.folder()); print(os.path.isdir(kernel_cache.folder().parent), kernel_cache.is_kept())"
    )
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    folder, there_and_kept = done.stdout.splitlines()
    assert there_and_kept == "True False"
    assert Path(folder).parent.parent == tmp_path
    assert not Path(folder).parent.exists()


@pytest.mark.parametrize("value", ["1", "2"])
def test_a_compiler_that_is_switched_off_is_told_of(value, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", value)
    with pytest.raises(ResourceError, match=f"got NUMBA_DISABLE_JIT={value}.*unset NUMBA_DISABLE_JIT"):
        kernel_cache.require()


@pytest.mark.parametrize("value", ["0", "-1"])
def test_a_compiler_without_a_thread_is_told_of(value, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", value)
    with pytest.raises(ResourceError, match=f"got NUMBA_NUM_THREADS={value}; expected 1 or more.*unset"):
        kernel_cache.require()


@pytest.mark.parametrize(
    "access", ["import vision; vision.detect_ellipses", "import vision.edges.chains", "import vision.regions.merging"]
)
@pytest.mark.parametrize("variable", ["NUMBA_DISABLE_JIT=1", "NUMBA_NUM_THREADS=0"])
def test_a_library_without_a_compiler_says_so_whatever_is_imported(access, variable):
    name, value = variable.split("=")
    code = f"from vision import ResourceError\ntry:\n    {access}\nexcept ResourceError as error:\n    print(error)"
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {name: value}, capture_output=True, text=True, check=True
    )
    assert f"got {variable}" in done.stdout


@pytest.mark.parametrize("variable", ["NUMBA_DISABLE_JIT", "NUMBA_NUM_THREADS"])
def test_what_numba_cannot_read_counts_as_not_set_and_nobody_hears_of_it(variable):
    code = "import vision.kernels, numba; print(numba.config.DISABLE_JIT, numba.config.NUMBA_NUM_THREADS > 0)"
    environment = os.environ | {variable: "false"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("0 True\n", "")


@pytest.mark.parametrize("value", ["", "0", "false", "no"])
def test_a_compiler_that_is_not_switched_off_compiles(value, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", value)
    kernel_cache.require()
