"""The server, for one person at one machine: who may ask, what each address answers, how it ends.

``Guard`` lets in the browser that was given
the token, ``make_app`` answers, and ``serve`` starts it and shows the page.
"""

from __future__ import annotations

import contextlib
import json
import secrets
import socket
import warnings
import webbrowser
from collections.abc import Awaitable, Callable, Iterator, MutableMapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from ... import __version__
from ...io import require, written_whole
from ...text import rendered
from ..explore import component
from ..explore.payloads import pack
from .bench import Workbench, put_in_words
from .columns import Choices
from .session import NotSaved, SessionFolder, safe_name

EXTRA = "workbench"
HOST = "127.0.0.1"
FOLDER = "skhoid-workbench"
GRACE = 3  # s, for replies that are under way when the server ends
MOST_BYTES = 2_000_000_000  # of a file
KINDS = {"js": "text/javascript; charset=utf-8", "css": "text/css; charset=utf-8"}
Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cache-control": "no-store",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
}
NO_KEY = (
    "This address needs the token that skhoid has printed: open the whole address from the "
    "terminal in which `skhoid workbench` runs. A browser that was closed forgets it."
)


@dataclass(frozen=True)
class Keys:
    """The secrets of one server: the token of its address, and what the browser then keeps."""

    token: str = field(default_factory=lambda: secrets.token_urlsafe(32))
    cookie: str = field(default_factory=lambda: secrets.token_urlsafe(32))

    def cookie_name(self, port: int) -> str:
        """Cookies are shared by all ports of a host, so that two servers need two names."""
        return f"skhoid-{port}"


class Guard:
    """ASGI middleware that refuses strangers, and adds headers to every reply."""

    def __init__(self, app: Any, keys: Keys, port: int):
        self.app, self.keys, self.port = app, keys, port
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        from starlette.requests import Request

        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif scope["type"] == "http":
            request = Request(scope)
            answer = self._refuse(request) or self._exchange(request) or self.app
            await answer(scope, receive, _with_headers(send))
        else:
            await send({"type": "websocket.close", "code": 1008})

    def _refuse(self, request: Any) -> Any:
        """The reply to a stranger; None to who may ask."""
        headers = request.headers
        host = headers.get("host", "").lower()
        if host not in self.hosts:  # another name for this machine, made to pass as our page
            return _failed(f"This server answers as 127.0.0.1:{self.port} alone.", 421)
        origin, site = headers.get("origin"), headers.get("sec-fetch-site")
        changes = request.method not in ("GET", "HEAD")
        if (
            (origin is not None and origin.lower() != f"http://{host}")
            or (changes and origin is None and site != "same-origin")
            or (request.url.path != "/" and site not in (None, "same-origin", "none"))
        ):
            return _failed("Requests that do not come from the workbench's own page.", 403)
        kept = request.cookies.get(self.keys.cookie_name(self.port), "")
        bearer = f"Bearer {self.keys.token}"
        known = _same(kept, self.keys.cookie) or _same(headers.get("authorization", ""), bearer)
        return None if known or self._has_token(request) else _failed(NO_KEY, 403)

    def _exchange(self, request: Any) -> Any:
        """Give the browser a cookie for the token, which then leaves the address."""
        from starlette.responses import RedirectResponse

        if not self._has_token(request):
            return None
        reply = RedirectResponse("/", 303)
        name = self.keys.cookie_name(self.port)
        reply.set_cookie(name, self.keys.cookie, httponly=True, samesite="strict")
        return reply

    def _has_token(self, request: Any) -> bool:
        given = request.query_params.getlist("token")
        at_home = request.url.path == "/" and request.method in ("GET", "HEAD")
        return at_home and len(given) == 1 and _same(given[0], self.keys.token)


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            own = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            message["headers"] = [*message.get("headers", []), *own]
        await send(message)

    return sending


@cache
def page() -> str:
    """The page, the same for every session: what is open is asked for by its script."""
    return rendered(__name__, "static/index.html.j2", version=__version__)


@cache
def static(name: str) -> str:
    """A file of the page."""
    return files(__package__).joinpath("static").joinpath(name).read_text(encoding="utf-8")


