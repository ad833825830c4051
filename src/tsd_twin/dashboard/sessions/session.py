"""Live page session, which handles messages of the page and statuses of its robot.

Outgoing states, events and replies have no effect on the robot.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Any

import msgspec

from tsd_twin.client import procedures
from tsd_twin.client.monitor import Snapshot
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.scene.scene_executor import SceneExecutor
from tsd_twin.dashboard.sessions.lease import LeaseClient, RpcExecutor
from tsd_twin.dashboard.sessions.map_data import MapData
from tsd_twin.dashboard.sessions.navigation import NavigationSession
from tsd_twin.dashboard.sessions.principal import Principal, operator_name
from tsd_twin.dashboard.sessions.robot_directory import RobotDirectory
from tsd_twin.dashboard.sessions.send_queue import SendQueue
from tsd_twin.dashboard.sessions.student import StudentSession
from tsd_twin.dashboard.sessions.teleop import TeleopController, TeleopMessage
from tsd_twin.dashboard.wire.from_page import (
    ArmRequest,
    DisarmRequest,
    DisplayMessage,
    DriveCommand,
    FollowPlan,
    LeaseAction,
    LookBack,
    PageHeartbeat,
    PageMessage,
    PanelSlidersReleased,
    ReleaseControls,
    ResetRequest,
    SelectPlotFields,
    SelectRobot,
    SetFrame,
    SetView,
    SetWheelSpeed,
    ShowMap,
    ShowShadow,
    StopCommand,
    StudentRequest,
    decode_page_message,
)
from tsd_twin.dashboard.wire.to_page import (
    ActionReply,
    HeartbeatReply,
    PastState,
    RobotEvent,
    RobotName,
    RobotState,
    SessionInfo,
    ViewChanged,
    encode_message,
)
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.sentences import full_sentence
from tsd_twin.messages.services import Reply
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import Service
from tsd_twin.security import Role

_HOLDER_SERVICES: Mapping[type[ArmRequest | DisarmRequest | ResetRequest], Service] = {
    ArmRequest: Service.ARM,
    DisarmRequest: Service.DISARM,
    ResetRequest: Service.RESET,
}
VIEWER_REFUSAL = because(Code.VIEWER)
_MAX_CONCURRENT_STOPS = 2
"""A second stop starts after the first, so a third would add nothing."""


class PageSession:
    """Base class of page sessions with the page's id and login, outgoing messages and running
    stops.
    """

    def __init__(self, page: str, principal: Principal, name: str) -> None:
        """`principal` owns the page; each page has its own operator id.

        `name` is the name typed by the operator, used only without logins.
        """
        self.page = page
        self.principal = principal
        self.view: ViewSettings | None = None
        self.frame = Rectangle()
        """View settings, if the page or its panel has sent any."""
        self.send_queue = SendQueue()
        self.rejected = 0
        """Number of invalid messages."""
        self._operator = f"{operator_name(principal, name)}-{page[:8]}"
        self._plot_fields: Sequence[str] = ()
        self._shows_map = False
        self._stopping: set[asyncio.Task[None]] = set()

    def reject(self, error: MessageError) -> None:
        """Count an invalid message and reply to it."""
        self.rejected += 1
        if self.rejected == 1:
            self._send(ActionReply(to="message", ok=False, why=error.why))

    def _refuse_stop(self) -> None:
        self._send(ActionReply(to="stop", ok=False, why=VIEWER_REFUSAL))

    def _acknowledge_stop(self, stop: Callable[[], Awaitable[Reply]]) -> None:
        """Send the robot's reply to the page, unless two of its stops are already running."""
        if len(self._stopping) < _MAX_CONCURRENT_STOPS:
            task = asyncio.create_task(self._stop_and_answer(stop))
            self._stopping.add(task)
            task.add_done_callback(self._stopping.discard)

    async def _stop_and_answer(self, stop: Callable[[], Awaitable[Reply]]) -> None:
        reply = await stop()
        self._send(ActionReply(to="stop", ok=reply.ok, why=why_of(reply)))

    def on_view(self, settings: ViewSettings) -> None:
        """Send view settings changed in the panel, which the page should store."""
        self.view = settings
        self._send(ViewChanged(settings=settings))

    def _send_welcome(self, role: Role, robots: Sequence[RobotName], robot: str | None) -> None:
        self._send(
            SessionInfo(
                operator=self._operator,
                role=role,
                user=self.principal.user,
                may_stop=self.principal.may_stop,
                robots=robots,
                robot=robot,
            )
        )

    def _send(self, message: Any) -> None:
        self.send_queue.put(encode_message(message))


