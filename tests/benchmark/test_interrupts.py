"""Ctrl-C at bad moments. Each program presses it itself, so that nothing depends on how fast the machine is."""

from __future__ import annotations

import os
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


def run(program: str, directory: Path, *arguments: str) -> tuple[int, str, str]:
    """The exit code and what was printed to either stream; modules in the directory can be imported."""
    path = os.pathsep.join([str(directory), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=BOUND_S,
        env=os.environ | {"PYTHONPATH": path},
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
