"""Mistakes on the command line end each program with one sentence and no traceback."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.mistaken_programs import start_each

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

FLAGS: dict[str, str] = {
    "tsd_dashboard": """
        --port 99999
        --port -1
        --port http
        --prot 8080
        --allow-host bad/name
        --allow-host https://robot.example
        --verbos extra
    """,
    "tsd_mock": """
        --seed -1
        --seed 1.5
        --noise -1
        --noise nan
        --noise inf
        --noise much
        --errors -0.5
        --plant bullet
        --robott tsd
    """,
    "tsd_bridge": """
        --port /dev/ttyACM0 --baud 0
        --port /dev/ttyACM0 --baud -57600
        --port /dev/ttyACM0 --baud fast
    """,
    "tsd_demo": """
        --port 99999
        --port -8080
        --bus-port 65536
        --noise -1
        --errors nan
        --plant none
        --keep-gb 0
    """,
    "tsd_camera": """
        --height 0
        --across 180
        --exposure-ms nan
        --tag-size -0.16
        calibrate
        calibrate lens
        calibrate floor --file camera.toml --floor-tag -1
        print --tag 3
        print --out tag.pdf --paper a9
    """,
    "tsd_certs": """
        --days 30
        keys --days 0
        keys --days -1
        keys --days 99999999
        keys --enrol-port 65536
    """,
    "tsd_users": """
        --operator alice
        users.toml --operator alice --viewer bob
    """,
    "tsd_router": """
        --zenoh-config keys/router.json5
    """,
    "tsd_link": """
        --target tcp/127.0.0.1:7447
    """,
    "tsd_lab": """
        sqare
        square --seeds 0
        square --seed -1
        square --noise -1
        square --errors -1
        square --loop closed
        square --plant bullet
        square --believed-friction 0
        follow --share 0
        follow --share 1.5
        follow --speed 0
        follow --speed -1
        follow --cut -0.1
        follow --path triangle
        omni-step --speed 0
        omni-step --acceleration -1
        omni-step --noise -1
        omni-paths --seed -1
        atlas --row-distance-mm -1
        calibrate --room 0
        calibrate --speed -1
        calibrate --seed -1
        calibrate --errors -1
        zero --seconds 0
        zero --seconds 1e9
        rerun x.mcap --tolerance -1
        rerun
    """,
    "tsd_record": """
        --keep-gb 0
        --keep-gb much
        export x.mcap --from -1 --csv tables
        export x.mcap --to 0 --csv tables
        export
        mark x.mcap
        mark x.mcap note --at -1
    """,
    "tsd_replay": """
        x.mcap --speed 0
        x.mcap --speed -1
        x.mcap --speed inf
    """,
    "tsd_foxglove": """
        --port 65536
        --port -1
        --allow-host a/b
    """,
    "tsd_ros": """
        --domain -1
        --domain 233
        --mesh-port 65536
        --rmw cyclone
    """,
}
"""Invalid flags; exit code 2."""

OTHERS: dict[str, str] = {
    "tsd_dashboard": """
        --host no-such-host.invalid
        --host 192.0.2.1
        --port BUSY
        --connect nonsense
        --connect tcp/127.0.0.1
        --connect tcp/127.0.0.1:99999
        --zenoh-config nowhere.json5
        --zenoh-config folder
        --zenoh-config binary
        --zenoh-config text
        --users nowhere.toml
        --users folder
        --users binary
        --users text
        --tls-cert text
        --tls-cert text --tls-key nowhere
        --tls-cert folder --tls-key folder
        --users nowhere.toml --behind-proxy nonsense
    """,
    "tsd_mock": """
        --robot nobody
        --robot nowhere.toml
        --robot ./folder
        --robot ./binary
        --robot ./text
        --robot ./empty
        --id My_Robot
        --id a/b
        --at 1,2
        --at here
        --at 1,2,nan
        --robot atlas --at 0,0,0
        --robot atlas --camera
        --robot kiwi --plant mujoco
        --jam nothing
        --jam module1_alpha@far
        --jam module1_alpha@nan
        --robot kiwi --jam module1_alpha
        --listen nonsense
        --listen tcp/127.0.0.1
        --listen tcp/127.0.0.1:99999
        --listen tcp/0.0.0.0:7447
        --listen tcp/127.0.0.1:BUSY
        --listen carrier-pigeon/127.0.0.1:7447
        --listen tcp/127.0.0.1:0 --connect nonsense
        --zenoh-config nowhere.json5
        --zenoh-config folder
        --zenoh-config binary
        --code 7K3M-9Q2X-HT4W-0B8N
        --join https://127.0.0.1:1 --keys new
        --join https://127.0.0.1:1 --keys new --code 7K3M
        --join https://127.0.0.1:1 --keys text --code 7K3M-9Q2X-HT4W-0B8N
        --join https://no-such-host.invalid --keys new --code 7K3M-9Q2X-HT4W-0B8N
        --join lab.example --keys new --code 7K3M-9Q2X-HT4W-0B8N
        --join https://127.0.0.1:1 --count 2
    """,
    "tsd_bridge": """

        --port /dev/nowhere
        --port ./folder
        --port ./text
        --port foo://bar
        --port socket://127.0.0.1:BUSY
        --port socket://nonsense
        --port /dev/nowhere --robot kiwi
        --port /dev/nowhere --robot nobody
        --port /dev/nowhere --calibration nowhere.toml
        --port /dev/nowhere --calibration folder
        --port /dev/nowhere --calibration binary
        --port /dev/nowhere --calibration text
        --port /dev/nowhere --servos /dev/nowhere
        --port /dev/nowhere --setup
        --port /dev/nowhere --setup --calibration new.toml
    """,
    "tsd_demo": """
        --port BUSY
        --bus-port BUSY
        --robot nobody
        --robot ./folder
        --robot tsd --robot kiwi --id left
        --link fast
        --link delay=150
        --link loss=200%
        --id My_Robot
        --robot kiwi --plant mujoco
        --robot atlas --camera --id My/Robot
        --record-dir text
        --record-dir /dev/null/below
    """,
    "tsd_certs": """
        text
        new
        /proc/keys --robot-host robot.local --operator alice
        new --robot-host robot.local --operator Alice!
        new --robot-host robot.local --operator robot
        new --robot-host a/b --operator alice
        new --robot-host robot.local --operator alice --listen nonsense
        new --robot-host robot.local --operator alice --robots lab1
        new --router-host lab.example --robot lab1 --operator alice
        new --router-host lab.example --robot lab1 --operator alice --robots lab2
        new --router-host lab.example --robot lab1 --operator alice --robots lab1,,
        new --router-host lab.example --robot router
        new --robot lab1
        new --robot-host robot.local --operator alice --enrol lab1
        new --router-host lab.example --robot lab1 --enrol lab2 --enrol-port 0
        new --router-host lab.example --robot lab1 --enrol lab1 --enrol-port BUSY
    """,
    "tsd_users": """
        folder
        binary
        text
        nowhere.toml
        new.toml --remove alice
        new.toml --operator Alice!
        new.toml --operator alice
        new.toml --operator alice --may-stop
        /proc/users.toml --operator alice
    """,
    "tsd_link": """
        --link fast
        --link delay=150
        --link delay=-1s
        --link loss=5%,loss=6%
        --link delay=1ms --target nonsense
        --link delay=1ms --target tcp/127.0.0.1:99999
        --link delay=1ms --target tls/robot:7447
        --link delay=1ms --listen tcp/127.0.0.1:BUSY
        --link delay=1ms --listen tcp/192.0.2.1:7448
    """,
    "tsd_lab": """
        motors --robot nobody
        motors --robot kiwi
        motors --robot ./folder
        motors --out text
        square --robot atlas
        square --robot kiwi --plant mujoco
        follow --points 0,0
        follow --points 0,0 nan,1
        follow --points 0,0 0,0
        follow --points 0,0 1e300,0
        follow --robot atlas
        omni-step --robot tsd
        omni-paths --robot atlas
        atlas --robot tsd
        atlas --row-distance-mm 1000
        calibrate --robot kiwi
        calibrate --log nowhere.csv
        calibrate --log folder
        calibrate --log binary
        calibrate --log empty
        calibrate --drive --connect nonsense
        zero --connect tcp/127.0.0.1:BUSY
        zero --zenoh-config nowhere.json5
        rerun nowhere.mcap
        rerun folder
        rerun text
        rerun empty
    """,
    "tsd_camera": """
        --tag 3=tsd
        --tag 3=tsd --file nowhere.toml
        --tag 3=tsd --file text
        --simulate --tag tsd
        --simulate --tag 3=tsd@high
        --on a/b
        --source nowhere.mp4
        --zenoh-config nowhere.json5
        calibrate lens --file new.toml --source nowhere.mp4
        calibrate floor --file nowhere.toml
        calibrate floor --file text
        calibrate floor --file new.toml --origin here
        calibrate floor --file new.toml --floor-tag 100 --floor-tag 101 --distance 0
        calibrate floor --file new.toml --floor-tag 100 --distance 1.84
        calibrate floor --file new.toml --floor-tag 100 --floor-tag 101 --distance 100-100=1
        calibrate floor --file new.toml --floor-tag 100 --floor-tag 101 --distance 100-102=1
        calibrate floor --file new.toml --floor-tag 100 --floor-tag 101 --distance 100-101
        print --tag 3 --out folder
    """,
    "tsd_record": """
        --dir text
        --dir /dev/null/below
        --dir new --connect nonsense
        --dir new --zenoh-config nowhere.json5
        --dir new --zenoh-config binary
        export nowhere.mcap --csv tables
        export folder --csv tables
        export binary --csv tables
        export empty --out part.mcap
        export text
        export nowhere.mcap --html page.html
        export binary --html page.html
        export empty --picture drive.gif
        mark nowhere.mcap note
        mark empty note --at 1
        --dir nowhere list
    """,
    "tsd_replay": """
        nowhere.mcap
        folder
        binary
        empty
    """,
    "tsd_foxglove": """
        --port BUSY
        --host 0.0.0.0 --port 0
        --port 0 --token-file folder
        --port 0 --token-file text
        --port 0 --connect nonsense
        --port 0 --zenoh-config nowhere.json5
        --port 0 --operator A
        --port 0 --robot a/b
        --port 0 --recording nowhere.mcap
        --port 0 --recording binary
        --port 0 --tls-cert text
    """,
    "tsd_ros": """
        --ros-connect nonsense
        --ros-connect tcp/127.0.0.1:1
        --ros-zenoh-config nowhere.json5
        --zenoh-config nowhere.json5
        --operator A
        --robot a/b
    """,
}
"""Valid flags with unsuitable files, devices, hosts or names."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder with files of wrong kinds."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    (tmp_path / "text").write_text("This is a letter, {and no file of ours.\n", encoding="utf-8")
    (tmp_path / "empty").write_text("", encoding="utf-8")
    for file in tmp_path.iterdir():
        file.chmod(0o700)
    return tmp_path


