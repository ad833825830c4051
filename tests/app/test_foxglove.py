"""`tsd-foxglove` as a user runs it, with a third-party client of the protocol."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import ssl
import struct
import subprocess
import sys
import time
from collections.abc import Coroutine, Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import aiohttp
import numpy as np
import pytest
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Subprotocol

import tsd_twin
from tests.app.conftest import stays_put
from tests.app.foxglove_client import (
    TWIST,
    ForeignClient,
    foreign_client,
    twist_cdr,
    twist_json,
)
from tests.support.key_folders import provision_folder
from tests.support.link_sockets import Relay
from tests.support.programs import Program
from tests.support.recorded_drives import RecordedDrive
from tests.support.robot_node import QUICK
from tests.support.withheld import PATIENCE_S, WithheldTime
from tsd_twin import robots
from tsd_twin.adapters.foxglove.gateway import FOXGLOVE_ORIGIN, SILENT_S
from tsd_twin.adapters.ros_topics import PUBLISHED, SERVICES
from tsd_twin.bus import Bus, as_client, client_config
from tsd_twin.recording.mcap_file import RecordingFile

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]

PROTOCOL = Subprotocol("foxglove.sdk.v1")
ALLOWANCE_M = robots.load_robot("tsd").limits.stop_allowance_m
SPEED_MPS = 0.8
T = TypeVar("T")


@dataclass(frozen=True)
class Stage:
    """Robot and adapter in separate processes."""

    endpoint: str
    relay: Relay
    """Relay between robot and adapter."""
    url: str
    robot: Program
    adapter: Program

    def withheld(self) -> WithheldTime:
        """Measure the CPU time withheld from the robot, the adapter and this process."""
        return WithheldTime(self.robot.process.pid, self.adapter.process.pid, os.getpid())

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run(work)


def url_of(program: Program) -> str:
    return program.ready().split()[-1]


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stage]:
    toml = tmp_path_factory.mktemp("robot") / "tsd.toml"
    toml.write_text(QUICK, encoding="utf-8")
    programs = [Program(["tsd_mock", "--listen", "tcp/127.0.0.1:0", "--robot", str(toml)])]
    try:
        endpoint = programs[0].ready().split()[-1]
        with Relay(endpoint) as relay:
            flags = ["--connect", relay.endpoint, "--port", "0"]
            programs.append(Program(["tsd_foxglove", *flags]))
            yield Stage(endpoint, relay, url_of(programs[1]), *programs)
            assert programs[1].end() == 0
            assert "Traceback" not in programs[1].sentence, programs[1].sentence
            assert len(programs[1].errors) < 50, "a client fills the log with its mistakes"
    finally:
        for program in programs:
            program.clean_up()


@pytest.fixture(autouse=True)
def at_rest(request: pytest.FixtureRequest) -> Generator[None]:
    """Start each test with the robot free and disarmed."""
    yield
    if "stage" in request.fixturenames:
        stage: Stage = request.getfixturevalue("stage")
        with (
            tsd_twin.connect(stage.endpoint) as robot,
            robot.control("cleaner", take_over=True, arm=False) as base,
        ):
            if robot.state.mode in ("stopped", "fault"):
                base.reset()


def arm_and_release(endpoint: str) -> None:
    """Leave the robot ready, without an operator; it remains ready for 10 s."""
    with Bus(as_client(client_config([endpoint]), PATIENCE_S)) as bus:

        def ask(service: str, **request: object) -> Any:
            return json.loads(bus.query(f"twin/tsd/{service}", json.dumps(request).encode()))

        lease = ask("srv/lease", op="acquire", operator="arms")["lease"]
        assert ask("srv/arm", lease=lease)["ok"]
        with tsd_twin.connect(endpoint) as robot:
            end_s = time.monotonic() + PATIENCE_S
            while robot.state.mode != "ready":
                assert time.monotonic() < end_s
                ask("srv/lease", op="renew", operator="arms", lease=lease)
                robot.sleep(0.1)
        ask("srv/lease", op="release", operator="arms", lease=lease)


def test_a_foreign_client_sees_all_topics_and_gets_the_urdf_with_its_meshes(stage: Stage) -> None:
    async def work() -> None:
        async with foreign_client(stage.url) as it:
            names = {row.name if row.name[0] == "/" else f"/{row.name}" for row in PUBLISHED}
            await it.until(lambda: names <= set(it.topics), "not all topics")
            assert set(it.services) == {f"/{name}" for name in SERVICES}
            schemas = {each["topic"]: each for each in it.client.channels.values()}
            for row in PUBLISHED:
                if row.name != "status":
                    channel = schemas[row.name if row.name[0] == "/" else f"/{row.name}"]
                    assert channel["schemaName"] == row.type
                    assert channel["encoding"] == "cdr"
            await it.subscribe(
                *("/tf", "/tf_static", "/odom", "/joint_states", "/joint_setpoints"),
                *("/robot_description", "/diagnostics", "/battery_state"),
            )
            moved = {each.child_frame_id for each in it.message("/tf").transforms}
            assert moved & {"base_footprint", "module1_inner"}
            assert it.message("/odom").header.frame_id == "odom"
            assert it.message("/battery_state").voltage > 5.0
            assert len(it.message("/joint_states").name) == 9
            text = it.message("/robot_description").data
            uris = re.findall(r'filename="(package://[^"]+)"', text)
            assert len(uris) > 5
            for uri in (uris[0], uris[-1]):
                mesh = await it.client.fetch_asset(uri)
                assert len(mesh) == 84 + 50 * struct.unpack_from("<I", mesh, 80)[0], "an STL file"
            for uri in ("package://tsd_description/meshes/../../etc/passwd", "file:///etc/passwd"):
                with pytest.raises(Exception, match=r".+"):
                    await it.client.fetch_asset(uri)

    stage.run(work())


@pytest.mark.parametrize("encoding", ["json", "cdr"])
def test_a_foreign_client_arms_drives_and_silence_stops_the_robot(
    stage: Stage, encoding: str
) -> None:
    """Within the distance that is promised for a link that fails."""

    async def drive_and_fall_silent(it: ForeignClient) -> None:
        await it.pause()
        before, start_m = it.status["stops"], it.x_m
        with stage.withheld() as withheld:  # The latest pose may also be late.
            await it.push(SPEED_MPS, 1.2, encoding)
            last_m, last_s = it.x_m, time.monotonic()
            await it.until(lambda: it.status["mode"] == "ready", "it does not stop")
            await it.until_still()
        # The latest received pose may be two stream periods old.
        travel_m = it.x_m - last_m
        assert travel_m < ALLOWANCE_M + (0.04 + withheld.total_s) * SPEED_MPS
        assert time.monotonic() - last_s < 10.0
        assert last_m - start_m > 0.3
        assert it.status["stops"] == before, "the adapter sends no zeros"

    async def work() -> None:
        async with foreign_client(stage.url) as it:
            answer = await it.call("/arm")
            assert answer == {"success": True, "message": "ready"}
            assert it.status["lease"]["holder"].startswith("foxglove-")
            await drive_and_fall_silent(it)

    stage.run(work())


def test_a_person_who_takes_over_has_control_and_twists_do_not_take_it_back(stage: Stage) -> None:
    async def work() -> None:
        async with foreign_client(stage.url) as it:
            await it.call("/arm")
            await it.pause()
            async with contextlib.AsyncExitStack() as opened:
                drives = it.driving(0.3, lambda: it.status["mode"] == "driving")
                pushing = await opened.enter_async_context(drives)
                person = await tsd_twin.connect_async(stage.endpoint)
                opened.push_async_callback(person.close)
                control = person.control("person", take_over=True, arm=False, reason="mine")
                await control.acquire()
                await it.until(lambda: it.status["lease"]["holder"] == "person", "no take-over")
                await it.until(
                    lambda: any("control is lost" in text for text in it.said), "not told"
                )
                await it.until_still()
                at_m = it.x_m
                await asyncio.sleep(0.5)
                await control.release()
                await it.until(lambda: it.status["lease"]["holder"] is None, "not released")
                await asyncio.sleep(1.0)
                assert not pushing.done()
                assert abs(it.x_m - at_m) < 0.01, "a held stick moves nothing"
            await it.pause()
            await it.push(0.3, 0.5)
            assert it.status["lease"]["holder"] is None, "nor does a new push"
            assert (await it.call("/arm"))["success"]
            await it.pause()
            async with it.driving(0.3, lambda: it.x_m - at_m > 0.02):
                pass  # The service arm takes control again.

    stage.run(work())


def test_services_stop_reset_and_disarm_and_their_refusals(stage: Stage) -> None:
    async def work() -> None:
        async with foreign_client(stage.url) as it, foreign_client(stage.url) as other:
            await it.call("/arm")
            refused = await other.call("/arm")
            assert not refused["success"]
            assert it.status["lease"]["holder"] in refused["message"]
            assert (await other.call("/stop"))["success"], "each may stop"
            await it.until(lambda: it.status["mode"] == "stopped", "not stopped")
            assert not (await it.call("/arm"))["success"]
            assert await it.call("/reset") == {"success": True, "message": "disarmed"}
            assert (await it.call("/arm"))["success"]
            assert (await it.call("/disarm"))["success"]
            await it.until(lambda: it.status["lease"]["holder"] is None, "not released")

    stage.run(work())


def test_a_client_that_is_killed_leaves_a_robot_at_rest_and_free(stage: Stage) -> None:
    async def work() -> None:
        async with foreign_client(stage.url) as it:
            async with foreign_client(stage.url) as driver:
                await driver.call("/arm")
                await driver.pause()
                withheld = stage.withheld()  # The latest pose may also be late.
                await driver.push(SPEED_MPS, 0.8)
                last_m = it.x_m
                # The system sends this for a killed process.
                driver.client.socket.transport.abort()
            await it.until(lambda: it.status["lease"]["holder"] is None, "still held")
            await it.until_still()
            assert it.x_m - last_m < ALLOWANCE_M + (0.04 + withheld.total_s) * SPEED_MPS
            assert it.status["mode"] == "disarmed"

    stage.run(work())


def test_a_robot_that_comes_back_into_reach_is_not_moved_by_a_stick_that_is_held_on(
    stage: Stage,
) -> None:
    """The adapter loses its connection to the robot, which remains ready."""

    async def work() -> float:
        async with foreign_client(stage.url) as it:
            await it.call("/arm")
            await it.pause()
            async with contextlib.AsyncExitStack() as opened:
                robot = opened.enter_context(tsd_twin.connect(stage.endpoint))
                drives = it.driving(0.3, lambda: robot.state.mode == "driving")
                pushing = await opened.enter_async_context(drives)
                with stage.relay.cut():
                    await it.until(
                        lambda: robot.state.status.lease.holder is None, "the lease does not end"
                    )
                    at_m = robot.state.truth.pose.x_m
                await it.until(lambda: "/odom" not in it.topics, "it is still shown")
                await it.until(lambda: "/odom" in it.topics, "it is not shown again")
                await asyncio.sleep(2.0)
                assert not pushing.done()
                return abs(robot.state.truth.pose.x_m - at_m)

    assert stage.run(work()) < 0.01


def test_the_adapter_that_hangs_drives_on_with_no_command_of_before(stage: Stage) -> None:
    """Stopped for three seconds while twists pile up in its buffers; the stick is held on."""

    async def work() -> None:
        async with foreign_client(stage.url) as it:
            await it.call("/arm")
            await it.pause()
            pushing = asyncio.create_task(it.push(SPEED_MPS, 6.0))
            await asyncio.sleep(1.0)
            stage.adapter.process.send_signal(signal.SIGSTOP)
            with tsd_twin.connect(stage.endpoint) as robot:
                robot.sleep(0.1)
                with stage.withheld() as withheld:
                    last_m = robot.state.truth.pose.x_m
                    await asyncio.sleep(1.5)
                still_m = robot.state.truth.pose.x_m
                assert still_m - last_m < ALLOWANCE_M + withheld.total_s * SPEED_MPS
                stage.adapter.process.send_signal(signal.SIGCONT)
                on_s = time.monotonic()
                with stage.withheld() as withheld:
                    await asyncio.sleep(1.5)
                moved_m = abs(robot.state.truth.pose.x_m - still_m)
                stays_put(moved_m, it.pushed_s, on_s, withheld.total_s)
            pushing.cancel()
            await asyncio.gather(pushing, return_exceptions=True)

    stage.run(work())


def test_a_client_that_answers_no_ping_drives_nothing_and_is_cut_off(stage: Stage) -> None:
    """Without pong replies the age of its twists is unbounded, as over a stalled link."""

    async def work() -> None:
        async with foreign_client(stage.url) as it:
            await asyncio.to_thread(arm_and_release, stage.endpoint)
            async with (
                aiohttp.ClientSession() as session,
                session.ws_connect(stage.url, protocols=(PROTOCOL,), autoping=False) as line,
            ):
                channel = {"id": 1, "topic": "/cmd_vel", "encoding": "json", "schemaName": TWIST}
                await line.send_json({"op": "advertise", "channels": [channel]})
                start_s, start_m, withheld = time.monotonic(), it.x_m, stage.withheld()
                await asyncio.sleep(0.4)

                async def push() -> None:
                    while True:
                        await line.send_bytes(struct.pack("<BI", 1, 1) + twist_json(0.5))
                        await asyncio.sleep(0.05)

                pushing = asyncio.create_task(push())
                texts = [
                    message.data async for message in line if message.type is aiohttp.WSMsgType.TEXT
                ]
                pushing.cancel()
                took_s = time.monotonic() - start_s
                assert SILENT_S - 0.5 < took_s < SILENT_S + 5.0 + withheld.total_s
                assert any("comes too late" in text for text in texts), texts
                assert abs(it.x_m - start_m) < 1e-3

    stage.run(work())


async def closed_by(url: str, data: bytes | str, patience_s: float = PATIENCE_S) -> int | None:
    """Return the close code of a connection that sends `data`, or None if it remains open.

    Without a closing handshake the code is 1006, as in browsers.
    """
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(url, protocols=(PROTOCOL,)) as line,
    ):
        await (line.send_str(data) if isinstance(data, str) else line.send_bytes(data))
        try:
            async with asyncio.timeout(patience_s):
                async for _ in line:
                    pass
        except aiohttp.ClientConnectionResetError:  # While replying to a ping.
            return aiohttp.WSCloseCode.ABNORMAL_CLOSURE
        except TimeoutError:
            pass
        return line.close_code


def test_hostile_messages_move_nothing_and_end_nothing(stage: Stage) -> None:
    async def work() -> None:
        async with foreign_client(stage.url) as it:
            await it.call("/arm")
            await it.pause()
            start_m = it.x_m
            await it.publish(twist_json(float("nan")))
            await it.publish(twist_cdr(float("nan")), encoding="cdr")
            await it.publish(twist_cdr(float("inf")), encoding="cdr")
            await it.publish(twist_cdr(1e300), encoding="cdr")
            await it.publish(b'{"linear": {"x": 1e999}}')
            await it.publish(b'{"speed": 1}')
            await it.publish(twist_json(0.5), schema="nav_msgs/msg/Odometry")
            await it.publish(twist_json(0.5), topic="/other/cmd_vel")
            await it.publish(twist_json(0.5), encoding="protobuf")
            await it.publish(twist_cdr(0.5)[:20], encoding="cdr")
            line = it.client.socket
            noise = np.random.default_rng(1)
            for _ in range(50):
                await line.send(noise.bytes(noise.integers(60)))
            for text in ("{}", "[", "null", '{"op": "nothing"}', '{"op": "advertise"}', "x" * 9999):
                await line.send(text)
            await asyncio.sleep(0.5)
            assert abs(it.x_m - start_m) < 1e-3
            assert it.status["mode"] == "ready"
            assert any("not finite" in text for text in it.said)
            ids = [{"id": i, "channelId": i} for i in range(1000)]
            many = json.dumps({"op": "subscribe", "subscriptions": ids})
            # The message is too long. The close reason may be lost if the connection ends first.
            assert await closed_by(stage.url, bytes(1_000_000)) in (1009, 1006)
            # Its own error replies flood only its own connection.
            await closed_by(stage.url, many, patience_s=2.0)
            await it.until(lambda: abs(it.x_m - start_m) < 1e-3, "moved")
            await it.pause()
            await it.push(0.4, 0.6)
            assert it.x_m - start_m > 0.05, "this client still drives"

    stage.run(work())


def test_foreign_pages_and_names_are_refused_before_the_socket_is_open(stage: Stage) -> None:
    def code(**headers: str) -> int:
        try:
            with connect(stage.url, subprotocols=[PROTOCOL], additional_headers=headers):
                return 101
        except InvalidStatus as error:
            return error.response.status_code

    assert code() == 101
    assert code(Origin=FOXGLOVE_ORIGIN) == 101
    for origin in ("https://evil.example", "null", "file://", f"{FOXGLOVE_ORIGIN}.evil.example"):
        assert code(Origin=origin) == 403
    with pytest.raises(InvalidStatus, match="400"), connect(stage.url):
        pass


def test_other_machines_need_a_token_and_tls(start: Any, tmp_path: Path) -> None:
    nowhere = ("--connect", "tcp/127.0.0.1:1")
    beyond = ("tsd_foxglove", "--host", "0.0.0.0", "--port", "0", *nowhere)
    token = tmp_path / "token"
    (tmp_path / "short").write_text("secret\n")
    (tmp_path / "short").chmod(0o600)
    for flags, word in (
        ((), "--token-file"),
        (("--token-file", str(token)), "--tls-cert"),
        (("--token-file", str(tmp_path / "short")), "24"),
    ):
        refused = start(*beyond, *flags)
        assert refused.wait() == 1
        assert word in refused.sentence
    assert token.stat().st_mode & 0o077 == 0
    provision_folder(tmp_path / "keys", hosts=("robot.example",))
    pem, key = str(tmp_path / "keys/robot.pem"), str(tmp_path / "keys/robot.key")
    program = start(*beyond, "--token-file", str(token), "--tls-cert", pem, "--tls-key", key)
    port = int(url_of(program).rpartition(":")[2])
    trust = ssl.create_default_context(cafile=tmp_path / "keys/ca.pem")

    async def answer(path: str, headers: dict[str, str]) -> int:
        # Not the client of `websockets.sync`, which reads and writes one TLS connection on two
        # threads: on a busy machine one in two hundred handshakes with any server never ends.
        try:
            async with connect_async(
                f"wss://robot.example:{port}/{path}",
                host="127.0.0.1",
                ssl=trust,
                subprotocols=[PROTOCOL],
                additional_headers=headers,
            ):
                return 101
        except InvalidStatus as error:
            return error.response.status_code

    def code(path: str, **headers: str) -> int:
        return asyncio.run(answer(path, headers))

    secret = token.read_text().strip()
    assert code(f"?token={secret}") == 101
    assert code("", Authorization=f"Bearer {secret}") == 101
    assert code("") == code(f"?token={secret}x") == code("?token=") == 401
    assert code(f"?token={secret}", Origin="https://evil.example") == 403
    assert program.end() == 0


def test_without_the_extra_it_says_how_to_install_it() -> None:
    text = "import sys; sys.modules['foxglove'] = None; import tsd_foxglove; tsd_foxglove.main()"
    done = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "pip install" in done.stderr
    assert "[foxglove]" in done.stderr


def recorded(path: Path) -> Path:
    file = RecordingFile(path)
    drive = RecordedDrive(file)
    drive.circle(6)
    file.close()
    return path


def test_a_recording_plays_pauses_and_seeks_for_who_brings_the_token(
    start: Any, tmp_path: Path
) -> None:
    path, token = recorded(tmp_path / "run.mcap"), tmp_path / "token"
    program = start(
        *("tsd_foxglove", "--recording", str(path), "--port", "0", "--token-file", str(token))
    )
    url = url_of(program)
    for bad in (url, f"{url}/?token=wrong"):
        with pytest.raises(InvalidStatus, match="401"), connect(bad, subprotocols=[PROTOCOL]):
            pass

    async def work() -> None:
        it = ForeignClient(f"{url}/?token={token.read_text().strip()}")
        await it.client.connect()
        await it.until(lambda: it.client.server_info, "no server info")
        info: Any = it.client.server_info
        start_ns, end_ns = (
            info[f"data{which}Time"]["sec"] * 10**9 + info[f"data{which}Time"]["nsec"]
            for which in ("Start", "End")
        )
        assert 6.0 < 1e-9 * (end_ns - start_ns) < 20.0
        await it.until(lambda: "/odom" in it.topics, "no odometry")
        assert not it.services
        await it.client.subscribe("/odom")
        await it.client.subscribe("/robot_description")

        async def control(play: bool, speed: float, seek_ns: int | None) -> None:
            # Command, speed, whether to seek, time, and the number of the request.
            command = (0 if play else 1, speed, seek_ns is not None, seek_ns or 0, 0)
            await it.client.socket.send(b"\x03" + struct.pack("<BfBQI", *command))

        def shown_s() -> float:
            stamp = it.message("/odom").header.stamp
            return 1e-9 * (stamp.sec * 10**9 + stamp.nanosec - start_ns)

        await control(False, 1.0, start_ns + 5 * 10**9)
        await it.until(lambda: it.counted["/odom"], "a seek shows nothing")
        assert shown_s() == pytest.approx(5.0, abs=0.05)
        paused = it.counted["/odom"]
        await asyncio.sleep(0.3)
        assert it.counted["/odom"] == paused
        await control(True, 4.0, None)
        await it.until(lambda: it.counted["/odom"] > paused + 20, "it does not play")
        assert shown_s() > 5.3
        await control(False, 1.0, start_ns + 10**9)
        await it.until(lambda: abs(shown_s() - 1.0) < 0.05, "it does not seek back")
        assert "<robot" in it.message("/robot_description").data
        await it.client.disconnect()

    asyncio.run(work())
    assert program.end() == 0
    assert "Traceback" not in program.sentence
