"""Opens the teaching page on a port of this machine."""

from __future__ import annotations

import logging
import signal
import socket
import sys
import threading
from pathlib import Path
from types import FrameType

import cv2
from fastapi import HTTPException, Response
from fastapi.responses import JSONResponse
from nicegui import app, background_tasks, ui

from vision.errors import InputError, ResourceError
from vision.teaching.editor.page import Page
from vision.teaching.editor.services import Services
from vision.teaching.editor.workshop import Workshop

HOST = "127.0.0.1"
USUAL_PORT = 8765
PORTS_TO_TRY = 50
HIGHEST_PORT = 65535

_UNSAVED_PROMPT = """
<script>
  window.addEventListener("beforeunload", (event) => {
    if (window.focalpickUnsaved || window.focalpickStage?.outbox.acts.length) event.preventDefault();
  });
</script>
"""


def serve(directory: Path, out: Path, services: Services, port: int | None = None, show: bool = True) -> None:
    """Open the page on a lesson directory; returns when it is ended, and nothing is lost then.

    Only this machine can reach it.

    Args:
        directory: with the views, and with the session where there is one.
        out: where the model is saved.
        services: what the page asks of the program around it.
        port: of the page; None for the first free one from 8765 on.
        show: open a browser on it.

    Raises:
        InputError: the directory has no views, or a session of other views.
        FileFormatError: a file is not what its name says.
        ResourceError: the port is taken.
        KeyboardInterrupt: the person ended it with Ctrl-C.
    """
    with listen(port) as listener:
        cv2.setNumThreads(1)
        workshop = Workshop(directory, out, services)
        try:
            _run(workshop, listener, show)
        finally:
            workshop.close()


def _run(workshop: Workshop, listener: socket.socket, show: bool) -> None:
    port = listener.getsockname()[1]
    _routes(workshop)

    def warn(_: bool) -> None:
        if workshop.pose_complaint:
            print(f"focalpick: warning: {workshop.pose_complaint}", file=sys.stderr, flush=True)
            stop_listening()

    stop_listening = workshop.listen(warn)

    def start() -> None:
        _hear_ctrl_c_once()
        background_tasks.create(workshop.run(), name="workshop")
        print(f"Teach {workshop.part_name} at http://{HOST}:{port}/  (Ctrl-C ends; nothing is lost)", flush=True)

    app.on_startup(start)
    logging.getLogger("uvicorn.error").addFilter(_is_worth_telling)
    ui.run(
        lambda: _page(workshop),
        host=HOST,
        port=port,
        fd=listener.fileno(),
        title=f"Teach {workshop.part_name}",
        favicon="⭕",
        dark=True,
        show=show,
        reload=False,
        show_welcome_message=False,
        reconnect_timeout=60.0,
        cache_control_directives="no-cache",
        timeout_graceful_shutdown=1,
    )


def _hear_ctrl_c_once() -> None:
    """Let an impatient Ctrl-C not disturb the way out: at a second one uvicorn drops all, with a traceback.

    For the time of the server, which puts back what was before.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    answer = signal.getsignal(signal.SIGINT)
    heard = False

    def hear(number: int, frame: FrameType | None) -> None:
        nonlocal heard
        if not heard and callable(answer):
            heard = True
            answer(number, frame)

    signal.signal(signal.SIGINT, hear)


def _is_worth_telling(record: logging.LogRecord) -> bool:
    """Not of a request that was on its way when the program was ended: it has no answer, and nobody waits for one."""
    error = record.exc_info[1] if record.exc_info else None
    return not (isinstance(error, RuntimeError) and str(error) == "No response returned.")


def _page(workshop: Workshop) -> None:
    ui.add_head_html(_UNSAVED_PROMPT)
    Page(workshop)


def _routes(workshop: Workshop) -> None:
    """The pictures, and what the extractors found in them."""

    @app.get("/picture/{number}.png")
    def picture(number: int) -> Response:
        if not 0 <= number < len(workshop.views):
            raise HTTPException(404)
        image = workshop.views[number].image
        bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        return Response(cv2.imencode(".png", bgr)[1].tobytes(), media_type="image/png")

    @app.get("/overlay/{tag}/{number}.json")
    def overlay(tag: str, number: int) -> Response:
        found = workshop.extraction.overlay(tag, number)
        if found is None:
            raise HTTPException(404)
        return JSONResponse(found)


def listen(asked: int | None) -> socket.socket:
    """A socket that listens at the port that was asked for, or at the first free one.

    Listening at once, not only looking for a free port, keeps two pages that are opened at the same moment apart; and
    a browser that comes before the page is ready waits.

    Raises:
        InputError: there is no such port.
        ResourceError: it is taken.
    """
    if asked is not None and not 0 <= asked <= HIGHEST_PORT:
        raise InputError("--port", got=asked, expected=f"0 to {HIGHEST_PORT}")
    candidates = [asked] if asked is not None else range(USUAL_PORT, USUAL_PORT + PORTS_TO_TRY)
    for port in candidates:
        listener = socket.socket()
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((HOST, port))
            listener.listen()
        except OSError:
            listener.close()
            continue
        return listener
    do = "choose another with --port, or none for a free one" if asked is not None else "end another teaching page"
    raise ResourceError(f"port: got {candidates[0]}, which is taken; expected a free one; {do}")
