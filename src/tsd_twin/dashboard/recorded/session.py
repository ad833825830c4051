"""Session of a page that shows a recording; it can view, annotate, and stop the live robots."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

import msgspec

from tsd_twin.dashboard.recorded.view import RecordedView, timeline_events
from tsd_twin.dashboard.sessions.map_data import MapData
from tsd_twin.dashboard.sessions.page_session import VIEWER_REFUSAL, PageSession, PageSocket
from tsd_twin.dashboard.sessions.stops import LiveRobots
from tsd_twin.dashboard.sessions.telemetry import RobotTelemetry
from tsd_twin.dashboard.wire.from_page import (
    AddMark,
    PageHeartbeat,
    Pause,
    Play,
    RecordedPageMessage,
    Seek,
    SelectRobot,
    ShowMap,
    ShowShadow,
    StepStatus,
    StopCommand,
    StudentRequest,
    decode_page_message,
)
from tsd_twin.dashboard.wire.to_page import (
    ActionReply,
    Cursor,
    PastStates,
    RobotName,
    RobotState,
    Timeline,
    encode_message,
)
from tsd_twin.errors import RecordingError
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.recording.events import Annotation, add_mark
from tsd_twin.recording.player import Player, RecordedRobot
from tsd_twin.security import Role

PAST_S, PAST_HZ = 20.0, 5.0
"""Duration and rate of the past states sent for plots after a jump."""
_SETTLED_S = 0.25
"""Time after the last jump before past states are sent."""
REFUSAL = because(Code.RECORDING_SHOWN)
_DECODER = msgspec.json.Decoder(RecordedPageMessage)
_STATE_EVERY = 2
"""Frames per state."""
_GROWN_S = 5.0
"""Growth after which the timeline of an unfinished recording is sent again."""


class RecordedSession(PageSession):
    """Session for a page with a recorded view; event loop only."""

    def __init__(
        self,
        socket: PageSocket,
        view: RecordedView,
        live: LiveRobots,
        on_marked: Callable[[], None],
    ) -> None:
        """`live` are the robots of the bus, for stops and the list; `on_marked` reports a mark."""
        super().__init__(socket, live, view.scene)
        self._view = view
        self._on_marked = on_marked
        self._telemetry = {
            each: RobotTelemetry(robot) for each, robot in view.player.robots.items()
        }
        self._numbers = itertools.count(1)
        self._frames = itertools.count()
        self._loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._cursor = Cursor(t_s=-1.0, playing=False, speed=1.0)
        self._jumps = 0
        self._past_player: Player | None = None
        self._past_lock = asyncio.Lock()
        self._settling: asyncio.TimerHandle | None = None
        self._marking = False
        self._told_s = 0.0
        self._map_data = MapData(
            view.player.robots, view.scene, lambda: None, clock=lambda: view.player.t_s
        )

    async def open(self) -> None:
        """Send the page the recording's data, and start showing it."""
        view = self._view
        names = [
            RobotName(each, robot.robot.title, view.roster.css_colour(each))
            for each, robot in view.player.robots.items()
        ]
        self.robot_id = view.robot_id
        self._send_welcome(Role.VIEWER, names)
        self.send(self._telemetry[view.robot_id].info())
        await self._send_timeline()
        view.on_shown = self._on_shown

    async def close(self) -> None:
        """End the session."""
        view = self._view
        if view.on_shown == self._on_shown:  # Unless the page has connected again.
            view.disconnect()
        if self._settling is not None:
            self._settling.cancel()
        for task in self._tasks:
            task.cancel()

    # Messages from the page.

    def receive(self, text: str | bytes) -> None:
        """Handle a message; messages that would move a robot are refused."""
        try:
            message: RecordedPageMessage = _DECODER.decode(text)
        except (msgspec.DecodeError, UnicodeError, RecursionError):
            self._refuse(text)
            return
        match message:
            case StopCommand():
                self._stop(message, None)
            case PageHeartbeat():
                self._echo(message)
                self._handle_common(message)
            case AddMark():
                self._mark(message.note)
            case StudentRequest():
                self.send(ActionReply(to="student", ok=False, why=REFUSAL))
            case SelectRobot():
                self.select_robot(message.id)
            case ShowMap():
                self._shows_map = message.on
                self._settle()
            case ShowShadow():
                pass  # A shadow twin cannot follow jumps; use `tsd-lab health` for recordings.
            case Seek() | Play() | Pause() | StepStatus():
                self._move(message)
            case _:
                self._handle_common(message)
                self._view.frame = self.view.frame

    def _move(self, message: Seek | Play | Pause | StepStatus) -> None:
        view = self._view
        if isinstance(message, Seek | StepStatus):
            self._settle()
        match message:
            case Seek():
                view.request(partial(view.seek, message.t_s))
            case Play():
                view.request(partial(view.playback.play, message.speed))
            case Pause():
                view.request(view.playback.pause)
            case StepStatus():
                view.request(partial(view.step, back=message.back))

    def select_robot(self, robot_id: str) -> None:
        """Select another robot of the recording."""
        if robot_id in self._telemetry and robot_id != self._view.robot_id:
            self._plot_fields = ()
            self._view.robot_id = robot_id
            self._show_robot(robot_id)
            self._queue.drop_states()
            self.send(self._telemetry[robot_id].info())

    def _refuse(self, text: str | bytes) -> None:
        try:
            message = decode_page_message(text)
        except MessageError as error:
            self.reject(error)
            return
        tag = str(message.__struct_config__.tag)
        self.send(ActionReply(to=tag, ok=False, why=REFUSAL))

    def _mark(self, note: str) -> None:
        refusal = because(Code.MARK_UNDER_WAY) if self._marking else None
        if self.principal.identity.role is Role.VIEWER:
            refusal = VIEWER_REFUSAL
        if refusal:
            self.send(ActionReply(to="mark", ok=False, why=refusal))
            return
        self._marking = True
        self._start(self._add_mark(note))

    async def _add_mark(self, note: str) -> None:
        player = self._view.player
        log_ns = player.start_ns + round(1e9 * player.t_s)
        try:
            await asyncio.to_thread(add_mark, player.path, Annotation(log_ns, note, self._operator))
        except RecordingError as error:
            self.send(ActionReply(to="mark", ok=False, why=because(Code.TEXT, text=str(error))))
            return
        finally:
            self._marking = False
        self.send(ActionReply(to="mark", ok=True))
        self._on_marked()
        await self._send_timeline()

    def _start(self, work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task

    # Messages to the page.

    async def _send_timeline(self) -> None:
        player = self._view.player
        self._told_s = player.duration_s
        self.send(
            Timeline(
                name=player.path.name,
                start_ms=player.start_ns // 1_000_000,
                duration_s=player.duration_s,
                events=await asyncio.to_thread(timeline_events, player),
            )
        )

    def _settle(self) -> None:
        """Schedule sending the past states after the last of several jumps."""
        self._jumps += 1
        jump = self._jumps
        if self._settling is not None:
            self._settling.cancel()
        self._settling = self._loop.call_later(
            _SETTLED_S, lambda: self._start(self._send_past(jump))
        )

    async def _send_past(self, jump: int) -> None:
        async with self._past_lock:
            if jump != self._jumps:
                return
            states = await asyncio.to_thread(self._past)
        self.send(PastStates(states=states))
        self._map_data.clear_trails()
        for state in states:
            if state.pose is not None:
                self._map_data.extend_trail(self._view.robot_id, *state.pose[:2])
        if self._shows_map:
            self.send(self._map_data.lines(trails=True))

    def _past(self) -> list[RobotState]:
        """Return past states of the selected robot, read with a separate player."""
        view, robot_id = self._view, self._view.robot_id
        if self._past_player is None or robot_id not in self._past_player.robots:
            self._past_player = Player(view.player.path, robot_id, view.player.reader)
        robot = self._past_player.robots[robot_id]
        telemetry = RobotTelemetry(robot)
        states: list[RobotState] = []
        end_s = view.player.t_s
        for i in range(round(PAST_S * PAST_HZ), 0, -1):
            self._past_player.seek(end_s - i / PAST_HZ)
            if end_s >= i / PAST_HZ and (state := self._state(telemetry, robot)) is not None:
                states.append(state)
        return states

    def _state(self, telemetry: RobotTelemetry, robot: RecordedRobot) -> RobotState | None:
        state = telemetry.state(robot.snapshot, self._view.player.t_s)
        if state is None or not robot.alive:
            return None
        plot = telemetry.plot_fields.values(self._plot_fields, robot.snapshot)
        return msgspec.structs.replace(state, plot=plot)

    def _on_shown(self, jumped: bool) -> None:
        """Schedule an update for the page; called on the view's thread."""
        if next(self._frames) % _STATE_EVERY == 0 or jumped:
            self._call_soon(self._show)

    def _call_soon(self, call: Callable[[], None]) -> None:
        with contextlib.suppress(RuntimeError):  # The loop may have closed.
            self._loop.call_soon_threadsafe(call)

    def _show(self) -> None:
        view, robot_id = self._view, self._view.robot_id
        playback = view.playback
        cursor = Cursor(
            t_s=round(view.player.t_s, 4), playing=playback.playing, speed=playback.speed
        )
        if cursor != self._cursor:
            self._cursor = cursor
            self._queue.put_latest("cursor", encode_message(cursor))
        if abs(view.player.duration_s - self._told_s) > _GROWN_S:
            self._start(self._send_timeline())
        self._map_data.on_status(robot_id)
        robot = view.player.robots[robot_id]
        state = self._state(self._telemetry[robot_id], robot)
        if state is not None:
            # Use a separate number, because updates continue while the recording is paused.
            number = next(self._numbers)
            shown = self._map_data.state(robot_id) if self._shows_map else None
            camera = self._scene.camera_state(self.page)
            state = msgspec.structs.replace(state, status_seq=number, camera=camera, map=shown)
            self._queue.put_state(number, encode_message(state))
