"""`cmd_vel` driver for one robot: performs the actions of `CmdVelOperator` over the bus.

Runs in the adapter's event loop. The client library handles the lease, sequence numbers, echoes and
the setpoint timeout.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

from tsd_twin.adapters.cmd_vel import (
    PAUSE_S,
    Action,
    CmdVel,
    CmdVelOperator,
    Drive,
    HandOver,
    LeaseAction,
)
from tsd_twin.client import (
    AsyncRobotClient,
    AsyncRobotControl,
    ClientError,
    ControlDenied,
    ControlLost,
    RequestRefused,
)
from tsd_twin.errors import TwinError
from tsd_twin.lie import SO3
from tsd_twin.messages.pose import PoseStamped
from tsd_twin.models.links import roll_pitch_yaw
from tsd_twin.robots.description import Limits

_LOG = logging.getLogger(__name__)
_POLL_S = 0.1
FAR_S = 0.015
"""Publisher round trip above which the lease allows older commands."""
REFRESH_S = 0.22
"""Age of 10 Hz twists in addition to that round trip: periods of twist, status and ping."""


def command_age_for(limits: Limits, trip_s: float) -> float:
    """Return the maximum command age for a round trip to the publisher.

    A larger age lowers the speed limit, so that the robot stops within its allowance.
    """
    wanted_s = trip_s + REFRESH_S if trip_s > FAR_S else 0.0
    return min(max(wanted_s, limits.max_command_age_s), limits.max_command_age_ceiling_s)


class CmdVelBridge:
    """Bridge from one `cmd_vel` publisher to one robot."""

    def __init__(
        self,
        robot: AsyncRobotClient,
        machine: CmdVelOperator,
        say: Callable[[str], None],
        trip_s: Callable[[], float] = lambda: 0.0,
        conflict: Callable[[float], str] = lambda _: "",
    ) -> None:
        """Drive one robot for one publisher.

        `machine` may be reused from an earlier driver. `say` shows a message to the publisher.
        `trip_s` returns the round-trip time to the publisher, 0 if unknown. `conflict` returns the
        reason why this adapter must not operate the robot at the given time, or "".
        """
        self.machine = machine
        self._conflict = conflict
        self._robot, self._say, self._trip_s = robot, say, trip_s
        machine.max_age_s = self._max_age_s()
        self._turning = robot.description.kinematics().pose_type is SO3
        self._control: AsyncRobotControl | None = None
        self._driven_s = -math.inf
        self._using = asyncio.Lock()  # Requests that change the lease run one at a time.
        self._tasks: set[asyncio.Task[None]] = set()
        self.start(self._poll())

    def connected(self) -> None:
        """Handle a new or restored connection to the robot."""
        self._perform(self.machine.connected(self._robot.time_s))

    def on_cmd_vel(
        self, message: CmdVel, now_s: float, sent_after_s: float | None, unproven: str = ""
    ) -> None:
        """Handle a received twist; see `CmdVelOperator.on_twist` for the arguments."""
        if self._control is None or not self._control.is_held:
            self.machine.max_age_s = self._max_age_s()
        status = self._robot.state.status
        self._perform(self.machine.on_twist(message, now_s, status, sent_after_s, unproven))

    async def call(self, service: str) -> tuple[bool, str]:
        """Call one of `SERVICES`; return success and a message."""
        match service:
            case "stop":  # Needs no lease and must not wait.
                return await self._answer(self._robot.stop(f"by {self.machine.operator}"))
            case "arm":
                return await self._answer(self._request(lambda control: control.arm()))
            case "disarm":
                return await self._answer(self._request(self._disarm))
            case "resume":
                reason = self.machine.resume(self._robot.time_s, self._robot.state.status)
                return not reason, reason or self._robot.state.mode.value
            case _:
                return await self._answer(self._request(lambda control: control.reset()))

    async def set_pose(self, pose: PoseStamped) -> tuple[bool, str]:
        """Set the pose estimate at rest; release the lease if it was acquired for this."""
        x, y, z, w = (float(pose.wxyz[i]) for i in (1, 2, 3, 0))

        async def act(control: AsyncRobotControl) -> None:
            if self._turning:
                await control.set_orientation(x=x, y=y, z=z, w=w)
            else:
                x_m, y_m = float(pose.position_m[0]), float(pose.position_m[1])
                _, _, heading_rad = roll_pitch_yaw((w, x, y, z))
                await control.set_pose(x_m=x_m, y_m=y_m, heading_rad=heading_rad)

        return await self._answer(self._request(act, keep=False))

    async def close(self) -> None:
        """Command zero, disarm and release any held lease; call last."""
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._end_control()

    # Requests.

    async def _answer(self, work: Coroutine[Any, Any, None]) -> tuple[bool, str]:
        try:
            await work
        except TwinError as error:
            refused = isinstance(error, ControlDenied | RequestRefused)
            code = f"[{error.code}] " if isinstance(error, ClientError) and error.code else ""
            return False, code + (error.reason if refused else str(error))
        return True, self._robot.state.mode.value

    async def _request(
        self, act: Callable[[AsyncRobotControl], Awaitable[None]], *, keep: bool = True
    ) -> None:
        """Run `act` with the lease; unless `keep`, release a lease acquired for this."""
        async with self._using:
            if self._control is not None and not self._control.is_held:
                self._note_loss(self._control)
            acquired = self.machine.on_request(self._robot.time_s)
            if acquired:
                await self._acquire()
            control = self._control
            assert control is not None  # noqa: S101  `_acquire` sets it or raises.
            try:
                await act(control)
            finally:
                self.machine.request_done(self._robot.time_s)
                if acquired and not keep:
                    await self._release()

    async def _disarm(self, control: AsyncRobotControl) -> None:
        await control.disarm()
        await self._release()

    async def _acquire(self) -> None:
        """Acquire the lease.

        Raises:
            ClientError: If the lease is not granted.
        """
        await self._end_control()  # End the tasks of a lost lease.
        max_age_s = self.machine.max_age_s = self._max_age_s()
        control = self._robot.control(self.machine.operator, arm=False, max_age_s=max_age_s)
        try:
            await control.acquire()
        except BaseException as error:
            reason = error.reason if isinstance(error, ControlDenied) else str(error)
            self._perform(self.machine.denied(reason, self._robot.time_s))
            raise
        self._control = control
        self.machine.acquired(self._robot.time_s)

    def _max_age_s(self) -> float:
        return command_age_for(self._robot.description.limits, self._trip_s())

    async def _release(self) -> None:
        await self._end_control()
        self.machine.released()

    async def _end_control(self) -> None:
        control, self._control = self._control, None
        if control is not None:
            with contextlib.suppress(TwinError):  # A silent robot stops automatically.
                await control.release()

    async def _take(self) -> None:
        with contextlib.suppress(TwinError):  # Reported by `_acquire`.
            async with self._using:
                await self._acquire()

    async def _give_back(self) -> None:
        async with self._using:
            await self._release()

    async def _hand_over(self, asker: str) -> None:
        control = self._control
        try:
            if control is not None:
                await control.hand_over(asker)
        except TwinError as error:
            self._say(str(error))

    # Actions.

    def _perform(self, actions: list[Action]) -> None:
        for action in actions:
            match action:
                case LeaseAction.ACQUIRE:
                    self.start(self._take())
                case Drive():
                    self._drive(action)
                case HandOver(asker):
                    self.start(self._hand_over(asker))
                case LeaseAction.GIVE_BACK:
                    self.start(self._give_back())
                case str():
                    self._say(action)

    def _drive(self, action: Drive) -> None:
        control = self._control
        if control is None:
            return
        now_s = self._robot.time_s
        # The failure of a finished motion, before the stick was released, must not block this one.
        tries = 2 if now_s - self._driven_s >= PAUSE_S else 1
        self._driven_s = now_s
        for left in reversed(range(tries)):
            try:
                self._set(control, action)
                return
            except ControlLost:
                self._note_loss(control)
                return
            except TwinError as error:
                if not left:
                    self._perform(self.machine.motion_failed(str(error), now_s))

    def _set(self, control: AsyncRobotControl, action: Drive) -> None:
        vx, vy, _, wx, wy, wz = action.twist
        if self._turning:
            control.set_turn_rate(
                wx_rad_per_s=wx,
                wy_rad_per_s=wy,
                wz_rad_per_s=wz,
                frame=action.frame,
                given_s=action.given_s,
            )
        else:
            control.set_velocity(
                vx_mps=vx,
                vy_mps=vy,
                omega_rad_per_s=wz,
                frame=action.frame,
                given_s=action.given_s,
            )

    def _note_loss(self, control: AsyncRobotControl) -> None:
        self._perform(self.machine.lost(control.lost_reason, self._robot.time_s))

    async def _poll(self) -> None:
        while True:
            await asyncio.sleep(_POLL_S)
            control = self._control
            if control is not None and not control.is_held:
                self._note_loss(control)
            now_s = self._robot.time_s
            self._perform(self.machine.poll(now_s, self._robot.state.status, self._conflict(now_s)))

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Run a request in the background until it ends or `close` cancels it."""
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._end)

    def _end(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            _LOG.error("a request failed", exc_info=error)
