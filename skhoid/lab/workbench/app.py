"""The addresses at which the page asks, and what they answer."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...io._table import require
from ...io.whole import written_whole
from ..explore import component
from ..explore.wire import pack
from .bench import Workbench, words_of
from .names import safe_name
from .page import page, static
from .security import Guard, Keys
from .session import NotSaved

__all__ = ["EXTRA", "make_app"]

EXTRA = "workbench"
MOST_BYTES = 2_000_000_000  # of a file
MOST_ASKED = 1_000_000  # bytes of what a page asks
SCRIPT = "text/javascript; charset=utf-8"
STYLE = "text/css; charset=utf-8"


def make_app(bench: Workbench, keys: Keys, port: int) -> Guard:
    """The ASGI application of a workbench, guarded.

    Parameters
    ----------
    bench : Workbench
        What it shows.
    keys : Keys
        The secrets of this server.
    port : int
        The port on which it will listen.

    Returns
    -------
    app : Guard
    """
    require("starlette", "The workbench", EXTRA)
    from starlette.applications import Starlette
    from starlette.routing import Route

    answers = _Answers(bench)
    routes = [
        Route("/", answers.page),
        Route("/static/{name}", answers.static),
        Route("/api/events", answers.events),
        Route("/api/opening", answers.opening),
        Route("/api/script.py", answers.script),
        Route("/api/report/{name}", answers.report),
        Route("/api/upload", answers.upload, methods=["POST"]),
        Route("/api/{action}", answers.act, methods=["POST"]),
    ]
    return Guard(Starlette(routes=routes), keys, port)


class _Answers:
    """What each address answers."""

    def __init__(self, bench: Workbench):
        self.bench = bench

    async def page(self, request: Any) -> Any:
        from starlette.responses import HTMLResponse

        return HTMLResponse(page())

    async def static(self, request: Any) -> Any:
        from starlette.responses import Response

        texts: dict[str, tuple[Callable[[], str], str]] = {
            "bench.js": (component.script, SCRIPT),
            "bench.css": (component.style, STYLE),
            "start.js": (lambda: static("start.js"), SCRIPT),
            "start.css": (lambda: static("start.css"), STYLE),
        }
        if request.path_params["name"] not in texts:
            return _failed("There is nothing at this address.", 404)
        text, kind = texts[request.path_params["name"]]
        return Response(text(), media_type=kind)

    async def events(self, request: Any) -> Any:
        from starlette.responses import StreamingResponse

        return StreamingResponse(self.bench.news.stream(), media_type="text/event-stream")

    async def opening(self, request: Any) -> Any:
        from starlette.responses import JSONResponse

        return JSONResponse(self.bench.opening())

    async def script(self, request: Any) -> Any:
        from starlette.responses import Response

        return await _tried(
            self.bench.script,
            lambda text: Response(
                text, media_type="text/x-python; charset=utf-8", headers=_saved_as("script.py")
            ),
        )

    async def report(self, request: Any) -> Any:
        from starlette.responses import FileResponse

        name = request.path_params["name"]
        path = self.bench.folder.report(name)
        if path is None:
            return _failed("There is no such report in this session.", 404)
        return FileResponse(path, media_type="text/html", headers=_saved_as(name))

    async def upload(self, request: Any) -> Any:
        from starlette.responses import JSONResponse

        try:
            path = await _received(request, self.bench)
        except _TooLarge as error:
            return _failed(str(error), 413)
        except ValueError as error:
            return _failed(str(error), 400)
        except OSError as error:
            text = f"The file was not taken: {words_of(error)} Nothing of it is left behind."
            return _failed(text, 507)
        return JSONResponse(self.bench.uploaded(path))

    async def act(self, request: Any) -> Any:
        from starlette.responses import JSONResponse, Response

        try:
            asked = await _asked(request)
        except _TooLarge as error:
            return _failed(str(error), 413)
        except ValueError as error:
            return _failed(str(error), 400)
        bench, name = self.bench, request.path_params["action"]
        plain: dict[str, Callable[[], Any]] = {
            "open": lambda: bench.open(asked.get("files")),
            "columns": lambda: bench.correct(asked),
            "fit": lambda: bench.fit(asked),
            "back": bench.back,
        }
        if name in plain:
            return await _tried(plain[name], lambda _: JSONResponse(bench.opening()))
        by = request.headers.get("x-page", "")[:64]

        def packed() -> bytes:
            if name == "view":
                return pack({"view": bench.view()})
            return pack(bench.act(name, asked, by))

        return await _tried(
            packed, lambda found: Response(found, media_type="application/octet-stream")
        )


async def _tried(work: Callable[[], Any], answer: Callable[[Any], Any]) -> Any:
    """Do something in a thread; what goes wrong is told to the user in words."""
    from starlette.concurrency import run_in_threadpool

    try:
        found = await run_in_threadpool(work)
    except NotSaved as error:
        return _failed(str(error), 507)
    except (ValueError, KeyError, MemoryError, OSError) as error:
        return _failed(words_of(error), 400)
    except Exception as error:
        text = f"Unexpected error: {type(error).__name__}: {words_of(error)} Please report it."
        return _failed(text, 500)
    return answer(found)


def _failed(message: str, status: int) -> Any:
    from starlette.responses import JSONResponse

    return JSONResponse({"message": message}, status)


def _saved_as(name: str) -> dict[str, str]:
    return {"content-disposition": f'attachment; filename="{name}"'}


class _TooLarge(ValueError):
    """More bytes than are taken."""


async def _asked(request: Any) -> dict[str, Any]:
    """The arguments of a request."""
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MOST_ASKED:
            raise _TooLarge(f"A request may have {MOST_ASKED:,} bytes; this one has more.")
    try:
        found = json.loads(bytes(body) or b"{}")
    except (ValueError, RecursionError) as error:
        raise ValueError("The request is no JSON.") from error
    if not isinstance(found, dict):
        raise ValueError(f"The request must be an object of arguments; got {found!r:.80}.")
    return found


async def _received(request: Any, bench: Workbench) -> Path:
    """Write the body of a request to a file of the session, whole or not at all."""
    from starlette.concurrency import run_in_threadpool

    name = safe_name(request.query_params.get("name", ""))
    said = request.headers.get("content-length", "0")
    _check_size(int(said) if said.isdecimal() else 0, name)
    folder = bench.folder.uploads
    folder.mkdir(parents=True, exist_ok=True)
    path = bench.folder.free(name, folder)
    size = 0
    with written_whole(path) as aside, aside.open("wb") as file:
        async for part in request.stream():
            size += len(part)
            _check_size(size, name)
            await run_in_threadpool(file.write, part)
    return path


def _check_size(size: int, name: str) -> None:
    if size > MOST_BYTES:
        raise _TooLarge(
            f"{name} is larger than {MOST_BYTES / 1e9:.3g} GB, the most that is copied into a "
            f"session. Name it on the command line instead, where it is read in its place: "
            f"skhoid workbench {name}"
        )
