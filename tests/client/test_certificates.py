"""The client over TLS, with the certificates from `tsd-certs`."""

from __future__ import annotations

import json
from collections.abc import Generator
from pathlib import Path

import pytest

import tsd_twin
from tests.support.link_sockets import free_port
from tests.support.programs import Program
from tsd_twin.errors import TwinError

pytestmark = pytest.mark.system


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Generator[Path]:
    """Keys for a running robot on this machine, an operator and a viewer."""
    folder = tmp_path_factory.mktemp("certificates") / "keys"
    people = ("--operator", "alice", "--viewer", "guest")
    where = ("--robot-host", "127.0.0.1", "--listen", f"tls/127.0.0.1:{free_port()}")
    certs = Program(["tsd_certs", str(folder), *people, *where])
    mock = None
    try:
        assert certs.wait() == 0
        mock = Program(["tsd_mock", "--zenoh-config", str(folder / "robot.json5")])
        mock.ready()
        yield folder
    finally:
        certs.clean_up()
        if mock is not None:
            mock.end()
            mock.clean_up()


def endpoint_of(keys: Path) -> str:
    lines = (keys / "robot.json5").read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.lstrip().startswith("//"))
    return json.loads(text)["listen"]["endpoints"][0]


def test_an_operator_drives_under_the_name_of_the_certificate(keys: Path) -> None:
    with tsd_twin.connect(endpoint_of(keys), certificate=keys / "alice.pem") as robot:
        with robot.control() as base:
            assert robot.state.lease.holder == "alice"
            base.drive(vx_mps=0.3, duration_s=0.5)
        assert robot.state.odom.pose.x_m > 0.05


def test_the_configuration_of_a_viewer_reads_and_takes_no_control(keys: Path) -> None:
    with tsd_twin.connect(zenoh_config=keys / "guest.json5") as robot:
        assert robot.state.status.loop.hz > 0.0
        with pytest.raises(tsd_twin.ClientError, match="does not answer"):
            robot.control().acquire()


def test_without_a_certificate_no_robot_is_found(keys: Path) -> None:
    with pytest.raises(tsd_twin.NoRobotFound):
        tsd_twin.connect(endpoint_of(keys))


def test_a_certificate_without_its_key_is_named(keys: Path, tmp_path: Path) -> None:
    lonely = tmp_path / "alice.pem"
    lonely.write_bytes((keys / "alice.pem").read_bytes())
    with pytest.raises(TwinError, match=r"ca\.pem, which is not there"):
        tsd_twin.connect(endpoint_of(keys), certificate=lonely)
