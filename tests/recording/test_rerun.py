"""A rerun of the controller is identical to the bit, and a change shows at its time."""

from __future__ import annotations

import ast
import functools
import inspect
import pickle
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import tsd_twin
from tests.support.logged_runs import GYRO, TEXTS, LoggedHarness, LoggedRun, eventful_run
from tsd_twin import robots
from tsd_twin.control import RobotController, robot_controller
from tsd_twin.control.logged_controller import (
    InputBatch,
    LeaseDrawn,
    LeaseIds,
    PosesCall,
    SentCall,
    ServeCall,
    StatusCall,
    StepCall,
    StopCall,
    decode_batch,
    dump_state,
    encode_batch,
    load_state,
)
from tsd_twin.errors import TwinError
from tsd_twin.kinematics import JointKind
from tsd_twin.messages.status import LoopStatus
from tsd_twin.recording.channels import Entry
from tsd_twin.recording.export import Redactor
from tsd_twin.recording.rerun import Rerun, stretches
from tsd_twin.recording.what_if import Resimulation, WhatIf
from tsd_twin.safety import lease, supervisor

EVENTFUL = sorted(TEXTS)


@functools.cache
def run_of(name: str) -> LoggedRun:
    return eventful_run(TEXTS[name])


def rerun(run: LoggedRun, first: int = 0, tolerance: float = 0.0) -> Any:
    (stretch,) = stretches(run.batches[first:])
    return Rerun(stretch, run.text, tolerance).run()


@pytest.mark.parametrize("name", EVENTFUL)
def test_set_points_and_estimates_are_the_recorded_ones_bit_for_bit(name: str) -> None:
    run = run_of(name)
    result = rerun(run)
    assert result.difference is None
    assert len(result.t_s) == len(run.steps) > 1000
    assert result.largest_difference == 0.0


@pytest.mark.parametrize("name", EVENTFUL)
def test_the_run_has_all_that_a_controller_can_be_given(name: str) -> None:
    """Otherwise the test above would prove little."""
    run = run_of(name)
    modes = {call.mode for call in run.calls if isinstance(call, StatusCall)}
    assert modes == {"arming", "ready", "driving", "stopping", "stopped", "disarmed"}
    assert ("speed" in run.moments) == (name in ("tsd", GYRO))
    kinds = {type(call) for call in run.calls}
    planar = name != "atlas"
    assert kinds == {
        LeaseDrawn, ServeCall, StopCall, StepCall, StatusCall, SentCall,
        *([PosesCall] if planar else []),
    }  # fmt: skip
    assert any(step.measured is None for step in run.steps)
    moving = [np.frombuffer(step.estimate)[-3:].any() for step in run.steps]
    assert sum(moving) > 300


@pytest.mark.parametrize("name", EVENTFUL)
def test_a_run_can_begin_at_any_state_in_the_log(name: str) -> None:
    """Also while driving, during a handover, and while the wheels change their speed."""
    run = run_of(name)
    for first in range(1, len(run.batches), 9):
        result = rerun(run, first)
        assert result.difference is None, first
        assert len(result.t_s) == len(run.steps) - sum(
            isinstance(call, StepCall) for batch in run.batches[:first] for call in batch.calls
        )


