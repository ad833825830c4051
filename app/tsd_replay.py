"""`tsd-replay`: a recording as a source on the bus, for dashboards and other tools."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path

from tsd_twin.bus import Bus, as_client, client_config, node_config
from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError

with program.requires("tsd-replay", "record"):
    from tsd_twin.recording import Recording, Replay, open_recording, play


SUFFIX = "-replay"
LONGEST_ID = 32
START_TIMEOUT_S = 3.0

PARSER = program.parser(
    "tsd-replay",
    "Put a recording on the bus, under an id of its own. It shows what was; nothing can drive it.",
    [
        "tsd-replay run.mcap                                 then open tsd-dashboard",
        "tsd-replay run.mcap --speed 4 --loop                four times as fast, again and again",
        "tsd-replay run.mcap --robot tsd --id yesterday      one of several robots, another id",
        "tsd-replay run.mcap --connect tcp/127.0.0.1:7447    beside a robot that is running",
    ],
)


def replay(args: argparse.Namespace) -> None:
    """Send the recording until its end or a signal."""
    stop = program.stop_event(args)
    recording = open_recording(args.file)
    robot = chosen_robot(recording, args.robot)
    replay_id = args.id or f"{robot[: LONGEST_ID - len(SUFFIX)]}{SUFFIX}"
    with session(args) as bus:
        source = Replay(bus, recording, robot, replay_id)
        with contextlib.closing(source):
            where = args.connect or " ".join(bus.endpoints())
            program.say_ready(f"tsd-replay {replay_id} on {where}")
            play(source, stop, args.speed, loop=args.loop)


def session(args: argparse.Namespace) -> Bus:
    """Open a bus, or join the bus of a running robot."""
    if args.connect:
        # A client sees a robot's peers, and they see the client.
        return Bus(as_client(client_config([args.connect]), START_TIMEOUT_S))
    return Bus(node_config([args.listen]))


def chosen_robot(recording: Recording, chosen: str | None) -> str:
    """Return the robot to replay."""
    if chosen is not None:
        return chosen
    if len(recording.robots) != 1:
        known = ", ".join(recording.robots) or "no robot"
        raise TwinError(f"{recording.path} has {known}: choose one with --robot")
    return recording.robots[0]


def main() -> None:
    """Parse the flags and run."""
    PARSER.add_argument("file", metavar="FILE", type=Path, help="a recording of tsd-record")
    PARSER.add_argument("--robot", metavar="ID", help="robot in the recording, when it has several")
    PARSER.add_argument("--id", help=f"id on the bus; default: that of the robot and {SUFFIX}")
    flags.add(PARSER, "--speed", "1 is as it was", flags.POSITIVE, 1.0, "FACTOR")
    PARSER.add_argument("--loop", action="store_true", help="begin again at the end")
    program.add_listen_flag(PARSER)
    text = "join the bus of a robot there, and listen nowhere"
    flags.add(PARSER, "--connect", text, metavar="ENDPOINT")
    program.run(PARSER, replay)


if __name__ == "__main__":
    main()
