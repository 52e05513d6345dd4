"""Ctrl-C at bad moments. Each program presses it itself, so that nothing depends on how fast the machine is."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

BOUND_S = 60
ROOT = Path(__file__).resolve().parents[2]

PRESS = "import os, signal; os.kill(os.getpid(), signal.SIGINT)\n"
SWALLOWING = f"try:\n    {PRESS.replace(chr(10), chr(10) + '    ')}\nexcept KeyboardInterrupt:\n    pass\n"
IN_ORDER = """
from benchmark.interrupts import end_at_once, ended_in_order

end_at_once()
try:
    with ended_in_order():
        {inside}
except KeyboardInterrupt:
    print("in order")
{after}
print("went on")
"""


def run(program: str, directory: Path, *arguments: str, bound_s: float = BOUND_S) -> tuple[int, str, str]:
    """The exit code and what was printed to either stream; modules in the directory can be imported."""
    path = os.pathsep.join([str(directory), str(ROOT)])
    inherited = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NICEGUI"))}
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=bound_s,
        env=inherited | {"PYTHONPATH": path},
    )
    return done.returncode, done.stdout, done.stderr


def test_an_import_inside_a_command_cannot_swallow_ctrl_c(tmp_path: Path) -> None:
    (tmp_path / "swallowing.py").write_text(SWALLOWING)
    (tmp_path / "command.py").write_text("def command():\n    import swallowing\n    print('went on')\n")
    program = "import sys; from benchmark import cli; cli.COMMANDS['x'] = 'command:command'; sys.exit(cli.main())"
    assert run(program, tmp_path, "x") == (130, "", "focalpick: stopped\n")


def test_ctrl_c_in_an_import_is_answered_after_it_where_there_is_something_to_finish(tmp_path: Path) -> None:
    (tmp_path / "swallowing.py").write_text(f"{SWALLOWING}\nprint('loaded')\n")
    program = IN_ORDER.format(inside="import swallowing, time; time.sleep(60)", after="")
    assert run(program, tmp_path) == (0, "loaded\nin order\nwent on\n", "")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_an_import_cannot_swallow_the_end_either(number: signal.Signals, tmp_path: Path) -> None:
    swallowing = SWALLOWING.replace("SIGINT", number.name).replace("KeyboardInterrupt", "SystemExit")
    (tmp_path / "swallowing.py").write_text(swallowing)
    program = (
        "from benchmark.child_process import ended_by_signals\n"
        "with ended_by_signals():\n    import swallowing, time; time.sleep(60)"
    )
    assert run(program, tmp_path) == (128 + number, "", "")


CALLING_BACK = f"""
import ctypes

@ctypes.CFUNCTYPE(None)
def notify():
    {PRESS}
def work():
    notify()
"""

COLLECTED = f"""
class Thing:
    def __del__(self):
        {PRESS}
def work():
    Thing()
"""


@pytest.mark.parametrize(
    ("package", "program"), [("llvmlite", CALLING_BACK), ("numba", CALLING_BACK), ("mine", COLLECTED)]
)
def test_ctrl_c_is_answered_after_what_only_prints_exceptions(package: str, program: str, tmp_path: Path) -> None:
    (tmp_path / package).mkdir()
    (tmp_path / package / "working.py").write_text(program)
    inside = "import time; from working import work; work(); time.sleep(60)"
    assert run(IN_ORDER.format(inside=inside, after=""), tmp_path / package) == (0, "in order\nwent on\n", "")


def test_pressed_again_ctrl_c_ends_what_takes_long_to_let_it_through(tmp_path: Path) -> None:
    (tmp_path / "long.py").write_text(f"import time\n{PRESS}time.sleep(1.2)\n{PRESS}time.sleep(60)\n")
    program = IN_ORDER.format(inside="import long", after="")
    assert run(program, tmp_path) == (130, "", "focalpick: stopped\n")


def test_impatience_does_not_disturb_the_way_out(tmp_path: Path) -> None:
    inside = f"""
        try:
            {PRESS}
        finally:
            {PRESS}
            print("cleaned up")"""
    assert run(IN_ORDER.format(inside=inside, after=""), tmp_path) == (0, "cleaned up\nin order\nwent on\n", "")


def test_outside_the_block_ctrl_c_ends_the_program_again(tmp_path: Path) -> None:
    assert run(IN_ORDER.format(inside="pass", after=PRESS), tmp_path) == (130, "", "focalpick: stopped\n")


@pytest.mark.parametrize("before", ["signal.SIG_IGN", "lambda *_: print('mine')"])
def test_who_answers_ctrl_c_already_goes_on_doing_so(before: str, tmp_path: Path) -> None:
    program = f"import signal; signal.signal(signal.SIGINT, {before})\n"
    program += IN_ORDER.format(inside=PRESS, after="")
    expected = "went on\n" if "IGN" in before else "mine\nwent on\n"
    assert run(program, tmp_path) == (0, expected, "")


TEACHING = """
import asyncio, signal, sys
from pathlib import Path
from nicegui import app
from benchmark.interrupts import end_at_once, ended_in_order
from benchmark.lessons.page_services import open_views
from vision.teaching.editor.server import serve

def press(times):
    for _ in range(times):
        signal.raise_signal(signal.SIGINT)

if __name__ == "__main__":
    app.on_startup(lambda: asyncio.get_running_loop().call_later(0.2, press, 3))
    end_at_once()
    directory, services = open_views(Path(sys.argv[1]), 65)
    try:
        with ended_in_order():
            serve(directory, directory / "model.json", services, 0, False)
    except KeyboardInterrupt:
        print("in order")
"""


def test_an_impatient_person_ends_the_teaching_page_in_order(tmp_path: Path) -> None:
    views = shutil.copytree(ROOT / "assets" / "models" / "sessions" / "cover2", tmp_path / "views")
    (views / "session.json").unlink()  # whose replay takes a while
    code, out, err = run(TEACHING, tmp_path, str(views), bound_s=600)  # kernels may have to be compiled first
    assert (code, out.splitlines()[-1], err) == (0, "in order", "")
