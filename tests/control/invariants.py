"""Invariants of the control loop, checked after each step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.control.reference_model import CommandReference
from tests.support.controller_harness import ControllerHarness
from tsd_twin.lie import Array
from tsd_twin.messages.modes import Mode
from tsd_twin.robots import (
    OmniDescription,
    RobotDescription,
    SingularityDescription,
    SphereDescription,
)


class LoopInvariants:
    """Invariants of the control loop, one method each, which raises on a violation."""

    rig: ControllerHarness
    referee: CommandReference
    since_stop: list[str]
    """What has been done since the last stop: `reset`, `arm`, `push`."""
    obeyed: bytes = b""
    """Lease of the latest obeyed command."""

    def hold(self, before: Array, dt_s: float) -> None:
        """Check all invariants; `before` is the twist of `dt_s` ago."""
        self.every_sample_is_counted_once_and_only_those_that_count_are_accepted()
        self.two_operators_never_drive_at_once()
        self.who_has_just_got_control_drives_from_standstill_on(before)
        self.control_is_kept_for_one_who_was_granted_it_and_not_for_ever()
        self.it_moves_only_on_a_fresh_command_or_while_braking(before)
        self.after_a_stop_it_moves_only_after_reset_and_arm_and_a_new_command()
        self.the_commanded_twist_never_jumps(before, dt_s)
        self.set_points_are_finite_and_within_the_limits_of_the_joints()
        self.wheels_never_turn_unless_armed()

    def every_sample_is_counted_once_and_only_those_that_count_are_accepted(self) -> None:
        gate = self.rig.controller.supervisor.gate
        drops = gate.dropped
        dropped = (
            drops.stale + drops.lease + drops.order + drops.nonfinite + drops.key + drops.shape
        )
        assert gate.accepted + dropped == self.referee.sent
        assert gate.accepted == self.referee.counted

    def two_operators_never_drive_at_once(self) -> None:
        """Only commands of the operator with the latest lease are obeyed."""
        supervisor = self.rig.controller.supervisor
        if supervisor.command is not None:
            assert supervisor.command.operator == self.referee.holder
            assert supervisor.command.lease.hex() == self.referee.lease
            assert self.rig.now_s < self.referee.ends_s

    def who_has_just_got_control_drives_from_standstill_on(self, before: Array) -> None:
        """Between accepted commands of two leases the robot is at rest."""
        command = self.rig.controller.supervisor.command
        if command is None:
            return
        if command.lease != self.obeyed and self.obeyed:
            assert not before.any()
        self.obeyed = command.lease

    def control_is_kept_for_one_who_was_granted_it_and_not_for_ever(self) -> None:
        lease, (asker, until_s) = self.rig.status().lease, self.referee.reserved
        kept = self.rig.now_s < until_s
        assert (lease.reserved_for, lease.reservation_expires_in_s <= 3.0) == (
            asker if kept else None,
            True,
        )
        assert not (lease.holder and lease.reserved_for)
        assert lease.requested_by == (self.referee.asker(self.rig.now_s) or None)
        assert lease.requested_by is None or lease.requested_by != lease.holder

    def it_moves_only_on_a_fresh_command_or_while_braking(self, before: Array) -> None:
        rig = self.rig
        if not rig.twist.any():
            return
        assert rig.mode in (Mode.DRIVING, Mode.STOPPING)
        if rig.mode is Mode.DRIVING:
            assert self.referee.stands(rig.now_s)
        else:
            assert (np.abs(rig.twist) <= np.abs(before)).all()
            assert np.linalg.norm(rig.twist) < np.linalg.norm(before)

    def after_a_stop_it_moves_only_after_reset_and_arm_and_a_new_command(self) -> None:
        if self.rig.twist.any():
            steps = [
                step for i, step in enumerate(self.since_stop) if step not in self.since_stop[:i]
            ]
            assert steps[:2] == ["reset", "arm"]
            assert "push" in self.since_stop[self.since_stop.index("arm") :]

    def the_commanded_twist_never_jumps(self, before: Array, dt_s: float) -> None:
        rig, limits = self.rig, self.rig.controller.robot.limits
        if rig.mode in (Mode.STOPPED, Mode.FAULT):
            assert not rig.twist.any()
            return
        # The top of a sphere for one that turns in place, in metres a second as all others.
        change, twist_scale_m = rig.twist - before, rig.controller.kinematics.twist_scale_m
        step_mps = twist_scale_m * np.hypot(*change[:2])
        assert step_mps <= limits.deceleration_mps2 * dt_s * (1 + 1e-9)
        assert abs(change[2]) <= limits.angular_acceleration_rad_per_s2 * dt_s * (1 + 1e-9)
        if np.hypot(*rig.twist[:2]) > np.hypot(*before[:2]):
            assert step_mps <= limits.acceleration_mps2 * dt_s * (1 + 1e-9)

    def set_points_are_finite_and_within_the_limits_of_the_joints(self) -> None:
        rig = self.rig
        assert np.isfinite(rig.setpoint).all()
        assert np.isfinite(rig.pose).all()
        assert WITHIN_LIMITS[type(rig.controller.robot)](rig)

    def wheels_never_turn_unless_armed(self) -> None:
        rig = self.rig
        turning = rig.setpoint[rig.wheels] != 0.0
        if rig.mode in (Mode.DISARMED, Mode.STOPPED, Mode.FAULT):
            assert not turning.any()
        if isinstance(rig.controller.robot, SingularityDescription):
            assert turning.all() == turning.any()
            assert turning.all() or rig.mode not in (Mode.READY, Mode.DRIVING, Mode.STOPPING)
        else:
            assert turning.any() == rig.twist.any()


def upright_enough(rig: ControllerHarness) -> bool:
    """No axle tilts by more than 30 degrees."""
    joints = rig.setpoint.reshape(-1, 3)
    upright = np.cos(joints[:, 0]) * np.cos(joints[:, 1])
    return bool((upright >= np.cos(np.radians(30.0)) - 1e-12).all())


def slow_enough(rig: ControllerHarness) -> bool:
    """No wheel turns faster than its motor can, by the figures of the file."""
    motor = rig.controller.robot.motor
    top = motor.no_load_speed_rpm / motor.gear_ratio * 2.0 * np.pi / 60.0
    return bool(np.abs(rig.setpoint).max() <= top * (1 + 1e-12))


WITHIN_LIMITS: dict[type[RobotDescription], Callable[[ControllerHarness], bool]] = {
    SingularityDescription: upright_enough,
    OmniDescription: slow_enough,
    SphereDescription: slow_enough,
}
