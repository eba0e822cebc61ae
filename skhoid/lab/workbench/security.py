"""Who may talk to the server: the browser that was given the token, from the server's own page."""

from __future__ import annotations

import json
import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

__all__ = ["Guard", "Keys"]

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
    """ASGI middleware that refuses strangers, and adds headers to every reply.

    Parameters
    ----------
    app : ASGI application
        What may be used by those who are let in.
    keys : Keys
        The secrets of this server.
    port : int
        The port on which it listens.
    """

    def __init__(self, app: Any, keys: Keys, port: int):
        self.app, self.keys, self.port = app, keys, port
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
        elif scope["type"] == "http":
            send = _with_headers(send)
            reply = self._refusal(scope) or self._exchange(scope)
            if reply is None:
                await self.app(scope, receive, send)
            else:
                await _reply(send, *reply)
        else:
            await send({"type": "websocket.close", "code": 1008})

    def _refusal(self, scope: Scope) -> tuple[int, dict[str, str], str] | None:
        headers = _headers(scope)
        host = headers.get("host", "").lower()
        if host not in self.hosts:  # another name for this machine, made to pass as our page
            return _no(421, f"This server answers as 127.0.0.1:{self.port} alone.")
        origin = headers.get("origin")
        if origin is not None and origin.lower() != f"http://{host}":
            return _no(403, "Requests of other pages are refused.")
        site = headers.get("sec-fetch-site")
        if scope["method"] not in ("GET", "HEAD") and origin is None and site != "same-origin":
            return _no(403, "Requests that do not come from the workbench's own page are refused.")
        if scope["path"] != "/" and site not in (None, "same-origin", "none"):
            return _no(403, "Requests of other pages are refused.")
        if not self._is_known(scope, headers):
            return _no(403, NO_KEY)
        return None

    def _is_known(self, scope: Scope, headers: dict[str, str]) -> bool:
        kept = _cookie(headers.get("cookie", ""), self.keys.cookie_name(self.port))
        if kept is not None and _same(kept, self.keys.cookie):
            return True
        return _has_token(scope, self.keys.token) or _same(
            headers.get("authorization", ""), f"Bearer {self.keys.token}"
        )

    def _exchange(self, scope: Scope) -> tuple[int, dict[str, str], str] | None:
        """Give the browser a cookie for the token, which then leaves the address."""
        if scope["path"] != "/" or not _has_token(scope, self.keys.token):
            return None
        cookie = (
            f"{self.keys.cookie_name(self.port)}={self.keys.cookie}; "
            "Path=/; HttpOnly; SameSite=Strict"
        )
        return 303, {"location": "/", "set-cookie": cookie}, ""


def _has_token(scope: Scope, token: str) -> bool:
    if scope["path"] != "/" or scope["method"] not in ("GET", "HEAD"):
        return False
    query = scope.get("query_string", b"").decode("latin-1")
    given = parse_qs(query, keep_blank_values=True).get("token", [])
    return len(given) == 1 and _same(given[0], token)


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


def _headers(scope: Scope) -> dict[str, str]:
    """Of a header that stands twice nothing is believed: its values are joined, as in a list."""
    found: dict[str, str] = {}
    for name, value in scope["headers"]:
        key, text = name.decode("latin-1").lower(), value.decode("latin-1")
        found[key] = f"{found[key]}, {text}" if key in found else text
    return found


def _cookie(text: str, name: str) -> str | None:
    try:
        found = SimpleCookie(text).get(name)
    except CookieError:
        return None
    return None if found is None else found.value


def _no(status: int, message: str) -> tuple[int, dict[str, str], str]:
    return status, {"content-type": "application/json"}, json.dumps({"message": message})


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            own = {name.lower() for name, _ in message.get("headers", [])}
            message["headers"] = [
                *message.get("headers", []),
                *(
                    (name.encode(), value.encode())
                    for name, value in HEADERS.items()
                    if name.encode() not in own
                ),
            ]
        await send(message)

    return sending


async def _reply(send: Send, status: int, headers: dict[str, str], text: str) -> None:
    body = text.encode()
    listed = [(name.encode(), value.encode()) for name, value in headers.items()]
    listed.append((b"content-length", str(len(body)).encode()))
    await send({"type": "http.response.start", "status": status, "headers": listed})
    await send({"type": "http.response.body", "body": body})
