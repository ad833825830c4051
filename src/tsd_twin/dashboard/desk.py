"""Where one page asks for control of a robot, and for what only its holder may ask."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any, Literal

from tsd_twin.dashboard.asking import Asking, News
from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.control import Control, acquire
from tsd_twin.dashboard.link import RobotLink
from tsd_twin.dashboard.protocol import Answer, AskLease
from tsd_twin.messages.service import Reply
from tsd_twin.messages.status import LeaseStatus
from tsd_twin.topics import Service

BEAT_S = 2.0
"""A page without a beat for this long is gone or asleep, and loses control."""
RENEW_S = 0.5
"""The lease is renewed this often."""


class Desk:
    """One request at a time; each is answered, and what it waits for blocks nobody else."""

    def __init__(
        self,
        operator: str,
        calls: Calls,
        answer: Callable[[Answer], None],
        let_go: Callable[[str], None],
    ) -> None:
        self.control: Control | None = None
        """What the page has control of."""
        self._wanted: Asking | None = None
        self._operator = operator
        self._calls = calls
        self._answer = answer
        self._let_go = let_go
        self._beat_s = time.monotonic()
        self._asking: asyncio.Task[None] | None = None
        self._keeping: asyncio.Task[None] | None = None

    def beat(self) -> None:
        """Note that the page lives."""
        self._beat_s = time.monotonic()

    def ask(self, what: str, work: Coroutine[Any, Any, Reply]) -> bool:
        """Begin `work` and answer with what it returns; False if a request is under way."""
        if self._asking is not None and not self._asking.done():
            work.close()
            self._answer(Answer(to=what, ok=False, reason="the last request is still under way"))
            return False
        self._asking = asyncio.create_task(self._ask(what, work))
        return True

    async def _ask(self, what: str, work: Coroutine[Any, Any, Reply]) -> None:
        reply = await work
        self._answer(Answer(to=what, ok=reply.ok, reason=reply.reason))

    async def close(self) -> None:
        """Finish the request under way, which may be about to get control, and give control up."""
        if self._asking is not None:
            await asyncio.wait([self._asking])
        await self.give_up()

    def hear(self, lease: LeaseStatus) -> None:
        """Take control once the holder has granted it, for a page that is still there."""
        wanted = self._wanted
        if wanted is None or (self._asking is not None and not self._asking.done()):
            return
        if time.monotonic() - self._beat_s > BEAT_S:
            self.ask("lease", self.withdraw())
            return
        match wanted.news(lease):
            case News.OURS:
                self._wanted = None
                self.ask("lease", self.acquire(wanted.link, wanted.wish))
            case News.OVER:
                self._wanted = None
            case News.WAITING:
                pass

    # Requests.

    async def acquire(self, link: RobotLink | None, wish: AskLease) -> Reply:
        """Take control."""
        if link is None:
            return Reply(False, "no robot is shown")
        self._let_go("control is asked for")
        await self.give_up()
        control = await acquire(
            link,
            self._operator,
            self._calls,
            take_over=wish.take_over,
            max_age_s=wish.max_age_s,
            reason=wish.reason,
        )
        if isinstance(control, str):
            return Reply(False, control)
        self.control = control
        self._keeping = asyncio.create_task(self._keep(control))
        return Reply(True)

    async def request(self, link: RobotLink | None, wish: AskLease) -> Reply:
        """Ask the holder for control; `hear` takes it when it is granted."""
        if link is None:
            return Reply(False, "no robot is shown")
        self._let_go("control is asked for")
        await self.give_up()
        asking = Asking(link, self._operator, wish, self._calls)
        reply = await asking.ask()
        if reply.ok:
            self._wanted = asking
        return reply

    async def withdraw(self) -> Reply:
        """Ask for control no longer."""
        wanted, self._wanted = self._wanted, None
        if wanted is None:
            return Reply(False, "you do not ask for control")
        return await wanted.withdraw()

    async def answer(self, op: Literal["grant", "keep"], asker: str | None) -> Reply:
        """Answer who asks for control; who grants it has let go first."""
        control = self.control
        if control is None:
            return Reply(False, "take control first")
        if op == "grant":
            self._let_go("control is handed over")
        reply = await control.answer(op, asker)
        if reply.ok and op == "grant" and self.control is control:
            self.lost()
        return reply

    async def release(self) -> Reply:
        """Release control."""
        self._let_go("control was released")
        await self.give_up()
        return Reply(True)

    async def serve(self, service: Service) -> Reply:
        """Ask the robot for what only the holder may."""
        if self.control is None:
            return Reply(False, "take control first")
        return await self.control.ask(service)

    async def choose_speed(self, cruise_speed_rpm: float) -> Reply:
        """Ask the robot to spin its wheels at another speed; its answer says what it can."""
        if self.control is None:
            return Reply(False, "take control first")
        return await self.control.choose_speed(cruise_speed_rpm)

    # Control.

    async def give_up(self) -> None:
        """Give control back to the robot, if there is any, and ask for it no longer."""
        control, wanted = self.control, self._wanted
        self._wanted = None
        self.lost()
        if wanted is not None:
            await wanted.withdraw()
        if control is not None:
            await control.release()

    def lost(self) -> None:
        """Control is gone already."""
        self.control = None
        if self._keeping is not None:
            self._keeping.cancel()
            self._keeping = None

    async def _keep(self, control: Control) -> None:
        """Keep the lease for as long as the page shows signs of life."""
        while time.monotonic() - self._beat_s <= BEAT_S:
            await control.renew()
            await asyncio.sleep(RENEW_S)
        self._let_go("no sign of life from the page")
        self._keeping = None  # Giving up ends it, and it is this.
        await self.give_up()
