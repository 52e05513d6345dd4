"""Opens the teaching page on a port of this machine."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from pathlib import Path

import cv2
from fastapi import HTTPException, Response
from fastapi.responses import JSONResponse
from nicegui import app, background_tasks, ui

from vision.errors import ResourceError
from vision.teaching.editor.page import Page
from vision.teaching.editor.services import Services
from vision.teaching.editor.workshop import Workshop

HOST = "127.0.0.1"
USUAL_PORT = 8765
PORTS_TO_TRY = 50

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
    port = _free_port(port)
    cv2.setNumThreads(1)
    workshop = Workshop(directory, out, services)
    _routes(workshop)

    def start() -> None:
        background_tasks.create(workshop.run(), name="workshop")
        background_tasks.create(_announce(workshop.part_name, port), name="announce")

    app.on_startup(start)
    try:
        ui.run(
            lambda: _page(workshop),
            host=HOST,
            port=port,
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
    finally:
        workshop.close()


async def _announce(part: str, port: int) -> None:
    """Say where the page is, once it can be reached."""
    while True:
        try:
            _, writer = await asyncio.open_connection(HOST, port)
        except OSError:
            await asyncio.sleep(0.05)
            continue
        writer.close()
        print(f"Teach {part} at http://{HOST}:{port}/  (Ctrl-C ends; nothing is lost)", flush=True)
        return


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


def _free_port(asked: int | None) -> int:
    """The port that was asked for, or the first free one.

    Raises:
        ResourceError: it is taken.
    """
    candidates = [asked] if asked is not None else range(USUAL_PORT, USUAL_PORT + PORTS_TO_TRY)
    for port in candidates:
        with contextlib.closing(socket.socket()) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                probe.bind((HOST, port))
                return port
    do = "choose another with --port, or none for a free one" if asked is not None else "end another teaching page"
    raise ResourceError(f"port: got {candidates[0]}, which is taken; expected a free one; {do}")
