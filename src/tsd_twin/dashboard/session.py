"""One page: every rule between its messages and the robot."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from tsd_twin.access import Role
from tsd_twin.dashboard import protocol
from tsd_twin.dashboard.calls import Calls
from tsd_twin.dashboard.desk import Desk
from tsd_twin.dashboard.floor import Picture
from tsd_twin.dashboard.going import Going
from tsd_twin.dashboard.hands import DRIVABLE, Hands
from tsd_twin.dashboard.mailbox import Mailbox
from tsd_twin.dashboard.roster import Roster
from tsd_twin.dashboard.visitor import Visitor
from tsd_twin.errors import MessageError
from tsd_twin.messages.service import Event, Reply
from tsd_twin.topics import Service

_OF_THE_HOLDER: Mapping[type[protocol.Arm | protocol.Disarm | protocol.Reset], Service] = {
    protocol.Arm: Service.ARM,
    protocol.Disarm: Service.DISARM,
    protocol.Reset: Service.RESET,
}
_WATCHES = "a viewer only watches"
_STOPS_AT_ONCE = 2
"""The second begins after the first, so a third would say nothing new."""


class Session:
    """Everything happens on the event loop; what waits for a robot is a task of this session."""

    def __init__(
        self,
        page: str,
        roster: Roster,
        calls: Calls,
        on_released: Callable[[str], None],
        on_chosen: Callable[[str, str], None],
        *,
        visitor: Visitor,
        picture: Picture,
    ) -> None:
        """`visitor` is whose page this is; each of theirs has an operator id of its own."""
        self.page = page
        self.visitor = visitor
        self.mail = Mailbox()
        self.robot_id: str | None = None
        """The robot that is watched."""
        self.rejected = 0
        """Messages that were none."""
        self._operator = f"{visitor.identity.name}-{page[:8]}"
        self._role = visitor.identity.role
        self._roster = roster
        self._calls = calls
        self._on_released, self._on_chosen = on_released, on_chosen
        self._desk = Desk(self._operator, calls, self._post, self.let_go)
        going = Going(page, calls, picture, self._post)
        self._hands = Hands(self._desk, self.mail, going, self._post, self.let_go)
        self._stops: int | None = None
        self._stopping: set[asyncio.Task[None]] = set()
        self._motion: protocol.Drive | protocol.Go | None = None

    def fleet_changed(self) -> None:
        """Say who the page is and which robots there are; show it one."""
        control = self._desk.control
        if control is not None and (view := self._roster.view(control.link.id)) is not None:
            if view.link is not control.link:
                self._hands.going.drop()
            control.link = view.link  # It was away for a moment; the link of before hears nothing.
        names = self._roster.names()
        if self.robot_id is None and names:
            self.robot_id = names[0].id
            self._on_chosen(self.page, self.robot_id)
        self._post(
            protocol.Welcome(
                operator=self._operator,
                role=self._role,
                user=self.visitor.user,
                may_stop=self.visitor.may_stop,
                robots=names,
                robot=self.robot_id,
            )
        )
        self._show_robot()

    async def close(self) -> None:
        """Put the robot at rest and give control back; the socket is closed or lost."""
        self._motion = None
        self._hands.close()
        await self._desk.close()
        self._on_released(self.page)

    # From the page.

    def receive(self, text: str | bytes) -> None:
        """Act on one message; whatever it is, nothing is raised and nothing grows.

        A motion waits until all that has arrived with it is read: the newest replaces those before,
        and a release or a stop takes them back.
        """
        try:
            message = protocol.decode(text)
        except MessageError as error:
            self.reject(str(error))
            return
        match message:
            case protocol.Drive() | protocol.Go():
                if self._motion is None:
                    asyncio.get_running_loop().call_soon(self._move)
                self._motion = message
                return
            case protocol.Release() | protocol.Stop():
                self._motion = None
            case _:
                self._move()
        self._try(message)

    def _move(self) -> None:
        message, self._motion = self._motion, None
        if message is not None:
            self._try(message)

    def _try(self, message: protocol.FromPage) -> None:
        try:
            self._obey(message)
        except MessageError as error:
            self.reject(str(error))

    def reject(self, reason: str) -> None:
        """Count what is no message; the page is told once."""
        self.rejected += 1
        if self.rejected == 1:
            self._post(protocol.Answer(to="message", ok=False, reason=reason))

    def _obey(self, message: protocol.FromPage) -> None:
        match message:
            case (
                protocol.Drive()
                | protocol.Go()
                | protocol.Release()
                | protocol.Plan()
                | protocol.Pace()
                | protocol.Unplan()
            ):
                self._hands.obey(message)
            case protocol.Beat():
                self._beat(message)
            case protocol.PanelReleased():
                if self._role is not Role.VIEWER:  # Who only watches has no sliders.
                    self._on_released(self.page)
            case protocol.Stop():
                self._stop()
            case protocol.Choose():
                self.choose(message.id)
            case protocol.AskLease() if self._role is Role.VIEWER:
                self._post(protocol.Answer(to="lease", ok=False, reason=_WATCHES))
            case protocol.AskLease():
                self._lease(message)
            case protocol.Arm() | protocol.Disarm() | protocol.Reset() | protocol.ChooseSpeed():
                self._ask_as_holder(message)

    def _ask_as_holder(
        self, message: protocol.Arm | protocol.Disarm | protocol.Reset | protocol.ChooseSpeed
    ) -> None:
        if isinstance(message, protocol.ChooseSpeed):
            self._desk.ask("speed", self._desk.choose_speed(message.cruise_speed_rpm))
        else:
            service = _OF_THE_HOLDER[type(message)]
            self._desk.ask(service.name.lower(), self._desk.serve(service))

    def let_go(self, reason: str) -> None:
        """Put the robot at rest on behalf of the page, if it holds a control."""
        if self._hands.let_go(reason):
            self._on_released(self.page)

    def _beat(self, message: protocol.Beat) -> None:
        self._desk.beat()
        self.mail.seen(message.seen)
        self._post(protocol.Echo(sent_ms=message.sent_ms))
        if not message.focus:
            self.let_go("the page is not in front")

    def _stop(self) -> None:
        if not self.visitor.may_stop:
            self._post(protocol.Answer(to="stop", ok=False, reason=_WATCHES))
            return
        self.let_go("software stop")
        self._hands.going.drop()
        if len(self._stopping) < _STOPS_AT_ONCE:
            task = asyncio.create_task(self._stop_and_answer())
            self._stopping.add(task)
            task.add_done_callback(self._stopping.discard)

    async def _stop_and_answer(self) -> None:
        view = self._roster.view(self.robot_id)
        reply = Reply(False, "no robot is shown")
        if view is not None:
            reply = await self._calls.stop(view.link, self._operator)
        self._post(protocol.Answer(to="stop", ok=reply.ok, reason=reply.reason))

    def _lease(self, message: protocol.AskLease) -> None:
        desk = self._desk
        view = self._roster.view(self.robot_id)
        link = view.link if view else None
        match message.op:
            case "acquire":
                desk.ask("lease", desk.acquire(link, message))
            case "request":
                desk.ask("lease", desk.request(link, message))
            case "release":
                desk.ask("lease", desk.release())
            case "withdraw":
                desk.ask("lease", desk.withdraw())
            case "grant" | "keep":
                desk.ask("lease", desk.answer(message.op, message.asker))

    def choose(self, robot_id: str) -> None:
        """Turn to another robot: control of the one before is given up."""
        if robot_id != self.robot_id and not self._desk.ask("robot", self._choose(robot_id)):
            self._turn_back()

    def _turn_back(self) -> None:
        """Let the panel show the robot again that its sliders drive."""
        if self.robot_id is not None:
            self._on_chosen(self.page, self.robot_id)

    async def _choose(self, robot_id: str) -> Reply:
        if self._roster.view(robot_id) is None:
            self._turn_back()
            return Reply(False, f"there is no robot {robot_id}")
        self.let_go("another robot is shown")
        self._hands.going.drop()
        await self._desk.give_up()
        self.robot_id, self._stops = robot_id, None
        self._show_robot()
        self._on_chosen(self.page, robot_id)
        return Reply(True)

    # To the page.

    def show(self, state: protocol.State) -> None:
        """Send a new state of the robot that is watched."""
        control, lease = self._desk.control, state.status.lease
        if control is not None and control.is_lost(state.status):
            self._lost(f"{lease.holder} has taken over" if lease.holder else "it has run out")
            control = None
        self._desk.hear(lease)
        if state.status.mode not in DRIVABLE:
            self.let_go(f"the robot is {state.status.mode}")
        if self._stops not in (None, state.status.stops):
            # It may be ready again by now: a stop can be shorter than the time between two states.
            self.let_go("the robot has stopped by itself")
        self._stops = state.status.stops
        if control is None:
            self._hands.going.drop()
        self._hands.going.tick()
        you = control is not None and lease.holder == self._operator
        state = msgspec.structs.replace(state, you=you, route=self._hands.going.shown)
        self.mail.state(state.seen, protocol.encode(state))

    def tell(self, event: Event, *, past: bool = False) -> None:
        """Send an event of the robot that is watched."""
        self._post(protocol.Happened.of(event, past=past))

    def _lost(self, reason: str) -> None:
        self.let_go(f"control is lost: {reason}")
        self._desk.lost()
        self._post(
            protocol.Happened(kind="lease", text=f"You have lost control: {reason}.", robot_s=0.0)
        )

    def _show_robot(self) -> None:
        view = self._roster.view(self.robot_id)
        if view is None:
            return
        self.mail.forget_states()
        self._post(view.card())
        for event in self._roster.events(view.link.id):
            self.tell(event, past=True)
        if (state := self._roster.state(view.link.id)) is not None:
            self.show(state)

    def _post(self, message: Any) -> None:
        self.mail.post(protocol.encode(message))