def test_a_changed_constant_of_the_core_is_found_at_its_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The constant bounds the speed change after a late period, which is when it shows."""
    run = run_of("omni4")
    late = next(
        step for before, step in zip(run.steps, run.steps[1:], strict=False)
        if step.now_s - before.now_s > 0.03
    )  # fmt: skip
    monkeypatch.setattr(robot_controller, "LONGEST_STEP_S", 0.011)
    difference = rerun(run).difference
    assert difference is not None
    assert difference.robot_s == late.now_s
    assert difference.what.startswith("the set-point of wheel")
    assert "mode driving" in difference.cause
    assert "commands" in difference.cause
    # Before that time there is no difference, and none with a later start state.
    last = max(i for i, batch in enumerate(run.batches) if late in batch.calls)
    assert rerun(run, last + 1).difference is None


def test_a_changed_time_of_the_lease_is_found_in_its_first_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = run_of("kiwi")
    granted = next(
        c for c in run.calls if isinstance(c, ServeCall) and b'"granted":true' in c.reply
    )
    monkeypatch.setattr(lease, "TTL_S", 1.9)
    difference = rerun(run).difference
    assert difference.robot_s == granted.now_s
    assert '"ttl_s":1.9' in difference.what


@pytest.mark.parametrize("name", ["omni4", "kiwi"])
def test_one_bit_of_one_measurement_is_found_in_its_period(name: str) -> None:
    """For `omni4`, only the second estimate uses the driven wheels."""
    run = run_of(name)
    number = next(
        i for i, b in enumerate(run.batches)
        if {c.mode for c in b.calls if isinstance(c, StatusCall)} == {"driving"}
    )  # fmt: skip
    batch = run.batches[number]
    at = max(i for i, call in enumerate(batch.calls) if isinstance(call, StepCall))
    step = batch.calls[at]
    assert isinstance(step, StepCall)
    assert step.measured is not None
    values = np.frombuffer(step.measured, "<f8")
    first = int(np.flatnonzero(np.isfinite(values) & (values != 0.0))[0])
    measured = bytearray(step.measured)
    measured[8 * first + 1] ^= 1  # About 1e-14 of it.
    calls = list(batch.calls)
    calls[at] = msgspec.structs.replace(step, measured=bytes(measured))
    changed = [*run.batches]
    changed[number] = msgspec.structs.replace(batch, calls=calls)
    (stretch,) = stretches(changed)
    result = Rerun(stretch, run.text).run()
    assert result.difference is not None
    assert result.difference.robot_s == step.now_s
    assert "estimate" in result.difference.what
    assert (result.largest_difference > 0.0) == (name == "kiwi")
    assert result.largest_difference < 1e-9
    # Another processor may round differently, which a tolerance accepts.
    assert Rerun(stretch, run.text, 1e-9).run().difference is None


def test_code_that_raises_is_a_difference_with_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    run = run_of("omni4")
    asked = next(c for c in run.calls if isinstance(c, ServeCall) and c.service == "srv/arm")

    def broken(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(supervisor.SafetySupervisor, "arm", broken)
    difference = rerun(run).difference
    assert difference.robot_s == asked.now_s
    assert "ZeroDivisionError: a bug" in difference.what


# Completeness of the log.

LOGGED = {
    "step": StepCall,
    "add_pose_measurements": PosesCall,
    "serve": ServeCall,
    "stop": StopCall,
    "status": StatusCall,
    "record_status_sent": SentCall,
}
"""Methods that change the state of a controller, and how they are logged."""
PASSES_THROUGH = {"status": {"loop", "hardware"}}
"""Arguments that are only copied into the result."""
READS = {
    "kinematics", "joints", "odometry", "alternative_odometry", "joint_state", "setpoint_state",
    "mean_twist", "pose", "unfused_pose", "end_twist", "take_events",
}  # fmt: skip
"""Methods without effect on setpoints and estimates."""


def test_every_input_of_the_controller_is_on_record() -> None:
    """A new method or argument must be logged or declared not to be an input."""
    public = {name for name in vars(RobotController) if not name.startswith("_")}
    assert public == set(LOGGED) | READS
    for name, call in LOGGED.items():
        inputs = set(inspect.signature(getattr(RobotController, name)).parameters) - {"self"}
        logged = set(call.__struct_fields__) - {
            "reply",
            "setpoint",
            "estimate",
            "others",
            "mode",
        }
        assert inputs - PASSES_THROUGH.get(name, set()) == logged, name
    made_of = set(inspect.signature(RobotController.__init__).parameters) - {"self"}
    assert made_of == {"robot", "new_lease_id", "pose"}  # Description, LeaseDrawn, InputBatch.pose.


def state_of(controller: RobotController) -> bytes:
    return dump_state(controller, LeaseIds(bytes), frozenset({"_events"}))


def test_what_is_not_logged_changes_no_state() -> None:
    run = run_of("tsd")
    (stretch,) = stretches(run.batches)
    middle = Rerun(stretches(run.batches[: len(run.batches) // 2])[0], run.text)
    middle.run()
    controller = middle.controller
    controller.take_events()
    before = state_of(controller)
    for name in READS:
        attribute = getattr(RobotController, name)
        if isinstance(attribute, property):
            getattr(controller, name)
        else:
            arguments = [5] if "stamp_ns" in inspect.signature(attribute).parameters else []
            attribute(controller, *arguments)
        assert state_of(controller) == before, name
    calls = run.batches[len(run.batches) // 2 - 1].calls
    last_s = max(call.now_s for call in calls if isinstance(call, StepCall))
    controller.status(last_s, LoopStatus(7.0, 7, 7.0), {"kind": "other"})
    assert state_of(controller) == before
    assert stretch


def test_no_random_number_and_no_environment_gets_in_by_another_way() -> None:
    """The import layers already forbid clocks, threads and sockets."""
    hidden = {"random", "secrets", "uuid", "os", "platform"}
    for package in ("control", "safety", "estimation", "motion", "kinematics", "messages"):
        for path in (Path(tsd_twin.__file__).parent / package).glob("*.py"):
            tree = ast.parse(path.read_text("utf-8"))
            for node in ast.walk(tree):
                names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
                assert not hidden & {name.split(".")[0] for name in names}, path
            # A generator with a constant seed draws the same numbers in each run.
            text = re.sub(r"np\.random\.default_rng\(\d+\)", "", ast.unparse(tree))
            assert "np.random" not in text, path


# Gaps, damage, and files from other programs.


def test_after_a_gap_the_run_goes_on_from_the_next_state() -> None:
    run = run_of("omni4")
    without = [b for i, b in enumerate(run.batches) if i != 7]
    no_state = [
        msgspec.structs.replace(b, snapshot=None) if i in (8, 9) else b
        for i, b in enumerate(run.batches)
        if i != 7
    ]
    first, second = stretches(without)
    assert (len(first), len(second)) == (7, len(run.batches) - 8)
    _, later = stretches(no_state)
    assert len(later) == len(second) - 2
    for part in (first, second, later):
        assert Rerun(part, run.text).run().difference is None


class Bad:
    def __reduce__(self) -> Any:
        return print, ("this must not run",)


@pytest.mark.parametrize(
    "state",
    [
        pickle.dumps((LeaseIds(bytes), {"robot": Bad()})),
        pickle.dumps(__import__("os").system),
        pickle.dumps(robots.load_robot),  # A project function that reads files.
        pickle.dumps(Path("x")),
        b"cos\nsystem\n(S'true'\ntR.",
        b"ctsd_twin.robots.loader\nPath\n(S'/'\ntR.",
        b"\x80\x04\x8c\x12tsd_twin.lie\x8c\x0anp.loadtxt\x93.",
        b"",
        b"garbage",
    ],
    ids=range(9),
)
def test_a_state_from_another_person_runs_no_code(
    state: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(TwinError, match="cannot be read"):
        load_state(state, bytes)
    assert capsys.readouterr().out == ""


def test_state_of_another_version_is_refused() -> None:
    ids = LeaseIds(bytes)
    controller = RobotController(robots.load_robot("tsd"), ids)
    load_state(dump_state(controller, ids, frozenset()), bytes)
    for owner in (controller, controller.supervisor):
        name, value = list(vars(owner).items())[-1]
        delattr(owner, name)
        with pytest.raises(TwinError, match=f"{name} and is of another version"):
            load_state(dump_state(controller, ids, frozenset()), bytes)
        setattr(owner, name, value)


@pytest.mark.parametrize("renamed", [b"supervisor", b"SafetySupervisor"])
def test_a_state_with_renamed_modules_or_classes_is_of_another_version(renamed: bytes) -> None:
    ids = LeaseIds(bytes)
    state = dump_state(RobotController(robots.load_robot("tsd"), ids), ids, frozenset())
    assert renamed in state
    with pytest.raises(TwinError, match="is of another version"):
        load_state(state.replace(renamed, renamed[:-1] + b"x"), bytes)


def test_a_log_without_lease_ids_runs_all_the_same() -> None:
    run = run_of("tsd")
    ids = {call.id for call in run.calls if isinstance(call, LeaseDrawn)}
    assert len(ids) >= 3
    redactor = Redactor()
    key = "twin/tsd/log/inputs"
    payloads = [
        redactor.entry(Entry(key, "msgpack", "", 0, 0, 0, encode_batch(batch))).data
        for batch in run.batches
    ]
    for payload in payloads:
        assert not any(each in payload or each.hex().encode() in payload for each in ids)
    batches = [decode_batch(payload) for payload in payloads]
    for first in (0, 20, 40):
        (stretch,) = stretches(batches[first:])
        assert Rerun(stretch, run.text).run().difference is None
    assert any(each in encode_batch(batch) for each in ids for batch in run.batches)


def test_what_if_another_description_drove() -> None:
    run = run_of("omni4")
    (stretch,) = stretches(run.batches)
    other = robots.parse_description(
        run.text.replace("acceleration_mps2", "acceleration_mps2  ", 1), "other"
    )
    assert WhatIf(stretch, run.text, other).run().difference is None
    slower = msgspec.structs.replace(
        other, limits=msgspec.structs.replace(other.limits, acceleration_mps2=0.5)
    )
    difference = WhatIf(stretch, run.text, slower).run().difference
    assert difference is not None
    assert difference.robot_s == pytest.approx(run.first("driving"), abs=1e-9)
    with pytest.raises(TwinError, match="other joints"):
        WhatIf(stretch, run.text, robots.load_robot("kiwi"))


def test_what_if_begins_where_the_robot_is_free() -> None:
    """The start pose is the recorded one; while another operator drives, there is no start."""
    run = run_of("omni4")
    driving = next(
        i for i, b in enumerate(run.batches)
        if any(isinstance(c, StatusCall) and c.mode == "driving" for c in b.calls)
    )  # fmt: skip
    (stretch,) = stretches(run.batches[driving + 1 : driving + 4])
    with pytest.raises(TwinError, match="no state in which the robot is disarmed"):
        WhatIf(stretch, run.text, robots.parse_description(run.text, "other"))
    (stretch,) = stretches(run.batches[1:])
    result = WhatIf(stretch, run.text, robots.parse_description(run.text, "other")).run()
    recorded, here = np.array(result.recorded_estimates), np.array(result.estimates)
    np.testing.assert_allclose(here[:, :3], recorded[:, :3], atol=0.05)


def _watched_drive(radius_m: float) -> tuple[LoggedRun, str]:
    """Return a drive under a camera, with a wheel radius that differs from the description."""
    described = TEXTS["tsd"]
    harness = LoggedHarness(
        described.replace("wheel_radius_m = 0.04", f"wheel_radius_m = {radius_m}"), 3
    )
    operator = harness.get_ready("alice")
    for i in range(260):
        if i % 2 == 0 and 30 < i < 200:
            harness.send(operator, (0.5, 0.0, 0.0))
        if i % 4 == 0:
            assert harness.simulated is not None
            harness.show(harness.simulated.truth(harness.now_s).pose)
        harness.tick()
    harness.take()
    return harness.run, described


def test_what_if_finds_the_wheel_radius_nearer_to_the_camera() -> None:
    run, described = _watched_drive(0.042)
    (stretch,) = stretches(run.batches)
    off_m: dict[float, float] = {}
    for radius_m in (0.04, 0.042):
        text = described.replace("wheel_radius_m = 0.04", f"wheel_radius_m = {radius_m}")
        result = WhatIf(stretch, run.text, robots.parse_description(text, "other")).run()
        motions = result.sensed_motion()
        assert motions is not None
        assert motions[0][0] == pytest.approx(0.88, abs=0.05)
        off_m[radius_m] = abs(float(motions[1][0] - motions[0][0]))
    assert off_m[0.042] < 0.5 * off_m[0.04]
    assert off_m[0.04] == pytest.approx(0.05 * 0.88, rel=0.5)


def test_resimulation_follows_changed_limits() -> None:
    run, described = _watched_drive(0.04)
    (stretch,) = stretches(run.batches)
    slow = described.replace("speed_mps = 1.0", "speed_mps = 0.25")
    ends: list[float] = []
    for text in (described, slow):
        other = robots.parse_description(text, "other")
        result = Resimulation(stretch, run.text, other).run()
        assert result.difference is None or "raises" not in result.difference.what
        assert result.sensed_motion() is None, "recorded poses are of another motion"
        ends.append(float(result.odometry[-1][0]))
    assert ends[0] == pytest.approx(0.85, abs=0.1)
    assert ends[1] == pytest.approx(0.5 * ends[0], rel=0.1)
    follows_not = WhatIf(stretch, run.text, robots.parse_description(slow, "other")).run()
    # Recorded joints do not follow its setpoints, so it trips; recorded poses still move it.
    assert follows_not.estimates[-1][0] == pytest.approx(ends[0], abs=0.1)


def test_largest_setpoint_difference_has_joint_and_time() -> None:
    run, described = _watched_drive(0.04)
    (stretch,) = stretches(run.batches)
    slow = described.replace("speed_mps = 1.0", "speed_mps = 0.25")
    result = WhatIf(stretch, run.text, robots.parse_description(slow, "other")).run()
    largest = result.largest_setpoint_difference(JointKind.POSITION)
    assert largest is not None
    apart, step, joint = largest
    names = [each.name for each in result.robot.kinematics().joints]
    assert names[joint].endswith(("alpha", "beta"))
    assert apart == abs(result.setpoints[step][joint] - result.recorded[step][joint]) > 0.0
    moving = next(i for i, each in enumerate(result.estimates) if abs(each[3]) > 0.1)
    assert step > moving


def test_an_empty_log_has_no_stretch() -> None:
    assert stretches([]) == []
    assert stretches([InputBatch(5, [])]) == []


def test_a_low_battery_slows_the_repetition_as_it_did_the_robot() -> None:
    harness = LoggedHarness(TEXTS["tsd"], seed=5)
    harness.wait(0.3)
    pilot = harness.get_ready()
    harness.battery_v = 11.0
    harness.drive(pilot, (0.8, 0.0, 0.0), 2.0)
    harness.take()
    assert harness.twist[0] == pytest.approx(0.5)
    assert rerun(harness.run).difference is None


def test_a_hot_servo_slows_the_repetition_as_it_did_the_robot() -> None:
    harness = LoggedHarness(TEXTS["tsd"], seed=5)
    harness.wait(0.3)
    pilot = harness.get_ready()
    harness.servo_c = 72.0
    harness.drive(pilot, (0.8, 0.0, 0.0), 2.0)
    harness.take()
    assert harness.twist[0] == pytest.approx(0.5)
    assert rerun(harness.run).difference is None
