"""Settings of the whole test run."""

import contextlib
import os

# Before numpy and OpenGL are first loaded: the test processes share few cores. LP_ is Mesa's software renderer.
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LP_NUM_THREADS": "1"} | os.environ

os.environ["COLUMNS"] = "140"  # tables fold in a narrower terminal

import cv2
from hypothesis import settings

from benchmark.world.gl import choose_backend
from vision.errors import ResourceError

cv2.setNumThreads(1)

# Once, here: the test processes inherit the answer. Without any OpenGL the tests that draw nothing still run.
with contextlib.suppress(ResourceError):
    choose_backend()

# The same examples on every run, so that a failure is never a surprise to somebody who changed nothing.
# `pytest --hypothesis-profile=explore` looks for new ones.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=1000, print_blob=True)
settings.load_profile("repeatable")
