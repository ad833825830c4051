"""Requests of the Student tab of one page: one is computed at a time, and the newest comes next."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from tsd_twin.dashboard.server.lease import RpcExecutor
from tsd_twin.dashboard.server.protocol import StudentRequest
from tsd_twin.dashboard.server.student import answer


class StudentSession:
    """Student requests of one page; event loop only, the computation is on the planning thread."""

    def __init__(self, executor: RpcExecutor, send_message: Callable[[Any], None]) -> None:
        self._executor = executor
        self._send_message = send_message
        self._next: StudentRequest | None = None
        self._task: asyncio.Task[None] | None = None

    def request(self, request: StudentRequest) -> None:
        """Answer a request, unless a newer one comes before its turn."""
        self._next = request
        if self._task is None:
            self._task = asyncio.create_task(self._answer())

    def close(self) -> None:
        """Answer no more."""
        self._next = None
        if self._task is not None:
            self._task.cancel()

    async def _answer(self) -> None:
        try:
            while self._next is not None:
                request, self._next = self._next, None
                self._send_message(await self._executor.plan(answer, request))
        finally:
            self._task = None
