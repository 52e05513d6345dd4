import os
import subprocess
import sys

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


def test_kernels_are_kept_apart_by_their_sources_unless_the_user_says_where(tmp_path):
    assert "kernels-" in cache_directory()
    assert cache_directory(NUMBA_CACHE_DIR=str(tmp_path)) == str(tmp_path)


def test_numba_may_be_imported_before():
    code = "import numba, vision; print(numba.config.CACHE_DIR)"
    base = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run([sys.executable, "-c", code], env=base, capture_output=True, text=True, check=True)
    assert "kernels-" in done.stdout
