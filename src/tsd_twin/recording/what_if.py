"""Rerun recorded inputs with another robot description, or on a simulated robot."""

from __future__ import annotations

import math

from tsd_twin.control import RobotController
from tsd_twin.control.logged_controller import Call, PosesCall, StepCall
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2, SO3, Array
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.modes import Mode
from tsd_twin.recording.rerun import Rerun, RerunResult, Stretch, initial_pose
from tsd_twin.robots import RobotDescription
from tsd_twin.simulation import SimRobot


class WhatIf(Rerun):
    """Rerun with another robot description, starting when the robot is idle.

    The measurements remain as recorded and do not follow the changed setpoints.
    """

    def __init__(self, stretch: Stretch, description: str, other: RobotDescription) -> None:
        """Load the controller with description `other`.

        Raises:
            TwinError: If the joints differ, or the robot is never both disarmed and without a
                lease.
        """
        free, pose = _free(stretch, description)
        super().__init__(free, description)
        mine, theirs = (
            [joint.name for joint in robot.kinematics().joints] + [s.name for s in robot.sensors]
            for robot in (self.controller.robot, other)
        )
        if mine != theirs:
            raise TwinError(
                f"{other.name} has other joints or sensors than {self.controller.robot.name}: "
                "the recorded measurements do not fit"
            )
        self.controller = RobotController(other, self._lease, pose=pose)
        self._result = RerunResult(other)
        self._start_pose = pose


class Resimulation(WhatIf):
    """Recorded requests and commands on a simulated robot, so that the joints follow the setpoints.

    The simulated robot has no noise, no errors and no pose sensor.
    """

    def __init__(
        self,
        stretch: Stretch,
        description: str,
        other: RobotDescription,
        *,
        plant: str = "kinematic",
    ) -> None:
        """Load the controller and a simulated robot, both with description `other`.

        Raises:
            TwinError: As `WhatIf`.
        """
        super().__init__(stretch, description, other)
        self._simulated = SimRobot(other, pose=self._start_pose, plant=plant)

    def _sense(self, call: PosesCall) -> None:
        """Ignore recorded poses, because the simulated robot is elsewhere."""

    def _run(self, call: Call) -> None:
        if not isinstance(call, PosesCall):
            super()._run(call)
        if isinstance(call, StepCall):
            self._simulated.write(self.controller.setpoint, call.now_s)

    def _inputs(self, call: StepCall) -> tuple[Array | None, Reason | None, float | None]:
        battery_v = self._simulated.hardware().get("battery_v")
        known_v = battery_v if isinstance(battery_v, float) else None
        return self._simulated.read(call.now_s), None, known_v


def _free(stretch: Stretch, description: str) -> tuple[Stretch, SE2 | SO3 | None]:
    """Return the part of a log where a new controller can start, and the pose at its start."""
    first = stretch[0]
    if first.first == 0:
        return stretch, None if first.pose is None else initial_pose(first.pose)
    for number, batch in enumerate(stretch):
        if batch.snapshot is None:
            continue
        there = Rerun(stretch[number:], description).controller
        supervisor, odometry = there.supervisor, there.odometry(0)
        now_s = next((call.now_s for call in batch.calls if isinstance(call, StepCall)), math.inf)
        if supervisor.mode is Mode.DISARMED and supervisor.lease_in_force(now_s) is None:
            pose = odometry.xy_heading if odometry.wxyz is None else odometry.wxyz
            return stretch[number:], initial_pose(pose.tolist())
    raise TwinError(
        "the recording has no state in which the robot is disarmed and has no operator, "
        "from where another description could begin"
    )