@pytest.fixture
def busy_port() -> Iterator[int]:
    """A port on which another program accepts connections and stays silent."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def lines(text: str) -> list[list[str]]:
    return [line.split() for line in text.removeprefix("\n").rstrip().split("\n")]


@pytest.mark.parametrize("module", FLAGS)
def test_a_flag_that_cannot_be_is_one_sentence_and_exit_code_2(module: str, folder: Path) -> None:
    mistakes = lines(FLAGS[module])
    ended = start_each(module, mistakes, folder)
    told = [
        each.code == 2 and each.said.startswith(name(module)) and each.said.count("\n") == 1
        for each in ended
    ]
    assert len(told) == len(mistakes)
    assert all(told), [each for each, good in zip(ended, told, strict=True) if not good]


@pytest.mark.parametrize("module", OTHERS)
def test_what_does_not_fit_is_one_sentence(module: str, folder: Path, busy_port: int) -> None:
    """The demo adds a sentence to the error of the program it starts."""
    mistakes = lines(OTHERS[module].replace("BUSY", str(busy_port)))
    ended = start_each(module, mistakes, folder)
    names = (name(module), "tsd-mock") if module == "tsd_demo" else (name(module),)
    told = [
        each.code in (1, 2)
        and all(line.startswith(names) for line in each.said.splitlines())
        and 1 <= each.said.count("\n") <= len(names)
        for each in ended
    ]
    assert len(told) == len(mistakes)
    assert all(told), [
        (*flags, each) for flags, each, good in zip(mistakes, ended, told, strict=True) if not good
    ]


def name(module: str) -> str:
    return module.replace("_", "-")


def test_the_message_names_the_flag_the_value_and_the_range(folder: Path) -> None:
    (port,) = start_each("tsd_dashboard", [["--port", "99999"]], folder)
    assert port.said == (
        "tsd-dashboard: --port: '99999' is not a whole number from 0 to 65535; "
        "see tsd-dashboard --help\n"
    )
    (misspelt,) = start_each("tsd_dashboard", [["--prot", "80"]], folder)
    assert misspelt.said == (
        "tsd-dashboard: unrecognized arguments: --prot 80, did you mean --port?\n"
    )
