"""Stores the session after every event without making the person wait for the disk."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from vision.errors import FocalpickError
from vision.teaching.session import Session
from vision.teaching.session_file import save_session

OnStored = Callable[[Sequence[str], str], None]


class Autosave:
    """Writes the latest session in a thread; several that arrive during a write make one.

    Every write is atomic. What was handed over is on the disk when :meth:`close` returns.
    """

    def __init__(self, path: Path, on_stored: OnStored) -> None:
        """Start the thread.

        Args:
            path: the session file.
            on_stored: called in the thread after a write, with the tokens of the events that it made safe and with
                what went wrong, or "".
        """
        self._path = path
        self._on_stored = on_stored
        self._condition = threading.Condition()
        self._latest: Session | None = None
        self._tokens: list[str] = []
        self._closed = False
        self._thread = threading.Thread(target=self._run, name="autosave", daemon=True)
        self._thread.start()

    def store(self, session: Session, tokens: Sequence[str] = ()) -> None:
        """Hand a session over. Tokens identify the acts that are safe once it is written."""
        with self._condition:
            self._latest = session
            self._tokens += tokens
            self._condition.notify()

    def close(self) -> None:
        """Write what is left and end."""
        with self._condition:
            self._closed = True
            self._condition.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._latest is not None or self._closed)
                session, tokens = self._latest, self._tokens
                self._latest, self._tokens = None, []
            if session is None:
                return
            problem = self._write(session)
            if problem:
                tokens = []  # the page keeps them and sends them again
            self._on_stored(tokens, problem)

    def _write(self, session: Session) -> str:
        try:
            save_session(session, self._path)
        except FocalpickError as error:
            return str(error)
        return ""
