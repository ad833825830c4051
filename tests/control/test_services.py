"""Service replies and status of the controller."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.controller_harness import ROBOT, ControllerHarness
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.modes import Mode
from tsd_twin.messages.services import LeaseReply
from tsd_twin.messages.topics import Service
from tsd_twin.simulation import SimRobot

NEED_A_LEASE = (Service.ARM, Service.DISARM, Service.RESET, Service.SET_POSE)
ANSWERED = tuple(service for service in Service if service is not Service.DESC)
GARBAGE = (b"", b"[]", b"nonsense", b"\xff", b'{"lease": "\xff"}', b'{"a":' * 800, b"{}")


@pytest.mark.parametrize("service", [*NEED_A_LEASE, Service.LEASE])
@pytest.mark.parametrize("payload", GARBAGE)
def test_garbage_is_answered_with_what_is_wrong(
    rig: ControllerHarness, service: Service, payload: bytes
) -> None:
    reply = rig.controller.serve(service, payload, rig.now_s)
    assert reply.ok is False
    assert reply.why.code == Code.BAD_SHAPE
    if isinstance(reply, LeaseReply):
        assert reply.granted is False
    (event,) = rig.controller.take_events()
    assert event.kind == "refusal"


@pytest.mark.parametrize("payload", GARBAGE)
def test_a_stop_needs_no_readable_request(rig: ControllerHarness, payload: bytes) -> None:
    rig.get_ready()
    assert rig.controller.serve(Service.STOP, payload, rig.now_s).ok
    assert rig.mode is Mode.STOPPED
    assert rig.status().stop == because(Code.STOP_REQUESTED)


@given(
    payload=st.binary(max_size=50)
    | st.dictionaries(
        st.sampled_from(["op", "operator", "lease", "reason", "x_m", "y_m", "heading_rad"]),
        st.none() | st.text(max_size=9) | st.floats() | st.just("acquire") | st.just("0" * 32),
    ).map(lambda fields: json.dumps(fields).encode())
)
def test_no_request_is_met_with_silence_or_an_exception(payload: bytes) -> None:
    rig = ControllerHarness()
    for service in ANSWERED:
        assert rig.controller.serve(service, payload, rig.now_s) is not None


@pytest.mark.parametrize("service", NEED_A_LEASE)
def test_only_the_holder_is_obeyed(rig: ControllerHarness, service: Service) -> None:
    rig.acquire("alice")
    rig.controller.take_events()
    reply = rig.ask(service, lease="f" * 32, x_m=1.0, y_m=2.0, heading_rad=3.0)
    assert not reply.ok
    assert reply.reason
    assert [event.kind for event in rig.controller.take_events()] == ["refusal"]
    np.testing.assert_array_equal(rig.pose, 0.0)


def test_the_pose_is_set_at_rest(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    rig.place(1.0, -2.0, 0.5, pilot=pilot)
    np.testing.assert_array_equal(rig.pose, [1.0, -2.0, 0.5])
    rig.drive(pilot, (0.5, 0.0, 0.0), 0.1)
    reply = rig.ask(Service.SET_POSE, lease=pilot.lease, x_m=0.0, y_m=0.0, heading_rad=0.0)
    assert (reply.ok, reply.why) == (False, because(Code.AT_REST_ONLY))


def test_a_pose_that_is_no_number_is_refused(rig: ControllerHarness) -> None:
    pilot = rig.acquire()
    payload = f'{{"lease": "{pilot.lease}", "x_m": 1e999, "y_m": 0, "heading_rad": 0}}'
    assert not rig.controller.serve(Service.SET_POSE, payload.encode(), rig.now_s).ok
    np.testing.assert_array_equal(rig.pose, 0.0)


# Status.


def test_the_status_tells_who_drives_and_what_became_of_the_commands(
    rig: ControllerHarness,
) -> None:
    assert rig.status().mode == "disarmed"
    assert (rig.status().lease.holder, rig.status().command.age_s) == (None, None)
    pilot = rig.get_ready()
    accepted = rig.status().command.accepted
    rig.drive(pilot, (0.5, 0.0, 0.0), 0.2)
    rig.inbox = [
        rig.sample(pilot, (np.nan, 0.0, 0.0)),
        rig.sample(pilot, (1.0, 0.0, 0.0), seq=1),
        rig.sample(pilot, (1.0, 0.0, 0.0), lease="e" * 32),
        rig.sample(pilot, (1.0, 0.0, 0.0), status_seq=10**6),
        rig.sample(pilot, (1.0, 0.0, 0.0), frame="map"),
    ]
    rig.tick()
    rig.tick()
    status = rig.status()
    assert status.mode == "driving"
    assert status.lease.holder == "alice"
    # The last accepted command arrived four periods ago.
    assert status.lease.remaining_s == pytest.approx(2.0 - 0.03)
    assert status.command.age_s == pytest.approx(0.03)
    assert status.command.accepted == accepted + 10
    dropped = status.command.dropped
    assert (dropped.nonfinite, dropped.order, dropped.lease) == (1, 1, 1)
    assert (dropped.stale, dropped.shape, dropped.key) == (1, 1, 0)


def test_the_status_shows_how_far_arming_is(rig: ControllerHarness) -> None:
    pilot = rig.acquire()
    rig.ask(Service.ARM, lease=pilot.lease)
    rig.wait(1.0)
    arming = rig.status().arming
    assert arming is not None
    assert (arming.phase, arming.progress) == ("hold", pytest.approx(0.5, abs=0.02))
    assert not rig.setpoint.any()
    rig.wait(1.1)
    arming = rig.status().arming
    assert arming is not None
    assert arming.phase == "spin_up"
    assert (rig.setpoint[rig.wheels] > 0.0).all()


def test_joints_have_the_names_and_kinds_of_the_description(rig: ControllerHarness) -> None:
    pilot = rig.get_ready()
    rig.drive(pilot, (0.5, 0.0, 0.0), 0.5)
    for state in (rig.controller.joint_state(7), rig.controller.setpoint_state(7)):
        assert state.stamp_ns == 7
        assert list(state.names) == [
            f"module{i}_{part}" for i in (1, 2, 3) for part in ("alpha", "beta", "wheel")
        ]
        assert np.isnan(state.position_rad[rig.wheels]).all()
        np.testing.assert_allclose(
            state.velocity_rad_per_s[rig.wheels], 2500 * np.pi / 30, rtol=1e-3
        )
        assert np.isfinite(state.position_rad[~rig.wheels]).all()
    # Wheels still settle by about 0.1 %, and the gimbals follow.
    np.testing.assert_allclose(
        rig.controller.joint_state(7).velocity_rad_per_s[~rig.wheels], 0.0, atol=1e-3
    )


@pytest.mark.parametrize("module", [1, 2, 3])
def test_a_module_that_jams_is_named(sim_rig: ControllerHarness, module: int) -> None:
    """Its gimbals hold their angles while the other modules move the robot."""
    rig = sim_rig
    pilot = rig.get_ready()
    rig.drive(pilot, (0.8, 0.4, 0.0), 1.0)
    assert rig.status().consistency.suspect is None
    stuck = slice(3 * module - 3, 3 * module - 1)
    held = rig.simulated.truth(rig.now_s).joints[stuck].copy()
    read = rig.simulated.read

    def jammed(now_s: float) -> Any:
        joints = read(now_s)
        joints[stuck] = held
        return joints

    rig.simulated.read = jammed
    rig.drive(pilot, (-0.4, 0.8, 0.0), 1.0)
    consistency = rig.status().consistency
    assert consistency.suspect == f"module{module}"
    assert consistency.residual_mps > 0.1


@pytest.mark.parametrize("twist", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.5, 0.2, 2.5)])
def test_a_sound_robot_with_noise_is_never_suspected(
    twist: tuple[float, float, float],
) -> None:
    rig = ControllerHarness(SimRobot(ROBOT, seed=3, noise=1.0))
    pilot = rig.get_ready()
    for sign in (1, -1, 1):
        for _ in range(100):
            rig.drive(pilot, np.multiply(twist, sign), 0.01)
            assert rig.status().consistency.suspect is None