def make_app(bench: Workbench, keys: Keys, port: int) -> Guard:
    """The ASGI application of a workbench, guarded."""
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

        texts: dict[str, Callable[[], str]] = {
            "bench.js": component.script,
            "bench.css": component.style,
            "start.js": lambda: static("start.js"),
            "start.css": lambda: static("start.css"),
        }
        name = request.path_params["name"]
        if name not in texts:
            return _failed("There is nothing at this address.", 404)
        return Response(texts[name](), media_type=KINDS[name.rpartition(".")[2]])

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
            text = f"The file was not taken: {put_in_words(error)} Nothing of it is left behind."
            return _failed(text, 507)
        return JSONResponse(self.bench.uploaded(path))

    async def act(self, request: Any) -> Any:
        from starlette.responses import JSONResponse, Response

        try:
            asked = await _asked(request)
        except ValueError as error:
            return _failed(str(error), 400)
        bench, name = self.bench, request.path_params["action"]
        plain: dict[str, Callable[[], Any]] = {
            "open": lambda: bench.open(asked.get("files")),
            "columns": lambda: bench.correct(asked),
            "fit": lambda: bench.fit(asked),
            "back": bench.back,
        }
        if name == "prepare":
            return await _tried(lambda: bench.try_preparation(asked), JSONResponse)
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
        return _failed(put_in_words(error), 400, getattr(error, "field", ""))
    except Exception as error:
        text = f"Unexpected error: {type(error).__name__}: {put_in_words(error)} Please report it."
        return _failed(text, 500)
    return answer(found)


def _failed(message: str, status: int, field: str = "") -> Any:
    from starlette.responses import JSONResponse

    return JSONResponse({"message": message, "field": field}, status)


def _saved_as(name: str) -> dict[str, str]:
    return {"content-disposition": f'attachment; filename="{name}"'}


class _TooLarge(ValueError):
    """More bytes than are taken."""


async def _asked(request: Any) -> dict[str, Any]:
    """The arguments of a request."""
    try:
        found = json.loads(await request.body() or b"{}")
    except ValueError as error:
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


def check_installed() -> None:
    """Refuse at once where the extra is not installed."""
    for package in ("starlette", "uvicorn"):
        require(package, "The workbench", EXTRA)


def opened_session(
    folder: str | None, paths: list[Path], choices: Choices
) -> tuple[SessionFolder, dict[str, Any] | None]:
    """The session to go on with, locked, and what it kept; None for a new one.

    Without a name it is the one of the working folder, unless that is about other files: then a
    new one is begun beside it.
    """
    number = 1
    while True:
        name = folder or (FOLDER if number == 1 else f"{FOLDER}-{number}")
        session = SessionFolder(name)
        session.take()
        try:
            kept = session.load()
            if kept is None or not paths or _is_about(kept, paths, choices):
                return session, kept
        except BaseException:
            session.give_back()
            raise
        session.give_back()
        if folder is not None:
            raise ValueError(
                f"The session {session.path} is about other files, or was begun with other "
                "options: leave FILES and options out to go on with it, or name another folder by "
                "--session."
            )
        number += 1


def _is_about(kept: dict[str, Any], paths: list[Path], choices: Choices) -> bool:
    files = [file.get("path") for file in kept.get("files", [])]
    return files == [str(path) for path in paths] and kept.get("asked") == choices.as_dict()


def serve(
    session: SessionFolder,
    kept: dict[str, Any] | None,
    paths: list[Path],
    choices: Choices,
    *,
    port: int | None = None,
    browser: bool = True,
    say: Callable[[str], None] = print,
) -> None:
    """Serve a workbench until Ctrl+C; searches are ended and the session is kept then."""
    keys = Keys()
    bench = Workbench(session, paths, choices)
    try:
        with _listening(port) as listener:
            own_port = listener.getsockname()[1]
            bench.begin(kept)
            server = _server(make_app(bench, keys, own_port), bench)
            address = f"http://{HOST}:{own_port}/?token={keys.token}"
            say(f"The workbench is at {address}")
            say(f"Its session is kept in {session.path}. Ctrl+C ends it.")
            if browser:
                webbrowser.open(address)
            with contextlib.suppress(KeyboardInterrupt), _warnings_on(bench):
                server.run(sockets=[listener])
    finally:
        bench.close()


@contextlib.contextmanager
def _warnings_on(bench: Workbench) -> Iterator[None]:
    """Show what the library warns of on the page, where the user looks."""
    with warnings.catch_warnings():
        before = warnings.showwarning

        def show(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if issubclass(category, UserWarning):
                bench.note(getattr(message, "message", None) or str(message))
            before(message, category, *where, **more)

        warnings.showwarning = show
        yield


def _listening(port: int | None) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port or 0))
    except OSError as error:
        listener.close()
        raise ValueError(
            f"Port {port} cannot be used ({error.strerror}): another program has it, or it needs "
            "other rights. Give another --port, or none for a free one."
        ) from error
    listener.listen()  # a browser that is quicker than the server waits
    return listener


def _server(app: Any, bench: Workbench) -> Any:
    import uvicorn

    class Server(uvicorn.Server):
        async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
            bench.news.close()  # pages listen for ever
            await super().shutdown(sockets)

    config = uvicorn.Config(
        app,
        log_level="error",
        access_log=False,
        lifespan="off",
        server_header=False,
        timeout_graceful_shutdown=GRACE,
    )
    return Server(config)
