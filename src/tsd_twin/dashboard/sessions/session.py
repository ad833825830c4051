"""Live page session, which handles messages of the page and statuses of its robot.

Outgoing states, events and replies have no effect on the robot.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping

import msgspec
from aiohttp import WSMsgType

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene.client_nodes import StudentPose
from tsd_twin.dashboard.scene.client_views import SceneExecutor
from tsd_twin.dashboard.sessions.lease import LeaseClient
from tsd_twin.dashboard.sessions.map_data import MapData
from tsd_twin.dashboard.sessions.navigation import NavigationSession
from tsd_twin.dashboard.sessions.other_robots import OtherRobots
from tsd_twin.dashboard.sessions.page_session import (
    VIEWER_REFUSAL,
    WATCH_REFUSAL,
    PageSession,
    PageSocket,
)
from tsd_twin.dashboard.sessions.previews import LookBackSession, PreviewSession
from tsd_twin.dashboard.sessions.principal import shown_name
from tsd_twin.dashboard.sessions.send_queue import Lane
from tsd_twin.dashboard.sessions.stops import LiveRobots
from tsd_twin.dashboard.sessions.student import StudentSession
from tsd_twin.dashboard.sessions.teleop import TeleopController
from tsd_twin.dashboard.wire.from_page import (
    ArmRequest,
    DisarmRequest,
    DisplayMessage,
    DriveCommand,
    FollowPlan,
    HolderMessage,
    LaneMessage,
    LeaseAction,
    LookBack,
    MotionMessage,
    PageHeartbeat,
    PageMessage,
    PreviewRequest,
    ReleaseControls,
    ResetRequest,
    SelectRobot,
    SetName,
    SetWheelSpeed,
    ShowMap,
    ShowShadow,
    StopCommand,
    StudentRequest,
    TeleopMessage,
    decode_page_message,
)
from tsd_twin.dashboard.wire.to_page import (
    ActionReply,
    MapState,
    RobotEvent,
    RobotState,
    encode_message,
)
from tsd_twin.messages.codes import Code, Reason, because
from tsd_twin.messages.commands import why_of
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.events import Event
from tsd_twin.messages.services import Reply
from tsd_twin.messages.status import RobotStatus
from tsd_twin.messages.topics import Service
from tsd_twin.security import Role

_HOLDER_SERVICES: Mapping[type[ArmRequest | DisarmRequest | ResetRequest], Service] = {
    ArmRequest: Service.ARM,
    DisarmRequest: Service.DISARM,
    ResetRequest: Service.RESET,
}

_KEPT_STOPS = 64


class Session(PageSession):
    """Session for a live page on the event loop; calls to a robot run as tasks of the session."""

    def __init__(
        self, socket: PageSocket, live: LiveRobots, scene: SceneExecutor, map_data: MapData
    ) -> None:
        super().__init__(socket, live, scene)
        self._sent_link: RobotMonitor | None = None
        self._role, page = self.principal.identity.role, self.page
        self._directory, executor = self._live.directory, live.executor
        self._lease_client = LeaseClient(
            self._operator, executor, self.send, lambda why: self._teleop.release(why)
        )
        self._lease_client.set_name(self._stops.name)
        self._others = OtherRobots(self._directory.links, scene.reach_m)
        navigation = NavigationSession(
            page,
            executor,
            scene.pick_floor,
            map_data.show_route,
            self.send,
            self._others.discs,
        )
        self._teleop = TeleopController(self._lease_client, navigation, self.send)
        self._student = StudentSession(executor, self.send, self._show_student)
        self._look_back = LookBackSession(page, self._directory, scene)
        self._preview = PreviewSession(page, self._directory, scene, self._queue)
        self._motion: DriveCommand | FollowPlan | None = None
        self._motion_number = 0
        self._stop_numbers: deque[int] = deque(maxlen=_KEPT_STOPS)
        self._selection = 0
        self._map_data = map_data
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
            self._show_robot(names[0].id)
        self._send_welcome(self._role, names)
        self._send_robot()

    async def open(self) -> None:
        """Send session info and the selected robot."""
        self.on_robots_changed()

    async def close(self) -> None:
        """Stop the motion and release the lease, after the socket has closed."""
        self._motion = None
        self._teleop.close()
        self._student.close()
        self._preview.end()
        await self._lease_client.close()  # First, because lanes may deliver commands until the end.
        await asyncio.gather(*(lane.socket.close() for lane in self._queue.lanes))

    @property
    def lane_count(self) -> int:
        """Number of open lanes."""
        return len(self._queue.lanes)

    async def run_lane(self, opened: PageSocket) -> None:
        """Exchange motion messages, heartbeats, stops and states over a lane until it is closed."""
        lane = Lane(opened.socket)
        sending = asyncio.create_task(lane.run())
        self._queue.add_lane(lane)
        try:
            with opened.holding:
                async for message in opened.messages:
                    if message.type is WSMsgType.TEXT:
                        self.receive(message.data, lane)
        finally:
            self._queue.remove_lane(lane)
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    def _show_student(self, pose: StudentPose | None) -> None:
        self._scene.draw(self.page, "student", lambda view: view.show_student(pose))

    # Messages from the page.

    def receive(self, text: str | bytes, lane: Lane | None = None) -> None:
        """Handle one message; invalid messages raise nothing and allocate nothing.

        A motion command is applied after all messages received with it. A newer one replaces it,
        and a release or a stop cancels it.
        """
        try:
            message = decode_page_message(text)
            if lane is not None:
                _check_lane_message(message)
        except MessageError as error:
            self.reject(error)
            return
        if self._is_overtaken(message):
            return
        match message:
            case StopCommand():
                pass  # Already published.
            case PageHeartbeat():
                self._echo(message, lane)
                self._move()
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

    def _is_overtaken(self, message: PageMessage) -> bool:
        """Return whether a message over another socket has made this one void."""
        match message:
            case StopCommand():
                return self._is_copy(message)
            case MotionMessage():
                return self._is_late(message)
            case _:
                return False

    def _is_late(self, message: MotionMessage) -> bool:
        """Return whether a newer one has arrived over another socket, or the robot is another."""
        if message.number > 0:
            if message.number <= self._motion_number:
                return True
            self._motion_number = message.number
        stops = isinstance(message, ReleaseControls)
        return not stops and message.selection not in (0, self._selection)

    def _is_copy(self, message: StopCommand) -> bool:
        """Return whether the same press of STOP has arrived over another socket."""
        if message.number in self._stop_numbers:
            return True
        if message.number > 0:
            self._stop_numbers.append(message.number)
        return False

    def _move(self) -> None:
        message, self._motion = self._motion, None
        if message is not None:
            self._queue.acknowledge(message.status_seq)
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
                self._stop_robots(message)
            case SetName():
                self._rename(message)
            case PageHeartbeat():
                self._on_heartbeat(message)
            case LeaseAction() if (why := self._control_refusal()) is not None:
                self.send(ActionReply(to="lease", ok=False, why=why))
            case LeaseAction():
                self._on_lease_action(message)
            case ArmRequest() | DisarmRequest() | ResetRequest() | SetWheelSpeed():
                self._request_as_holder(message)
            case _:
                self._show(message)

    def _control_refusal(self) -> Reason | None:
        """Return why the page may not control its robot, if so."""
        if self._role is Role.VIEWER:
            return VIEWER_REFUSAL
        watched = self.robot_id is not None and not self.principal.rights.may_use(self.robot_id)
        return WATCH_REFUSAL if watched else None

    def _show(self, message: DisplayMessage | LookBack | PreviewRequest) -> None:
        match message:
            case SelectRobot():
                self.select_robot(message.id)
            case ShowMap():
                self._shows_map, was_shown = message.on, self._shows_map
                if not was_shown:
                    self.send_map_lines(trails=True)
            case ShowShadow():
                self._shows_shadow = message.on
            case LookBack():
                self._look_back.request(self.robot_id, message.history_offset_s)
            case StudentRequest():
                self._student.request(message)
            case PreviewRequest():
                self._preview.request(self.robot_id, message.twist)
            case _:
                self._handle_common(message)

    def _request_as_holder(self, message: HolderMessage) -> None:
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
        self._handle_common(message)
        if not message.focus:
            self._teleop.release(because(Code.PAGE_NOT_IN_FRONT))

    def _stop_robots(self, message: StopCommand) -> None:
        """Publish a stop, then release the controls unless they move another robot."""
        links = self._stop(message, self.robot_id)
        lease, names_view = self._lease_client.lease, message.robot is None and not message.all
        if lease is None or names_view or lease.link.id in {link.id for link in links}:
            self._motion = None
            self._teleop.release(because(Code.STOP_PRESSED))
            self._teleop.navigation.clear()

    def _rename(self, message: SetName) -> None:
        self._stops.name = shown_name(self.principal, message.name)
        self._lease_client.set_name(self._stops.name)
        self._send_welcome(self._role, self._directory.robot_names())

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
        if robot_id != self.robot_id:
            self._lease_client.start_request("robot", self._select_robot(robot_id))

    async def _select_robot(self, robot_id: str) -> Reply:
        if self._directory.robot(robot_id) is None:
            return Reply.refused(because(Code.UNKNOWN_ROBOT, robot=robot_id))
        self._teleop.release(because(Code.OTHER_ROBOT_SHOWN))
        self._teleop.navigation.clear()
        await self._lease_client.release_lease()
        self._look_back.request(self.robot_id, None)
        self._preview.end()
        self._plot_fields = ()
        self._show_robot(robot_id)
        self._send_robot()
        return Reply(True)

    # Messages from the robot.

    def decide(self, status: RobotStatus) -> None:
        """Handle a new status of the selected robot, before it is shown."""
        if self.robot_id is None:
            return
        if (lost := self._lease_client.lost_lease()) is not None:
            why = because(Code.CONTROL_IS_LOST, lost)
            self._teleop.release(why)
            self.send(RobotEvent(kind="lease", why=why))
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
            camera=self._scene.camera_state(self.page),
            selection=self._selection,
            map=self._map_state() if self._shows_map else None,
            stop_reaches=self._stop_reaches(),
            past=self._look_back.show(self.robot_id),
            shadow=robot.shadow.report() if self._shows_shadow and robot else None,
        )
        self._queue.put_state(state.status_seq, encode_message(state))
        self._preview.refresh()

    def _map_state(self) -> MapState:
        return self._directory.on_map(self._map_data.state(self.robot_id or ""))

    def _stop_reaches(self) -> str | None:
        robot = self._directory.robot(self.robot_id)
        if robot is None:
            return None
        return self._others.reached_by(robot.link, self._scene.envelope(robot.link.id))

    def _plot_values(self) -> dict[str, float | None]:
        robot = self._directory.robot(self.robot_id) if self._plot_fields else None
        if robot is None:
            return {}
        return robot.telemetry.plot_fields.values(self._plot_fields, robot.link.snapshot)

    def send_map_lines(self, *, trails: bool) -> None:
        """Send paths and, if requested, trails, if the page shows its map."""
        if self._shows_map:
            self.send(self._directory.lines_on_map(self._map_data.lines(trails=trails)))

    def send_event(self, event: Event, *, past: bool = False, age_s: float = 0.0) -> None:
        """Send an event of the selected robot."""
        why = why_of(event) or Reason(event.kind)
        self.send(RobotEvent(kind=event.kind, why=why, past=past, age_s=round(age_s, 3)))

    def _send_robot(self) -> None:
        robot = self._directory.robot(self.robot_id)
        if robot is None:
            return
        if robot.link is not self._sent_link:  # Its numbers start again.
            self._sent_link = robot.link
            self._selection += 1
            self._queue.drop_states()
        self.send(msgspec.structs.replace(robot.telemetry.info(), selection=self._selection))
        for age_s, event in self._directory.events(robot.link.id):
            self.send_event(event, past=True, age_s=age_s)
        if (state := self._directory.state(robot.link.id)) is not None:
            self.show(state)


def _check_lane_message(message: PageMessage) -> None:
    """Check that a message does not depend on the order of sockets.

    Raises:
        MessageError: With code `shape` otherwise.
    """
    if not isinstance(message, LaneMessage):
        raise MessageError("shape", "not a message for a lane")
    if isinstance(message, MotionMessage) and message.number == 0:
        raise MessageError("shape", "a motion message on a lane needs a number")
    if isinstance(message, DriveCommand | FollowPlan) and message.selection == 0:
        raise MessageError("shape", "a command on a lane needs a selection")
