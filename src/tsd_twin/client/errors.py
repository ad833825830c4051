"""Errors of the client library, each with the call that resolves it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tsd_twin.errors import CodedReason, TwinError

# Scripts read these names as events: `except ControlLost`.


REMEDIES: dict[str, str] = {
    # No robot, or which one.
    "no_robot": "tsd-demo or tsd-mock starts one; connect('tcp/HOST:PORT') names its endpoint",
    "several_robots": "connect(robot='NAME')",
    # The lease.
    "reserved_for": "robot.request_control(), or try again after 3 s",
    "denied_lately": "robot.request_control() after the time that is named",
    "other_request": "robot.request_control() once the other request is answered",
    "no_request": "base.requested_by names who asks, or None",
    "request_of": "base.hand_over(base.requested_by)",
    "take_control_first": "base.acquire(), or enter robot.control() again",
    "held_by": "robot.request_control(), or robot.control(take_over=True, reason='...')",
    "control_denied": "robot.request_control(), or robot.control(take_over=True, reason='...')",
    "no_control": "base.acquire(), or enter robot.control() again",
    # Modes.
    "reset_first": "robot.reset()",
    "robot_stopped": "robot.reset()",
    "robot_fault": "robot.reset()",
    "not_latched": "base.arm(): only a stop or a fault is reset",
    "release_first": "base.rest(), then base.reset()",
    "robot_disarmed": "base.arm()",
    "robot_arming": "base.arm() waits until the robot is ready",
    "wrong_mode": "none if it is ready: drive; otherwise base.rest()",
    "stopped_by_itself": "base.rest(), then the motion again, once the named cause is gone",
    "not_ready": "base.rest(), or base.arm()",
    "arm_refused": "base.arm() once robot.state.status.refusals.arm is None",
    # Motions and settings.
    "other_motion": "base.rest(), or wait in the thread of that motion",
    "no_motion": "base.drive(...), or base.set_velocity(...)",
    "at_rest_only": "base.rest()",
    "no_wheel_speed": "none: only robots with wheels that always spin have one",
    "wheel_speed_refused": "base.set_wheel_speed(rpm) in the range that is named",
    "bad_shape": "the same call with finite numbers in the range of its unit",
    "bad_twist": "base.drive(vx_mps=..., duration_s=...) with finite numbers",
    "bad_frame": "frame='base_link' or frame='odom'",
    "not_finite": "the same call with finite numbers",
    "negative": "the same call with 0 or a positive number",
    "not_positive": "the same call with a positive number",
    "no_number": "the same call with a number",
    "no_string": "the same call with a string",
    "motion_ended": "the motion again",
    "no_such_pose": "SimulatedRobot(...) without pose",
    "goes_nowhere": "base.turn(...)",
    "use_turn": "base.turn(...), or base.set_turn_rate(...)",
    "use_drive": "base.drive(...), or base.set_velocity(...)",
    "left_path": "base.go_to(...) again, from where the robot is now",
    "not_at_rest": "robot.stop()",
    # Silence.
    "stop_unconfirmed": "robot.stop() again, and the stop switch of the robot",
    "connection_of_parent": "tsd_twin.connect() in the child",
    "stops_unconfirmed": "tsd_twin.stop_all() again, and the emergency stop",
    "not_disarmed": "robot.stop() again, and the stop switch of the robot",
    "no_answer": "tsd_twin.connect() again, once the robot and the network run",
    "mode_not_shown": "tsd_twin.connect() again, once the robot and the network run",
    "no_state": "tsd_twin.connect() again, once the robot and the network run",
    "no_status": "tsd_twin.connect() again, once the robot and the network run",
}
"""Calls that resolve what a client raises, by the code of the robot's reason or of the error."""


class ClientError(TwinError):
    """Base class for errors of the client library; the traceback includes the remedy."""

    def __init__(self, sentence: str, code: str, why: CodedReason | None = None) -> None:
        """`why` is the reason of the robot, if it gave one, and `code` that of the error."""
        super().__init__(sentence)
        self.why = why
        """Reason of the robot; None if it gave none."""
        self.code = code if why is None else why.code
        """Code of that reason, as in docs/codes.md; without one, that of the error."""
        self.params: Mapping[str, str | float] = {} if why is None else why.params
        """Parameters of that reason, by name."""
        self.remedy = REMEDIES.get(self.code) or REMEDIES.get(code, "")
        """Call that resolves it; "" if none is known."""
        if self.remedy:
            self.add_note(f"Remedy: {self.remedy}")


class NoRobotFound(ClientError):  # noqa: N818  Named after the event.
    """No robot answers."""


class SeveralRobotsFound(ClientError):  # noqa: N818  Named after the event.
    """Several robots are on the bus, and none was named."""

    def __init__(self, robots: Sequence[str], where: str) -> None:
        super().__init__(
            f"{', '.join(robots)} are at {where}: name one, connect(robot='{robots[0]}')",
            "several_robots",
        )
        self.robots = tuple(robots)
        """Ids of the robots, sorted."""


class StopNotConfirmed(ClientError):  # noqa: N818  Named after the event.
    """Some robots did not confirm that they are stopped; the others did."""

    def __init__(self, robots: Sequence[str]) -> None:
        sentence = f"no confirmed stop of {', '.join(robots)}: use the emergency stop"
        super().__init__(sentence, "stops_unconfirmed")
        self.robots = tuple(robots)
        """Ids of the robots that did not confirm, sorted."""


class ControlDenied(ClientError):  # noqa: N818  Named after the event.
    """The robot does not grant the lease."""

    def __init__(
        self,
        robot: str,
        reason: str,
        holder: str | None = None,
        why: CodedReason | None = None,
    ) -> None:
        super().__init__(f"{robot} gives no control: {reason}", "control_denied", why)
        self.reason = reason
        """The robot's reason."""
        self.holder = holder
        """Operator who has control, if any."""


class ControlLost(ClientError):  # noqa: N818  Named after the event.
    """The lease ended before it was released."""


class RequestRefused(ClientError):  # noqa: N818  Named after the event.
    """The robot refused a request."""

    def __init__(self, robot: str, what: str, reason: str, why: CodedReason | None = None) -> None:
        code = "arm_refused" if what == "arm" else "request_refused"
        super().__init__(f"{robot} refuses to {what}: {reason}", code, why)
        self.reason = reason
        """The robot's reason."""


class RobotStopped(ClientError):  # noqa: N818  Named after the event.
    """The robot is stopped, faulty or not armed, or stopped automatically."""


class RobotSilent(ClientError):  # noqa: N818  Named after the event.
    """The robot does not answer, or has sent no status for a second."""


class MotionFailed(ClientError):  # noqa: N818  Named after the event.
    """The robot did not reach the goal of a motion and was brought to rest."""
