"""Applies the mutations of `mutations.py` to a copy of the tree, reports those that no test notices: `make mutants`.

The copy lies in build/mutants and is made anew each time; the compiled kernels beside it stay. Only the tests that
are expected to notice a mutation run, and of those only the fast ones. First they all run on the unchanged copy,
where they must pass. A mutation within a kernel gets its kernels compiled anew, any other one uses those of the copy.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.mutants.mutations import MUTATIONS, Mutation
from vision.kernel_cache import digest

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "mutants"
TREE, KERNELS = BUILD / "tree", BUILD / "kernels"
LEFT_OUT = shutil.ignore_patterns(".*", "build", "dist", "results", "__pycache__", "*.egg-info")
FAST = "not slow and not sweep and not browser"
LIMIT_S = 900


def copy_tree() -> None:
    """The tree, and no kernels but those of its own unchanged sources."""
    shutil.rmtree(TREE, ignore_errors=True)
    shutil.copytree(ROOT, TREE, ignore=LEFT_OUT)
    KERNELS.mkdir(exist_ok=True)
    for folder in KERNELS.iterdir():
        if folder.is_symlink():
            folder.unlink()
        elif folder != kernels():
            shutil.rmtree(folder)


def kernels() -> Path:
    """Where the copy as it is now has its kernels; `vision/kernel_cache.py` says why it depends on all sources."""
    return KERNELS / f"kernels-{digest(TREE / 'vision')}"


def passes(tests: Sequence[str]) -> bool:
    """Whether tests pass in the copy; a run that hangs does not."""
    environment = os.environ | {
        "PYTHONPATH": str(TREE),
        "NUMBA_CACHE_DIR": str(KERNELS),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", FAST, *tests]
    try:
        done = subprocess.run(command, cwd=TREE, env=environment, capture_output=True, timeout=LIMIT_S, text=True)
    except subprocess.TimeoutExpired:
        return False
    (BUILD / "pytest.log").write_text(done.stdout + done.stderr, encoding="utf-8")
    return done.returncode == 0


@contextmanager
def applied(mutation: Mutation) -> Iterator[None]:
    """The copy with a mutation."""
    path = TREE / mutation.file
    text, kept, unchanged = path.read_text(encoding="utf-8"), path.stat(), kernels()
    path.write_text(text.replace(mutation.old, mutation.new), encoding="utf-8")
    mutated = kernels()
    if not mutation.in_kernel and mutated != unchanged:
        mutated.symlink_to(unchanged)
    try:
        yield
    finally:
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(kept.st_atime_ns, kept.st_mtime_ns))  # Numba tells by it that its kernels are up to date
        if mutated.is_symlink():
            mutated.unlink()
        elif mutated != unchanged:
            shutil.rmtree(mutated, ignore_errors=True)


def survivors(mutations: Sequence[Mutation]) -> list[Mutation]:
    """The mutations that no test notices, while a table of all is printed.

    Raises:
        SystemExit: the tests fail on the unchanged copy, and so cannot tell anything.
    """
    copy_tree()
    tests = sorted({test for mutation in mutations for test in mutation.tests})
    print(f"{len(tests)} tests on the unchanged copy ...", flush=True)
    for test in tests if not passes(tests) else ():
        if not passes([test]):
            raise SystemExit(f"{test} does not pass, or is not fast; see {BUILD / 'pytest.log'}")
    left = []
    for number, mutation in enumerate(mutations, start=1):
        start = time.monotonic()
        with applied(mutation):
            noticed = not passes(mutation.tests)
        left += [] if noticed else [mutation]
        word = "noticed" if noticed else "SURVIVES"
        print(
            f"{number:3}  {word:8}  {time.monotonic() - start:4.0f} s  {mutation.file}: {mutation.what}", flush=True
        )
    return left


def main() -> None:
    """Apply the mutations, or those whose description or file holds a word, from the command line."""
    parser = argparse.ArgumentParser(description="See which mutations of the code no fast test notices.")
    parser.add_argument("-k", default="", metavar="WORD", help="only those with this word in file or description")
    word = parser.parse_args().k
    chosen = [mutation for mutation in MUTATIONS if word in f"{mutation.file}: {mutation.what}"]
    left = survivors(chosen)
    print(f"{len(chosen) - len(left)} of {len(chosen)} mutations are noticed.")
    raise SystemExit(1 if left else 0)


if __name__ == "__main__":
    main()
