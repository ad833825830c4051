"""The controls that a page holds, and what they make of the robot."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from tsd_twin.authority import Mode
from tsd_twin.dashboard import protocol
from tsd_twin.dashboard.control import Control
from tsd_twin.dashboard.desk import Desk
from tsd_twin.dashboard.going import Going
from tsd_twin.dashboard.grip import SILENT_S, Grip, Hold
from tsd_twin.dashboard.mailbox import Mailbox
from tsd_twin.errors import MessageError, PathError
from tsd_twin.messages.ros import BASE
from tsd_twin.motion.follower import Phase

DRIVABLE = (Mode.READY, Mode.DRIVING)

Word: TypeAlias = (
    protocol.Drive
    | protocol.Go
    | protocol.Release
    | protocol.Plan
    | protocol.Pace
    | protocol.Unplan
)
"""What a page says with its hands."""


class Hands:
    """The stick or the button of a way: one dead man's switch; belongs to the event loop."""

    def __init__(
        self,
        desk: Desk,
        mail: Mailbox,
        going: Going,
        post: Callable[[Any], None],
        let_go: Callable[[str], None],
    ) -> None:
        """`let_go`, which calls ours, also tells who else has to know."""
        self.going = going
        self._desk = desk
        self._mail = mail
        self._post = post
        self._let_go = let_go
        self._grip = Grip()
        self._watchdog: asyncio.TimerHandle | None = None

    def obey(self, word: Word) -> None:
        """Act on what the page says.

        Raises:
            MessageError: it is no motion.
        """
        match word:
            case protocol.Drive():
                self._drive(word)
            case protocol.Go():
                self._go(word)
            case protocol.Release():
                self._release()
            case protocol.Plan() | protocol.Pace() | protocol.Unplan():
                self._plan(word)

    def let_go(self, reason: str) -> bool:
        """Put the robot at rest on behalf of the page, and return whether it held a control."""
        self.going.pause()
        held = self._grip.let_go()
        if held:
            if self._desk.control is not None:
                self._desk.control.rest()
            self._post(protocol.Released(reason=reason))
        return held

    def close(self) -> None:
        """Put the robot at rest; the page is gone."""
        if self._watchdog is not None:
            self._watchdog.cancel()
        self._release()
        self.going.drop()

    def _drive(self, message: protocol.Drive) -> None:
        twist = (message.vx, message.vy, message.omega)
        if not all(math.isfinite(value) for value in twist):
            raise MessageError("nonfinite", "a twist must be finite numbers")
        control = self._control_to_move(message.seen)
        if control is not None:
            self.going.drop()  # Hands on the controls.
            self._send(control, twist, message.seen, message.frame)

    def _go(self, message: protocol.Go) -> None:
        control = self._control_to_move(message.seen)
        if control is None:
            return
        try:
            link, now_s = control.link, time.monotonic()
            step = self.going.step(link, message.route, control.max_age_s, now_s)
        except PathError as error:
            self._let_go(str(error))
            return
        if step.phase is Phase.ARRIVED:
            self._grip.let_go()  # The page sees that it is there, and lets go as well.
            control.rest()
        else:
            self._send(control, step.twist.tolist(), message.seen)

    def _plan(self, message: protocol.Plan | protocol.Pace | protocol.Unplan) -> None:
        control = self._desk.control
        match message:
            case protocol.Plan() if control is None:
                self._post(protocol.Answer(to="plan", ok=False, reason="take control first"))
            case protocol.Plan() if control is not None:
                self._let_go("another path is planned")
                self.going.wish(control.link, message)
            case protocol.Pace():
                self.going.pace(message.level)
            case _:
                if self.going.follows:
                    self._let_go("the path is given up")
                self.going.drop()

    def _control_to_move(self, seen: int) -> Control | None:
        """Note that the page holds a control, and return what it may move the robot by."""
        self._mail.seen(seen)
        control = self._desk.control
        if control is None:
            if self._grip.refuse():  # What is held while control changes hands must not set it off.
                self._post(protocol.Released(reason="you do not have control"))
            return None
        if not self._grip.drive(time.monotonic()):
            return None
        if time.monotonic() - control.link.snapshot.received_s > control.max_age_s:
            # The robot stops meanwhile, and may be ready again before the next word of it comes.
            self._let_go(f"the robot has not been heard for {control.max_age_s:g} s")
            return None
        status = control.link.snapshot.status
        if status is None or status.mode not in DRIVABLE:
            # A control that is held while the robot comes to be ready must not set it off.
            self._let_go(f"the robot is {status.mode if status else 'silent'}")
            return None
        return control

    def _send(self, control: Control, twist: Sequence[float], seen: int, frame: str = BASE) -> None:
        control.drive(twist, seen, frame)
        if self._watchdog is None:
            self._watch(SILENT_S)

    def _watch(self, wait_s: float) -> None:
        loop = asyncio.get_running_loop()
        self._watchdog = loop.call_later(wait_s, self._check_silence)

    def _check_silence(self) -> None:
        self._watchdog = None
        if self._grip.hold is not Hold.HELD:
            return
        silent_s = self._grip.silent_for_s(time.monotonic())
        if silent_s >= SILENT_S:
            self._let_go(f"no command from the page for {SILENT_S * 1000:.0f} ms")
        else:
            self._watch(SILENT_S - silent_s)

    def _release(self) -> None:
        self.going.pause()
        if self._grip.release() and self._desk.control is not None:
            self._desk.control.rest()
