"""Websocket over TLS for code that blocks: the asyncio client, on a thread of its own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Generator, Iterator
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosedOK

T = TypeVar("T")


class TlsConnection:
    """Open websocket over TLS, with the methods that a `Page` uses; from `tls_connection`."""

    def __init__(self, loop: asyncio.AbstractEventLoop, url: str, options: dict[str, Any]) -> None:
        self._loop = loop
        self._connection = self._run(_opened(url, options))

    def send(self, message: str | bytes) -> None:
        self._run(self._connection.send(message))

    def __iter__(self) -> Iterator[str | bytes]:
        with suppress(ConnectionClosedOK):
            while True:
                yield self._run(self._connection.recv())

    def close(self) -> None:
        self._run(self._connection.close())

    @property
    def close_code(self) -> int | None:
        return self._connection.close_code

    @property
    def close_reason(self) -> str | None:
        return self._connection.close_reason

    def _run(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()


async def _opened(url: str, options: dict[str, Any]) -> ClientConnection:
    return await connect(url, **options)


@contextmanager
def tls_connection(url: str, **options: Any) -> Generator[TlsConnection]:
    """Yield an open websocket; `options` are those of the asyncio client of `websockets`.

    Its synchronous client reads and writes one TLS connection on two threads: on a busy machine one
    in two hundred handshakes with any server never ends.
    """
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    try:
        connection = TlsConnection(loop, url, options)
        try:
            yield connection
        finally:
            connection.close()
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