class Session(PageSession):
    """Session for a live page on the event loop; calls to a robot run as tasks of the session."""

    def __init__(
        self,
        page: str,
        directory: RobotDirectory,
        executor: RpcExecutor,
        *,
        principal: Principal,
        map_data: MapData,
        scene: SceneExecutor,
        name: str = "",
    ) -> None:
        super().__init__(page, principal, name)
        self.robot_id: str | None = None
        """Selected robot."""
        self._role = principal.identity.role
        self._directory = directory
        self._executor = executor
        self._lease_client = LeaseClient(
            self._operator, executor, self._send, lambda why: self._teleop.release(why)
        )
        self._teleop = TeleopController(
            self._lease_client,
            NavigationSession(page, executor, scene.pick_floor, map_data.show_route, self._send),
            self._send,
            lambda: scene.reset_sliders(page),
        )
        self._student = StudentSession(executor, self._send)
        self._motion: DriveCommand | FollowPlan | None = None
        self._map_data, self._scene = map_data, scene
        self._ago_s: float | None = None
        self._past: Snapshot | None = None
        self._shows_shadow = False

    def on_robots_changed(self) -> None:
        """Send session info with the list of robots; select a robot if none is selected."""
        control = self._lease_client.lease
        if control is not None and (robot := self._directory.robot(control.link.id)) is not None:
            if robot.link is not control.link:
                self._teleop.navigation.clear()
            # The robot has restarted; send nothing to its previous client.
            control.link = robot.link
        names = self._directory.robot_names()
        if self.robot_id is None and names:
            self.robot_id = names[0].id
            self._scene.select_robot(self.page, self.robot_id)
        self._send_welcome(self._role, names, self.robot_id)
        self._send_robot()

    async def close(self) -> None:
        """Stop the motion and release the lease, after the socket has closed."""
        self._motion = None
        self._teleop.close()
        self._student.close()
        await self._lease_client.close()
        self._scene.reset_sliders(self.page)

    # Messages from the page.

    def receive(self, text: str | bytes) -> None:
        """Handle one message; invalid messages raise nothing and allocate nothing.

        A motion command is applied after all messages received with it. A newer one replaces it,
        and a release or a stop cancels it.
        """
        try:
            message = decode_page_message(text)
        except MessageError as error:
            self.reject(error)
            return
        match message:
            case StopCommand():
                pass  # Already published.
            case DriveCommand() | FollowPlan():
                if self._motion is None:
                    asyncio.get_running_loop().call_soon(self._move)
                self._motion = message
                return
            case StudentRequest():
                pass  # Independent of the robot.
            case ReleaseControls():
                self._motion = None
            case _:
                self._move()
        self._try(message)

    def _move(self) -> None:
        message, self._motion = self._motion, None
        if message is not None:
            self.send_queue.acknowledge(message.status_seq)
            self._try(message)

    def _try(self, message: PageMessage) -> None:
        try:
            self._dispatch(message)
        except MessageError as error:
            self.reject(error)

    def _dispatch(self, message: PageMessage) -> None:
        if isinstance(message, TeleopMessage):
            self._teleop.handle(message)
            return
        match message:
            case StopCommand():
                self._stop()
            case PageHeartbeat():
                self._on_heartbeat(message)
            case PanelSlidersReleased():
                if self._role is not Role.VIEWER:  # Viewers have no sliders.
                    self._scene.reset_sliders(self.page)
            case LeaseAction() if self._role is Role.VIEWER:
                self._send(ActionReply(to="lease", ok=False, why=VIEWER_REFUSAL))
            case LeaseAction():
                self._on_lease_action(message)
            case ArmRequest() | DisarmRequest() | ResetRequest() | SetWheelSpeed():
                self._request_as_holder(message)
            case _:
                self._show(message)

    def _show(self, message: DisplayMessage) -> None:
        match message:
            case SelectRobot():
                self.select_robot(message.id)
            case SelectPlotFields():
                self._plot_fields = message.names
            case SetView():
                self.view = message.settings
                self._scene.apply_view(self.page, message.settings, look=message.look)
            case SetFrame():
                self.frame = Rectangle(message.left, message.top, message.right, message.bottom)
                self._scene.set_frame(self.page, self.frame)
            case ShowMap():
                self._shows_map, was_shown = message.on, self._shows_map
                if not was_shown:
                    self.send_map_lines(trails=True)
            case LookBack():
                self._ago_s = message.history_offset_s
                self._show_past()
            case ShowShadow():
                self._shows_shadow = message.on
            case StudentRequest():
                self._student.request(message)

    def _request_as_holder(
        self, message: ArmRequest | DisarmRequest | ResetRequest | SetWheelSpeed
    ) -> None:
        if isinstance(message, SetWheelSpeed):
            self._lease_client.start_request(
                "wheel_speed", self._lease_client.set_wheel_speed(message.cruise_speed_rpm)
            )
        else:
            service = _HOLDER_SERVICES[type(message)]
            self._lease_client.start_request(
                service.name.lower(), self._lease_client.call_service(service)
            )

    def _on_heartbeat(self, message: PageHeartbeat) -> None:
        self._lease_client.on_heartbeat()
        self.send_queue.acknowledge(message.status_seq)
        self._send(HeartbeatReply(sent_ms=message.sent_ms))
        if not message.focus:
            self._teleop.release(because(Code.PAGE_NOT_IN_FRONT))

    def _stop(self) -> None:
        """Publish a stop for the selected robot, release the controls, then await acknowledgement.

        If a replay is selected, this stops every live robot.
        """
        self._motion = None
        if not self.principal.may_stop:
            self._refuse_stop()
            return
        links = self._directory.links_to_stop(self.robot_id)
        for link in links:
            link.send_stop(procedures.stop_payload(self._operator))
        self._teleop.release(because(Code.STOP_PRESSED))
        self._teleop.navigation.clear()
        self._acknowledge_stop(lambda: self._executor.stop_all(links, self._operator))

    def _on_lease_action(self, message: LeaseAction) -> None:
        lease_client = self._lease_client
        robot = self._directory.robot(self.robot_id)
        link = robot.link if robot else None
        match message.op:
            case "acquire":
                work = lease_client.acquire(link, message)
            case "request":
                work = lease_client.request(link, message)
            case "release":
                work = lease_client.release()
            case "withdraw":
                work = lease_client.withdraw()
            case "grant" | "deny":
                work = lease_client.answer_request(message.op, message.requester)
        lease_client.start_request("lease", work)

    def select_robot(self, robot_id: str) -> None:
        """Select another robot and release the lease of the previous one."""
        if robot_id != self.robot_id and not self._lease_client.start_request(
            "robot", self._select_robot(robot_id)
        ):
            self._restore_panel()

    def _restore_panel(self) -> None:
        """Restore the panel's robot selection."""
        if self.robot_id is not None:
            self._scene.select_robot(self.page, self.robot_id)

    async def _select_robot(self, robot_id: str) -> Reply:
        if self._directory.robot(robot_id) is None:
            self._restore_panel()
            return Reply.refused(because(Code.UNKNOWN_ROBOT, robot=robot_id))
        self._teleop.release(because(Code.OTHER_ROBOT_SHOWN))
        self._teleop.navigation.clear()
        await self._lease_client.release_lease()
        self._ago_s = None
        self._show_past()
        self.robot_id, self._plot_fields = robot_id, ()
        self._send_robot()
        self._scene.select_robot(self.page, robot_id)
        return Reply(True)

    # Messages from the robot.

    def decide(self, status: RobotStatus) -> None:
        """Handle a new status of the selected robot, before it is shown."""
        if self.robot_id is None:
            return
        if (lost := self._lease_client.lost_lease()) is not None:
            why = because(Code.CONTROL_IS_LOST, lost)
            self._teleop.release(why)
            text = full_sentence(why)
            self._send(RobotEvent(kind="lease", text=text, why=why, robot_s=0.0))
        self._lease_client.on_lease_status(status.lease)
        self._teleop.decide(self.robot_id, status)

    # Messages to the page.

    def show(self, state: RobotState) -> None:
        """Send a state of the selected robot."""
        held = self._lease_client.lease is not None
        robot = self._directory.robot(self.robot_id)
        state = msgspec.structs.replace(
            state,
            has_control=held and state.status.lease.holder == self._operator,
            route=self._teleop.navigation.route_state,
            plot=self._plot_values(),
            map=self._map_data.state(self.robot_id or "") if self._shows_map else None,
            past=self._show_past(),
            shadow=robot.shadow.report() if self._shows_shadow and robot else None,
        )
        self.send_queue.put_state(state.status_seq, encode_message(state))

    def _show_past(self) -> PastState | None:
        """Draw the past state of the robot, if requested, and return it."""
        ago_s, robot = self._ago_s, self._directory.robot(self.robot_id)
        past = None if ago_s is None or robot is None else robot.past(ago_s)
        if past is not self._past:
            self._past = past
            self._scene.show_past(self.page, past, ago_s or 0.0)
        if ago_s is None or past is None or past.status is None or robot is None:
            return None
        told = robot.telemetry.state(
            past, past.status, past.received_s, mode_age_s=0.0, round_trips=robot.link.round_trips
        )
        return PastState(ago_s, told.status.mode, told.pose, told.twist)

    def _plot_values(self) -> dict[str, float | None]:
        robot = self._directory.robot(self.robot_id) if self._plot_fields else None
        if robot is None:
            return {}
        return robot.telemetry.plot_fields.values(self._plot_fields, robot.link.snapshot)

    def send_map_lines(self, *, trails: bool) -> None:
        """Send paths and, if requested, trails, if the page shows its map."""
        if self._shows_map:
            self._send(self._map_data.lines(trails=trails))

    def send_event(self, event: Event, *, past: bool = False, age_s: float = 0.0) -> None:
        """Send an event of the selected robot."""
        self._send(
            RobotEvent(
                kind=event.kind,
                text=event.text,
                why=why_of(event) or Reason(event.kind),
                robot_s=round(event.robot_s, 3),
                past=past,
                age_s=round(age_s, 3),
            )
        )

    def _send_robot(self) -> None:
        robot = self._directory.robot(self.robot_id)
        if robot is None:
            return
        self.send_queue.drop_states()
        self._send(robot.telemetry.info())
        for age_s, event in self._directory.events(robot.link.id):
            self.send_event(event, past=True, age_s=age_s)
        if (state := self._directory.state(robot.link.id)) is not None:
            self.show(state)
