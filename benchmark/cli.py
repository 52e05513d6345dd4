"""The ``focalpick`` command: parses, runs a subcommand, and turns errors into one line and an exit code."""

from __future__ import annotations

import contextlib
import functools
import importlib
import inspect
import io
import itertools
import logging
import os
import shutil
import sys
import tempfile
import textwrap
import traceback
from collections.abc import Callable, Sequence

from benchmark.interrupts import EXIT_INTERRUPTED, end_at_once, ignore_interrupts
from benchmark.localizers.errors import LocalizerError
from vision.errors import FocalpickError, InputError

DESCRIPTION = """A benchmark of bin picking with round parts. A simulated robot drops parts into a bin, photographs
them with the camera on its wrist, works out their poses from the circles on them, and picks them. The vision system
is that of Y. Motai, Salient feature extraction of industrial objects for an automated assembly system."""

COMMANDS = {
    "doctor": "benchmark.commands.doctor:doctor",
    "run": "benchmark.commands.run:run",
    "view": "benchmark.commands.view:view",
    "sweep": "benchmark.commands.sweep:sweep",
    "teach": "benchmark.commands.teach:teach",
    "explain": "benchmark.commands.explain:explain",
    "localize": "benchmark.commands.localize:localize",
    "table": "benchmark.commands.table:table",
    "check": "benchmark.commands.check:check",
    "compare": "benchmark.commands.compare:compare",
    "model show": "benchmark.commands.model:show",
    "assets build": "benchmark.commands.assets:build",
    "assets teach": "benchmark.commands.assets:teach",
}
"""Where each command is; in the order in which a newcomer needs them."""

HELP_FLAGS = ("-h", "--help", "help")
EXIT_BAD_INPUT = 2
EXIT_INTERNAL_ERROR = 70


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: without the program's name; those of the process by default.

    Returns:
        The exit code: 0 done, 1 a check has failed, 2 bad input or something missing, 70 a bug, 130 interrupted.
    """
    if arguments is None:  # the process ends with this call; a caller's goes on, and answers Ctrl-C in its own way
        end_at_once()
    _let_every_terminal_show_the_output()
    # Without a home Matplotlib keeps its fonts beside the temporary files, and need not advise the user about that.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        return _dispatch(sys.argv[1:] if arguments is None else arguments)
    except FocalpickError as error:
        return _fail(_with_foreign_traceback(error), EXIT_BAD_INPUT)
    except KeyboardInterrupt as error:
        if arguments is None:
            ignore_interrupts()
        return _fail(str(error) or "stopped", EXIT_INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone, as in `focalpick table DIR | head`; nothing more can be written to it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        return _fail(_report_bug(error), EXIT_INTERNAL_ERROR)


def _let_every_terminal_show_the_output() -> None:
    """Show "?" for a character that the terminal's encoding does not have, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def _dispatch(arguments: Sequence[str]) -> int:
    if not arguments or arguments[0] in HELP_FLAGS:
        print(_overview())
        return 0
    for words in (2, 1):
        name = " ".join(arguments[:words])
        if name in COMMANDS:
            return _run(name, arguments[words:])
    group = [name for name in COMMANDS if name.startswith(f"{arguments[0]} ")]
    expected = f"one of {', '.join(group or COMMANDS)}"
    raise InputError("command", got=" ".join(arguments[:2] if group else arguments[:1]), expected=expected)


def _run(name: str, arguments: Sequence[str]) -> int:
    for before, argument in itertools.pairwise(["", *arguments]):
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            # For a path, nothing would be the working directory.
            where = argument.rstrip("=") or before or "the command"
            raise InputError(f"argument after {where}", got="an empty text", expected="a name, a path or a number")
    command = _load(name)
    description = inspect.cleandoc(command.__doc__ or "").partition("\nArgs:")[0]
    return _parse(command, f"focalpick {name}", description, arguments)()


def _parse(
    command: Callable[..., int], program: str, description: str, arguments: Sequence[str]
) -> Callable[[], int]:
    """The command with its arguments bound; ends the process after ``--help``.

    Raises:
        InputError: the arguments cannot be parsed; one line instead of tyro's box.
    """
    import tyro

    @functools.wraps(command)
    def bind(*positional: object, **named: object) -> Callable[[], int]:
        return functools.partial(command, *positional, **named)

    messages = io.StringIO()
    try:
        with contextlib.redirect_stderr(messages):
            return tyro.cli(bind, prog=program, description=description, args=arguments)
    except SystemExit as end:
        if not end.code:
            raise
        raise InputError(
            "arguments",
            got=_first_sentence(messages.getvalue()),
            expected=f"what `{program} --help` says",
        ) from None


def _first_sentence(box: str) -> str:
    """What a box of tyro's says first, without its title and frame, which may be Unicode or ASCII."""
    inside = [line.strip('│|" ') for line in box.splitlines()[1:]]
    texts = ["" if set(line) <= set("─-╰╯") else line for line in inside]
    paragraph = itertools.takewhile(bool, itertools.dropwhile(lambda text: not text, texts))
    return " ".join(paragraph).rstrip(". ") or "something else"


def _load(name: str) -> Callable[..., int]:
    module, _, function = COMMANDS[name].partition(":")
    return getattr(importlib.import_module(module), function)


def _overview() -> str:
    """The help of ``focalpick`` itself: a line for each command."""
    width = max(map(len, COMMANDS))
    summaries = {name: (_load(name).__doc__ or "").partition("\n")[0] for name in COMMANDS}
    lines = [f"  {name:<{width}}  {summary}" for name, summary in summaries.items()]
    start = (
        "Start with `focalpick doctor`, then `focalpick run --part hub`. Each COMMAND explains itself with --help."
    )
    return "\n".join(["usage: focalpick COMMAND [OPTIONS]", "", _wrap(DESCRIPTION), "", *lines, "", _wrap(start)])


def _wrap(text: str) -> str:
    """Paragraphs wrapped to the terminal."""
    width = min(shutil.get_terminal_size().columns, 110)
    return "\n\n".join(textwrap.fill(" ".join(paragraph.split()), width) for paragraph in text.strip().split("\n\n"))


def _fail(message: str, code: int) -> int:
    print(f"focalpick: {' '.join(message.split())}", file=sys.stderr, flush=True)
    return code


def _report_bug(error: Exception) -> str:
    """Save the traceback of an unexpected error and say in one line where it is."""
    text = f"internal error: {type(error).__name__}: {error}"
    saved = _save_traceback(error)
    return f"{text}. The traceback is in {saved}; please report it" if saved else text


def _with_foreign_traceback(error: FocalpickError) -> str:
    """The error's line; what a user's own code has raised comes with its traceback, in a file."""
    saved = _save_traceback(error.__cause__) if isinstance(error, LocalizerError) and error.__cause__ else None
    return f"{error} The traceback is in {saved}" if saved else str(error)


def _save_traceback(error: BaseException) -> str | None:
    """The name of a new file with the traceback; None where none can be written."""
    try:
        with tempfile.NamedTemporaryFile("w", prefix="focalpick-", suffix=".txt", delete=False) as file:
            traceback.print_exception(error, file=file)
    except OSError:
        return None
    return file.name


if __name__ == "__main__":
    sys.exit(main())
