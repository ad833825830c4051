"""docs/bus.md matches the topics and messages, and its client runs."""

from __future__ import annotations

import ast
import json
import os
import queue
import re
import struct
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from tests.support.markdown_pages import code, page, quoted, section, tables
from tests.support.programs import Program
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin.bus import Bus, client_config
from tsd_twin.messages import commands, events, services, topics
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.codes import Reason
from tsd_twin.messages.services import decode_request
from tsd_twin.messages.status import DropCounts, PoseSensorDrops, RobotStatus, encode_stamp
from tsd_twin.messages.topics import TOPICS, Sample, Service

PAGE = page("bus.md")
REQUESTS: dict[str, type[msgspec.Struct]] = {
    "srv/lease": services.LeaseRequest,
    "srv/set_pose": services.SetPoseRequest,
    "srv/speed": services.SpeedRequest,
    "stop": services.StopRequest,
    "desc": msgspec.defstruct("Empty", ()),
}
ANSWERS: dict[str, type[msgspec.Struct]] = {
    "srv/lease": services.LeaseReply,
    "desc": services.Description,
}


def test_every_topic_is_in_the_table_with_type_rate_and_urgency() -> None:
    streams, qualities, _ = tables(section(PAGE, "## Streams"))
    *rows, alive, instance = streams
    shown = [(quoted(key)[0], quoted(kind)[0], float(hz), qos) for key, kind, hz, qos, _ in rows]
    assert shown == [(t.path, t.type, t.rate_hz, t.qos.value) for t in TOPICS]
    assert topics.alive_key("*") == f"twin/*/{quoted(alive[0])[0]}"
    assert topics.instance_key("*", "*") == f"twin/*/{quoted(instance[0])[0]}"
    assert [row[0] for row in qualities] == [qos.value for qos in topics.QoS]


def test_the_attachments_are_packed_as_shown() -> None:
    _, _, attachments = tables(section(PAGE, "## Streams"))
    formats = {name: quoted(packed)[0] for name, packed, _ in attachments}
    lease = bytes(range(16))
    assert commands.encode_attachment(7, lease, 9) == struct.pack(formats["command"], 7, lease, 9)
    assert encode_stamp(7, -9) == struct.pack(formats["stamp"], 7, -9)


def test_every_service_is_shown_with_a_request_and_an_answer_that_can_be_read() -> None:
    (rows,) = tables(section(PAGE, "## Services"))
    for name, request, answer in rows:
        kind = REQUESTS.get(quoted(name)[0], services.HolderRequest)
        if "of a sphere" in name:
            kind = services.SetOrientationRequest
        decode_request(quoted(request)[0].encode(), kind)
        assert set(json.loads(quoted(request)[0])) <= set(kind.__struct_encode_fields__)
        if quoted(answer):
            reply = ANSWERS.get(quoted(name)[0], services.Reply)
            assert set(json.loads(quoted(answer)[0])) <= set(reply.__struct_encode_fields__)
            msgspec.json.decode(quoted(answer)[0], type=reply)
    assert {quoted(row[0])[0] for row in rows} == {service.value for service in Service}
    shown = {key for row in rows for cell in row[1:] for c in quoted(cell) for key in json.loads(c)}
    shapes = (services.LeaseRequest, services.LeaseReply)
    for kind in (
        *shapes,
        services.SetPoseRequest,
        services.SetOrientationRequest,
        services.SpeedRequest,
    ):
        assert set(kind.__struct_encode_fields__) <= shown


def test_the_reasons_for_dropping_are_those_that_are_counted() -> None:
    (rows,) = tables(section(PAGE, "## Why a command does not count"))
    assert {quoted(row[0])[0] for row in rows} == set(DropCounts.__struct_encode_fields__)


def leaves(kind: type[msgspec.Struct], path: str = "") -> Iterator[str]:
    """Yield the fields of a status, with the counts by reason as one."""
    for name, hint in typing.get_type_hints(kind).items():
        (inner, *_) = [t for t in (typing.get_args(hint) or (hint,)) if t is not type(None)]
        counts = inner in (DropCounts, PoseSensorDrops, Reason)
        if isinstance(inner, type) and issubclass(inner, msgspec.Struct) and not counts:
            yield from leaves(inner, f"{path}{name}.")
        else:
            yield f"{path}{name}"


def test_every_field_of_the_status_is_explained() -> None:
    (rows,) = tables(section(PAGE, "## Status"))
    assert [field for row in rows for field in quoted(row[0])] == list(leaves(RobotStatus))


def test_the_event_that_is_shown_is_one() -> None:
    shown = json.loads(quoted(section(PAGE, "## Events").splitlines()[-1])[0])
    assert set(shown) == set(events.Event.__struct_encode_fields__)


def test_the_client_needs_zenoh_and_rosbags_only() -> None:
    (example,) = code(PAGE, "python")
    imported: set[str] = set()
    for node in ast.walk(ast.parse(example)):
        if isinstance(node, ast.Import):
            imported |= {name.name.split(".")[0] for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            imported.add(str(node.module).split(".")[0])
    assert imported - sys.stdlib_module_names == {"zenoh", "rosbags"}


@pytest.mark.system
def test_the_client_drives_the_mock_half_a_metre(tmp_path: Path) -> None:
    (example,) = code(PAGE, "python")
    script = tmp_path / "drive.py"
    script.write_text(example, encoding="utf-8")
    mock = Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0"])
    try:
        endpoint = mock.ready().split()[-1]
        run = [sys.executable, str(script), endpoint]
        # Outside the checkout, so that no module of this project can be imported by chance.
        with WithheldTime(os.getpid()) as withheld:
            done = subprocess.run(
                run, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S
            )
        assert done.returncode == 0, done.stdout + done.stderr
        said = re.fullmatch(r"x (\S+) m, y (\S+) m, (\d+) commands counted\n", done.stdout)
        assert said, done.stdout
        with Bus(client_config([endpoint])) as bus:
            truth: queue.Queue[Sample] = queue.Queue()
            bus.subscribe(topics.TRUTH.key("tsd"), truth.put)
            x, y, heading = decode_odometry(truth.get(timeout=PATIENCE_S).payload).xy_heading
        # The distance depends slightly on when the script wakes up.
        assert x == pytest.approx(0.5, abs=0.15 + 0.5 * withheld.total_s)
        # Joints move unmeasured while the machine withholds the processor from the loop.
        off_m = 0.03 + 0.3 * withheld.total_s
        assert (float(said[1]), float(said[2])) == pytest.approx((x, y), abs=off_m)
        assert abs(heading) < 0.05
        assert int(said[3]) > 10
    finally:
        mock.end()
        mock.clean_up()
