"""News for all pages that are open: server-sent events, from any thread."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import AsyncIterator
from typing import Any

__all__ = ["News"]

QUIET = 15.0  # s, after which a comment keeps the connection alive
MOST = 100  # messages that wait for one page, before it is told to ask anew


class News:
    """What has changed, told to every page that listens."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._listeners: dict[asyncio.Queue[Any], asyncio.AbstractEventLoop] = {}
        self.counts = {"state": 0, "opening": 0}
        self._closed = False

    def tell(self, *changed: str, **more: Any) -> None:
        """Tell that "state" or "opening" has changed, and more."""
        with self._lock:
            for name in changed:
                self.counts[name] += 1
            message = {**self.counts, **more}
            listeners = list(self._listeners.items())
        for queue, loop in listeners:
            _put(queue, loop, message)

    def close(self) -> None:
        """End all connections: no page is to hold up the end of the server."""
        with self._lock:
            self._closed = True
            listeners = list(self._listeners.items())
        for queue, loop in listeners:
            _put(queue, loop, None)

    async def stream(self) -> AsyncIterator[str]:
        """Messages for one page, beginning with how things are."""
        queue: asyncio.Queue[Any] = asyncio.Queue()
        with self._lock:
            if self._closed:
                return
            self._listeners[queue] = asyncio.get_running_loop()
            message: Any = dict(self.counts)
        try:
            while message is not None:
                yield f"data: {json.dumps(message)}\n\n"
                message = await self._next(queue)
                while message == "":
                    yield ": still here\n\n"
                    message = await self._next(queue)
        finally:
            with self._lock:
                self._listeners.pop(queue, None)

    async def _next(self, queue: asyncio.Queue[Any]) -> Any:
        try:
            message = await asyncio.wait_for(queue.get(), QUIET)
        except TimeoutError:
            return ""
        while queue.qsize() > MOST and message is not None:  # of a page that sleeps, the last
            message = queue.get_nowait()
        return message


def _put(queue: asyncio.Queue[Any], loop: asyncio.AbstractEventLoop, message: Any) -> None:
    try:
        loop.call_soon_threadsafe(queue.put_nowait, message)
    except RuntimeError:  # its loop has ended, and the page with it
        return
