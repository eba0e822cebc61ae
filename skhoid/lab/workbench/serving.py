"""Start the server on this machine alone, show the page, and end cleanly."""

from __future__ import annotations

import contextlib
import socket
import warnings
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ...io._table import require
from .app import EXTRA, make_app
from .bench import Workbench
from .choices import Choices
from .security import Keys
from .session import SessionFolder

__all__ = ["FOLDER", "check_installed", "opened_session", "serve"]

HOST = "127.0.0.1"
FOLDER = "skhoid-workbench"
GRACE = 3  # s, for replies that are under way when the server ends


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
    """Serve a workbench until Ctrl+C; searches are ended and the session is kept then.

    Parameters
    ----------
    session : SessionFolder
        Locked; it is unlocked at the end.
    kept : dict or None
        What it kept.
    paths : list of Path
        Files to begin with.
    choices : Choices
        What is said of them.
    port : int or None, default=None
        Port to listen on; None takes a free one.
    browser : bool, default=True
        Open the page in the browser.
    say : callable, default=print
        Told the address.
    """
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
                bench.note(str(message))
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
