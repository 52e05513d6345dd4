"""``focalpick view``."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import tyro

from benchmark.interrupts import ended_in_order
from vision.errors import InputError, ResourceError


def view(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR|FILE")],
    web: bool = False,
) -> int:
    """Open recorded episodes in the rerun viewer.

    Example: focalpick run --part hub --rrd hub.rrd && focalpick view hub.rrd

    Args:
        path: a file that focalpick run --rrd wrote, or a directory with such files.
        web: open it in the browser, for a machine without a display.
    """
    recordings = _recordings(path)
    if not web and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ResourceError("viewer: got no display; expected DISPLAY or WAYLAND_DISPLAY. Add --web for the browser")
    command = [sys.executable, "-m", "rerun_cli", *(["--web-viewer"] if web else []), *map(str, recordings)]
    # The viewer is a wrapper around a native process, which would outlive it: both get a group of their own.
    with ended_in_order():
        process = subprocess.Popen(command, start_new_session=True)
        try:
            return 0 if process.wait() == 0 else 1
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGTERM)
                process.wait()


def _recordings(path: Path) -> list[Path]:
    found = sorted(path.rglob("*.rrd")) if path.is_dir() else [path] if path.is_file() else []
    if not found:
        do = "Make one with `focalpick run --rrd FILE`."
        raise InputError(f"recording {path}", got="none", expected="an .rrd file, or a directory with some", do=do)
    return found
