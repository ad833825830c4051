"""Signed commands between real processes: a listed operator drives until its key is revoked."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.support.link_sockets import free_port
from tests.support.withheld import PATIENCE_S, REALTIME
from tsd_twin import client
from tsd_twin.client.errors import ClientError, ControlDenied
from tsd_twin.messages.codes import Code

pytestmark = pytest.mark.system
_REVOKED_WITHIN_S = 1.0


def certs(folder: Path, *flags: str) -> None:
    command = [sys.executable, "-m", "tsd_certs", str(folder), *flags]
    subprocess.run(command, check=True, capture_output=True, timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys") / "keys"
    listen = f"tls/127.0.0.1:{free_port()}"
    people = ("--operator", "alice", "--operator", "bob")
    certs(folder, "--robot-host", "127.0.0.1", *people, "--listen", listen, "--signed")
    return folder


def test_a_listed_operator_drives_until_its_key_is_revoked(keys: Path, tmp_path: Path) -> None:
    theirs, later = tmp_path / "robot", tmp_path / "later"
    for copy in (theirs, later):
        shutil.copytree(keys, copy)
    certs(later, "--revoke", "alice")
    config = str(theirs / "robot.json5")
    command = [*REALTIME, sys.executable, "-m", "tsd_mock", "--until-eof", "--zenoh-config", config]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as robot:
        assert robot.stdout is not None
        assert b"ready" in robot.stdout.readline()
        try:
            _drive_and_revoke(keys, theirs, later)
        finally:
            robot.terminate()


def _drive_and_revoke(keys: Path, theirs: Path, later: Path) -> None:
    config = str(keys / "alice.json5")
    with client.connect("tsd", zenoh_config=config) as robot:
        with robot.control() as control:
            end_s = time.monotonic() + 0.5
            while time.monotonic() < end_s:
                control.set_velocity(vx_mps=0.1)
                time.sleep(0.02)
            assert robot.state.status.mode == "driving"
            before = robot.state.status.command.seq
            (later / "operators.json").replace(theirs / "operators.json")
            listed_s = time.monotonic()
            with pytest.raises(ClientError):  # noqa: PT012  It is refused at some point.
                while time.monotonic() < listed_s + 5.0:
                    control.set_velocity(vx_mps=0.1)
                    time.sleep(0.02)
            stopped_s = time.monotonic() - listed_s
            assert stopped_s < _REVOKED_WITHIN_S, f"{stopped_s:.2f} s"
            assert robot.state.status.command.seq > before
        with pytest.raises(ControlDenied) as refused, robot.control():
            pass
        assert getattr(refused.value.why, "code", None) == Code.KEY_REFUSED
    other = str(keys / "bob.json5")
    # The lease of the revoked key ends 2 s after its last renewal.
    with (
        client.connect("tsd", zenoh_config=other) as robot,
        robot.control(take_over=True, reason="her key is gone") as control,
    ):
        control.set_velocity(vx_mps=0.1)
    (keys / "bob.sign").rename(keys / "bob.kept")
    with client.connect("tsd", zenoh_config=other) as robot:
        with pytest.raises(ControlDenied) as refused, robot.control():
            pass
        assert getattr(refused.value.why, "code", None) == Code.SIGNATURE_MISSING
