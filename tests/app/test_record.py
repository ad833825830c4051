"""`tsd-record`, `tsd-replay` and `tsd-lab rerun` with a driving robot."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import tsd_twin
from tests.app.small_disk import small_disk
from tests.support import programs
from tests.support.programs import Program, alive, children_of
from tests.support.robot_node import patient_robot
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.bus import Bus, as_client, client_config
from tsd_twin.control.logged_controller import LeaseDrawn, decode_batch
from tsd_twin.messages.status import decode_stamp
from tsd_twin.messages.topics import QoS, Sample, Service
from tsd_twin.recording import Recording, mcap_file, read_marks

pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]

Start = Callable[..., Program]
LOST_S = 1.0
"""Maximum data loss of a recorder."""


def until(condition: Callable[[], object], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, what
        time.sleep(0.05)


def mock(start: Start, *flags: str) -> str:
    program = start("tsd_mock", "--listen", "tcp/127.0.0.1:0", *patient_robot(), *flags)
    return program.ready().split()[-1]


def record(start: Start, endpoint: str, folder: Path, *flags: str) -> Program:
    program = start("tsd_record", "--connect", endpoint, "--dir", str(folder), *flags)
    program.ready()
    return program


def file_of(program: Program) -> Path:
    return Path(program.ready().split()[-1])


def drive(endpoint: str, duration_s: float = 1.0) -> None:
    programs.drive(
        endpoint, vx_mps=0.3, omega_rad_per_s=0.3, duration_s=duration_s, operator="alice"
    )


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def last_state_ns(path: Path) -> int:
    return max(entry.log_ns for entry in mcap_file.entries(path) if "/state/" in entry.topic)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Generator[tuple[Path, Counter[str]]]:
    """Recording of a drive with a camera, and message counts of an independent subscriber."""
    programs: list[Program] = []

    def start(*arguments: str) -> Program:
        programs.append(Program(list(arguments)))
        return programs[-1]

    counted: Counter[str] = Counter()
    numbers: dict[str, set[int]] = {}
    lock = threading.Lock()

    def count(sample: Sample) -> None:
        with lock:
            counted[sample.key] += 1
            if "/state/" in sample.key:
                numbers.setdefault(sample.key, set()).add(decode_stamp(sample.attachment)[0])

    try:
        endpoint = mock(start, "--noise", "1", "--camera")
        recorder = record(start, endpoint, tmp_path_factory.mktemp("drives"))
        path = file_of(recorder)
        until(lambda: size_of(path) > 2000, "nothing is recorded")
        with (
            Bus(as_client(client_config([endpoint]), PATIENCE_S)) as bus,
            Bus(client_config([endpoint])) as peer,
        ):
            bus.subscribe("twin/**", count)
            until(lambda: counted["twin/tsd/state/odom"] > 5, "nothing is counted")
            # Connect as a peer, like the dashboard.
            command = peer.publisher("twin/tsd/cmd/peer/twist", QoS.REAL_TIME)

            def is_counted() -> bool:
                command.put(b"not a twist", b"nor an attachment")
                return counted["twin/tsd/cmd/peer/twist"] >= 20

            until(is_counted, "no subscriber of commands")  # Best-effort delivery.
            drive(endpoint)
            with tsd_twin.connect(endpoint) as robot:
                robot.stop("enough")
                robot.sleep(0.5)
        time.sleep(1.0)  # The recorder runs longer, so it receives every counted message.
        assert recorder.end() == 0
        assert recorder.sentence == ""
        recorded: dict[str, set[int]] = {}
        for entry in mcap_file.entries(path):
            recorded.setdefault(entry.topic, set()).add(entry.sequence)
        for key, seen in numbers.items():
            assert seen <= recorded[key], f"{key} is not whole"
        yield path, counted
    finally:
        for program in programs:
            program.clean_up()


def test_every_put_of_the_bus_is_in_the_file(driven: tuple[Path, Counter[str]]) -> None:
    path, counted = driven
    in_file = {topic: s.count for topic, s in tsd_twin.open_recording(path).topics.items()}
    assert len(counted) > 8
    assert in_file["twin/tsd/cmd/alice/twist"] == counted["twin/tsd/cmd/alice/twist"] > 40
    assert in_file["twin/tsd/cmd/peer/twist/raw"] == counted.pop("twin/tsd/cmd/peer/twist") >= 20
    for key, count in counted.items():
        assert in_file[key] >= count, key
    assert in_file["twin/tsd/cmd/alice/twist/raw"] == in_file["twin/tsd/cmd/alice/twist"]


def test_others_read_it_without_our_code(driven: tuple[Path, Counter[str]]) -> None:
    path, _ = driven
    with path.open("rb") as file:
        count = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
    assert count > 1000
    with AnyReader([path]) as reader:
        assert reader.message_count == count
        typed = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.msgtype != "__schemaless__"
        ]
    assert {type(message).__name__ for message in typed} == {
        "nav_msgs__msg__Odometry", "sensor_msgs__msg__JointState",
        "geometry_msgs__msg__TwistStamped", "geometry_msgs__msg__PoseStamped",
    }  # fmt: skip


def test_it_has_requests_answers_events_and_description(
    driven: tuple[Path, Counter[str]],
) -> None:
    recording = tsd_twin.open_recording(driven[0])
    assert recording.robots == ("tsd",)
    asked = [message.value for message in recording.messages("requests")]
    assert {"srv/lease", "srv/arm", "srv/disarm", "stop"} <= {each["service"] for each in asked}
    assert any(each["reply"].get("granted") for each in asked)
    assert any(each["request"].get("reason") == "enough" for each in asked)
    assert "kind" in recording.description()
    assert next(recording.messages("alive")).value == {"alive": True}
    modes = [message.value["text"] for message in recording.messages("event/mode")]
    assert any("to driving" in text for text in modes)
    odom, joints = recording.read("state/odom"), recording.read("state/joints")
    assert abs(odom["pose.pose.position.x"][-1]) > 0.1
    assert joints["position.module1_alpha"].shape == joints.t_s.shape == joints.robot_s.shape
    assert (odom.robot_s[1:] > odom.robot_s[:-1]).all()
    assert set(recording.read("state/status")["mode"]) >= {"disarmed", "ready", "driving"}


def test_the_drive_is_run_again_bit_for_bit(
    driven: tuple[Path, Counter[str]], start: Start, tmp_path: Path
) -> None:
    path, _ = driven
    rerun = start("tsd_lab", "rerun", str(path), "--out", str(tmp_path), "--quiet")
    assert rerun.wait() == 0, rerun.sentence
    assert "set-points and estimates are the recorded ones" in rerun.output[0]
    assert (tmp_path / "rerun.png").read_bytes().startswith(b"\x89PNG")
    what_if = ("--set", "limits.acceleration_mps2=0.4", "--out", str(tmp_path / "b"))
    other = start("tsd_lab", "rerun", str(path), *what_if)
    assert other.wait() == 0, other.sentence
    said = "\n".join(other.output)
    assert re.search(r"largest difference of set-points: module\d_\w+ by \S+ rad at [\d.]+ s", said)
    assert said.count("deg from the pose sensor") == 2
    again = start("tsd_lab", "rerun", str(path), "--resimulate", *what_if)
    assert again.wait() == 0, again.sentence
    assert "largest difference of the estimated position" in "\n".join(again.output)
    wrong = start("tsd_lab", "rerun", str(path), "--set", "limits=1=", "--out", str(tmp_path / "c"))
    assert wrong.wait() == 1
    assert len(wrong.errors) == 1


def test_an_export_has_no_lease_id_and_runs_again(
    driven: tuple[Path, Counter[str]], start: Start, tmp_path: Path
) -> None:
    path, _ = driven
    key = "twin/tsd/log/inputs"
    drawn = [
        call.id
        for entry in mcap_file.entries(path, {key})
        for call in decode_batch(entry.data).calls
        if isinstance(call, LeaseDrawn)
    ]
    assert drawn
    part = tmp_path / "part.mcap"
    export = start("tsd_record", "export", str(path), "--out", str(part), "--from", "1.5")
    assert export.wait() == 0, export.sentence
    for entry in mcap_file.entries(part):
        assert not any(each in entry.data or each.hex().encode() in entry.data for each in drawn)
    rerun = start("tsd_lab", "rerun", str(part), "--out", str(tmp_path / "lab"))
    assert rerun.wait() == 0, rerun.sentence
    tables = start("tsd_record", "export", str(part), "--csv", str(tmp_path / "csv"))
    assert tables.wait() == 0, tables.sentence
    head, *rows = (tmp_path / "csv/tsd_state_odom.csv").read_text().splitlines()
    assert head.startswith("t_s,robot_s,")
    assert len(rows) == tsd_twin.open_recording(part).topics["twin/tsd/state/odom"].count
    again = start("tsd_record", "export", str(path), "--out", str(part))
    assert again.wait() == 1
    assert "is there already" in again.sentence


def test_recordings_are_listed_and_marked(
    driven: tuple[Path, Counter[str]], start: Start, tmp_path: Path
) -> None:
    path = tmp_path / "drive.mcap"
    shutil.copy(driven[0], path)
    recording = tsd_twin.open_recording(path)
    marked_ns = [recording.start_ns + round(recording.duration_s * 1e9), recording.start_ns + 10**9]
    for flags in ((), ("--at", "1")):
        mark = start("tsd_record", "mark", str(path), "it slipped", *flags)
        assert mark.wait() == 0, mark.sentence
    assert [(mark.log_ns, mark.note) for mark in read_marks(path)] == [
        (log_ns, "it slipped") for log_ns in sorted(marked_ns)
    ]
    listed = start("tsd_record", "--dir", str(tmp_path), "list")
    assert listed.wait() == 0, listed.sentence
    (line,) = listed.output
    assert f"{recording.duration_s:.1f} s" in line
    assert line.endswith(" drive.mcap: tsd, 2 marks")
    late = start("tsd_record", "mark", str(path), "late", "--at", "9999")
    assert late.wait() == 1
    assert "is no part of" in late.sentence


def test_a_replay_shows_the_robot_and_refuses_control(
    driven: tuple[Path, Counter[str]], start: Start
) -> None:
    """The live robot on the same bus keeps its name and is not disturbed."""
    path, _ = driven
    endpoint = mock(start)
    replay = start("tsd_replay", str(path), "--connect", endpoint, "--speed", "2", "--loop")
    assert " tsd-replay on " in replay.ready()
    with tsd_twin.connect(endpoint, robot="tsd-replay") as robot:
        assert robot.state.status.hardware["kind"] == "recording"
        modes = {state.mode for state in robot.states(duration_s=6.0)}
        assert {"driving", "disarmed"} <= modes
        with pytest.raises(tsd_twin.ClientError, match="this is a recording of 'tsd'"):
            robot.control("bob").__enter__()
        with pytest.raises(tsd_twin.ClientError, match="did not acknowledge the stop"):
            robot.stop("it must not look as if it had stopped")
    with Bus(as_client(client_config([endpoint]), PATIENCE_S)) as bus:
        for service in Service:
            answer = json.loads(bus.query(service.key("tsd-replay"), b"{}", PATIENCE_S))
            if service is Service.DESC:
                assert set(answer) == {"robot", "urdf"}
            else:
                assert "cannot be driven or stopped" in answer["reason"]
                assert not answer.get("granted")
                assert service is Service.LEASE or not answer["ok"]
    with tsd_twin.connect(endpoint, robot="tsd") as live:
        assert live.state.mode == "disarmed"
    taken = start("tsd_replay", str(path), "--connect", endpoint, "--id", "tsd")
    assert taken.wait() == 1
    assert "'tsd' is on the bus already" in taken.sentence
    assert replay.end() == 0
    assert replay.sentence == ""


def test_a_recorder_that_is_killed_loses_less_than_a_second(start: Start, tmp_path: Path) -> None:
    endpoint = mock(start, "--noise", "1")
    chance = np.random.default_rng(5)
    cut: list[tuple[Path, int, float]] = []
    for _ in range(4):
        recorder = record(start, endpoint, tmp_path)
        path = file_of(recorder)
        until(lambda path=path: size_of(path) > 5000, "nothing is recorded")
        with WithheldTime(os.getpid()) as withheld:
            time.sleep(chance.uniform(0.0, 1.0))
            killed_ns = time.time_ns()
            recorder.end(signal.SIGKILL)
        cut.append((path, killed_ns, withheld.total_s))
    recorder = record(start, endpoint, tmp_path)
    assert [line for line in recorder.output if line.startswith("completed")]
    for path, killed_ns, withheld_s in cut:
        with path.open("rb") as file:
            assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) > 20
        assert (killed_ns - last_state_ns(path)) * 1e-9 < LOST_S + withheld_s
    assert recorder.end() == 0


def test_a_recorder_waits_for_its_robot_and_comes_back_to_it(start: Start, tmp_path: Path) -> None:
    """It ends cleanly while waiting, and resumes when the robot restarts."""
    absent = "tcp/127.0.0.1:1"
    waiting = record(start, absent, tmp_path / "a")
    assert waiting.end() == 0
    assert waiting.sentence == "" or waiting.sentence.endswith("trying until it does")
    program = start("tsd_mock", "--listen", "tcp/127.0.0.1:0")
    endpoint = program.ready().split()[-1]
    recorder = record(start, endpoint, tmp_path / "b")
    path = file_of(recorder)
    until(lambda: size_of(path) > 3000, "nothing is recorded")
    assert program.end() == 0
    start("tsd_mock", "--listen", endpoint).ready()
    size = size_of(path)
    until(lambda: size_of(path) > size + 8000, "it does not come back")
    assert recorder.end() == 0
    lives = [message.value["alive"] for message in tsd_twin.open_recording(path).messages("alive")]
    assert lives[:3] == [True, False, True]


def test_a_full_disk_is_told_once_and_the_recorder_goes_on(start: Start, tmp_path: Path) -> None:
    endpoint = mock(start)
    with small_disk(tmp_path / "disk") as disk, Bus(client_config([endpoint])) as bus:
        events: list[Sample] = []
        bus.subscribe_events("twin/tsd/event/record", events.append)
        recorder = record(start, endpoint, disk.folder)
        path, pid = file_of(recorder), recorder.process.pid
        until(lambda: size_of(path) > 3000, "nothing is recorded")
        disk.fill(pid)
        until(lambda: recorder.errors, "it does not say that the disk is full")
        full_ns = time.time_ns()
        drive(endpoint)  # Driving is unaffected.
        assert len(recorder.errors) == 1
        assert "The recording stands still" in recorder.errors[0]
        disk.free(pid)
        until(lambda: len(recorder.errors) == 2, "it does not go on")
        assert "goes on: 0 messages are lost" in recorder.errors[1]
        until(lambda: len(events) == 2, "the pages are not told")
        assert recorder.end() == 0
        recording = tsd_twin.open_recording(path)
        assert recording.start_ns + recording.duration_s * 1e9 > full_ns
        assert "driving" in set(recording.read("state/status")["mode"])
        numbers = [message.sequence for message in recording.messages("state/odom")]
        assert numbers == list(range(numbers[0], numbers[-1] + 1))


def test_a_new_file_on_demand_stands_for_itself(start: Start, tmp_path: Path) -> None:
    """Each file contains the description, and a controller state within 30 s."""
    endpoint = mock(start)
    recorder = record(start, endpoint, tmp_path)
    first = file_of(recorder)
    until(lambda: size_of(first) > 3000, "nothing is recorded")
    os.kill(recorder.process.pid, signal.SIGUSR1)
    until(lambda: len(list(tmp_path.glob("*.mcap"))) == 2, "there is no new file")
    time.sleep(1.5)
    assert recorder.end() == 0
    # File names have 1 s resolution, so they do not order files within a second.
    (second,) = set(tmp_path.glob("*.mcap")) - {first}
    one, two = (tsd_twin.open_recording(path) for path in (first, second))
    assert one.description() == two.description()
    last, following = ([m.sequence for m in each.messages("state/odom")] for each in (one, two))
    assert following[0] == last[-1] + 1


def test_the_demo_records_and_goes_on_without_its_recorder(start: Start, tmp_path: Path) -> None:
    demo = start(
        "tsd_demo", "--no-browser", "--until-eof", "--port", "0", "--bus-port", "0",
        "--record-dir", str(tmp_path / "drives"), "--keep-gb", "0.1",
    )  # fmt: skip
    endpoint = re.findall(r"tcp/[\d.:]+", demo.ready())[0]
    assert any(str(tmp_path) in line and "0.1 GB" in line for line in demo.output)
    (path,) = (tmp_path / "drives").glob("*.mcap")
    children = children_of(demo.process.pid)
    assert len(children) == 3
    until(lambda: size_of(path) > 3000, "nothing is recorded")
    (recorder,) = [
        pid for pid in children if b"tsd_record" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    os.kill(recorder, signal.SIGKILL)
    until(lambda: "the recorder has ended" in demo.sentence, "it is not told")
    drive(endpoint, 0.3)
    assert demo.end() == 0
    assert not any(alive(child) for child in children)
    assert isinstance(tsd_twin.open_recording(path), Recording)
