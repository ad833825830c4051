"""`tsd-camera`: pictures on the bus, and poses of robots from printed tags."""

from __future__ import annotations

import argparse
import contextlib
import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsd_twin.bus import DEFAULT_ENDPOINT, Bus, as_client, client_config
from tsd_twin.cli import flags, program
from tsd_twin.errors import TwinError
from tsd_twin.lie import SE2
from tsd_twin.messages.pictures import CameraName
from tsd_twin.messages.topics import checked

with program.requires("tsd-camera", "camera"):
    import cv2

    from tsd_twin.camera import guide
    from tsd_twin.camera.board import PAPERS_MM, Board, board_pdf, tags_pdf
    from tsd_twin.camera.bodies import height_m
    from tsd_twin.camera.lens import CameraPlace, Lens, View
    from tsd_twin.camera.publisher import CameraPublisher
    from tsd_twin.camera.render import Sensor, SimulatedCamera
    from tsd_twin.camera.setup_file import CameraSetup, read_setup
    from tsd_twin.camera.simulated import (
        SimulatedSource,
        described_solids,
        floor_tags,
        random_view,
    )
    from tsd_twin.camera.sources import Source, open_source
    from tsd_twin.camera.tags import Tag
    from tsd_twin.camera.tracker import Observation, TagTracker, refusal_counts


SIZE = 1280, 720
ABOVE_ROBOT_M = 0.02
"""Height of a simulated robot's tag above its highest part."""
TAG_M = 0.16
DEFAULT_ACROSS_DEG = 62.0
"""Field of view of a webcam that was not calibrated, for pictures only."""
_READ_TIMEOUT_S = 0.2
_CONNECT_S = 10.0
_REPORT_S = 10.0

PARSER = program.parser(
    "tsd-camera",
    "Publish the pictures of a camera, and the poses of robots that carry printed tags.",
    [
        "tsd-camera                                      pictures of the first webcam",
        "tsd-camera print --tag 3 --out tag.pdf          a tag for a robot, of true size",
        "tsd-camera print --out board.pdf                the board for `calibrate lens`",
        "tsd-camera calibrate lens --file ceiling.toml   hold the board before the camera",
        "tsd-camera calibrate floor --file ceiling.toml --floor-tag 100 --floor-tag 101 \\",
        "    --floor-tag 102 --distance 100-101=1.84 \\",
        "    --distance 101-102=0.96                     then look at tags on the floor",
        "tsd-camera --file ceiling.toml --tag 3=tsd@0.31     publish the pose of robot tsd",
        "tsd-camera --source rtsp://192.168.1.9/stream --name door   a network camera",
        "tsd-camera --source 0 --on tsd --name front     a camera on robot tsd",
        "tsd-camera --simulate --tag 3=tsd               a simulated one above simulated robots",
    ],
)


def serve(args: argparse.Namespace) -> None:
    """Publish frames until a signal."""
    cv2.setNumThreads(1)  # Windows are too small to share, and pictures must not load all cores.
    stop = program.stop_event(args)
    name = CameraName(checked(args.name), checked(args.on) if args.on else None)
    tags = [_tag(text, args.tag_size, math.nan if args.simulate else 0.0) for text in args.tag]
    real = None if args.simulate else _real(args, tags)
    with (
        _bus(args) as poses,
        _bus(args) as pictures,
        contextlib.ExitStack() as opened,
    ):
        source, setup = real or _simulated(poses, args, tags)
        opened.callback(source.close)
        tracker = TagTracker(setup) if setup.tags else None
        publisher = CameraPublisher(pictures, poses, name, setup)
        opened.callback(publisher.close)
        program.say_ready(f"tsd-camera {name.key}, {len(setup.tags)} tags")
        report_s = time.monotonic() + _REPORT_S
        seen: list[Observation] = []
        while not stop.is_set():
            frame = source.read(_READ_TIMEOUT_S)
            if frame is None:
                continue
            if tracker is not None:
                seen.append(tracker.observe(frame.gray, frame.stamp_ns * 1e-9))
            now_s = time.monotonic()
            publisher.publish(frame, seen[-1] if seen else None, now_s)
            if now_s >= report_s and args.verbose:
                counts = publisher.counts
                print(f"{counts.pictures} pictures, {counts.poses} poses, {refusal_counts(seen)}")
            if now_s >= report_s:
                report_s, seen = now_s + _REPORT_S, []


def _bus(args: argparse.Namespace) -> Bus:
    """Open a session as a client: sessions of peers, as dashboards are, would not see it."""
    if args.zenoh_config:
        config = program.renewed_file(args.zenoh_config)
    else:
        config = client_config(args.connect or [DEFAULT_ENDPOINT])
    return Bus(as_client(config, _CONNECT_S))


def _real(args: argparse.Namespace, tags: Sequence[Tag]) -> tuple[Source, CameraSetup]:
    """Open the camera of `--source`; without `--file` it only publishes pictures."""
    if args.file:
        setup = read_setup(args.file)
        setup = replace(setup, tags=(*setup.tags, *tags))
    elif tags:
        raise TwinError("--tag needs --file: tsd-camera calibrate writes it")
    else:
        setup = CameraSetup(Lens.ideal(*SIZE, DEFAULT_ACROSS_DEG))
    size = setup.lens.width, setup.lens.height
    return open_source(args.source, setup.delay_s, size), setup


def _simulated(
    bus: Bus, args: argparse.Namespace, tags: Sequence[Tag]
) -> tuple[Source, CameraSetup]:
    """Return a camera above simulated robots, with its true view or the one in `--file`."""
    camera, on_floor = simulated_camera(args)
    heights = {
        tag.robot: height_m(described_solids(bus, tag.robot)) + ABOVE_ROBOT_M
        for tag in tags
        if tag.robot is not None and math.isnan(tag.height_m)
    }
    tags = [replace(tag, height_m=heights.get(tag.robot or "", tag.height_m)) for tag in tags]
    sensor = camera.sensor
    if args.file:
        setup = read_setup(args.file)
    else:
        setup = CameraSetup(camera.view.lens, camera.view.place, tags=on_floor)
    setup = replace(setup, tags=(*setup.tags, *tags), exposure_s=sensor.exposure_s)
    return SimulatedSource(bus, camera, tags), setup


def simulated_camera(args: argparse.Namespace) -> tuple[SimulatedCamera, tuple[Tag, ...]]:
    """Return the camera of `--simulate` and its tags on the floor; seed 0 is ideal."""
    random = np.random.default_rng(args.seed)
    if args.seed:
        view = random_view(SIZE, args.across, args.height, random)
    else:
        view = View(Lens.ideal(*SIZE, args.across), CameraPlace.looking_down(args.height))
    tags = floor_tags(view, TAG_M, random)
    sensor = Sensor(exposure_s=1e-3 * args.exposure_ms, delay_s=1e-3 * args.delay_ms)
    return SimulatedCamera(view, tags, sensor, args.seed), tags


def _tag(text: str, size_m: float, height: float) -> Tag:
    """Parse NUMBER=ROBOT[@HEIGHT_M].

    Raises:
        TwinError: If it is something else.
    """
    try:
        number, _, place = text.partition("=")
        robot, _, above = place.partition("@")
        high = float(above) if above else height
        if not (math.isnan(high) or 0.0 <= high < math.inf):
            raise ValueError(above)
        return Tag(int(number), size_m, checked(robot), high)
    except ValueError as error:
        raise TwinError(f"--tag: '{text}' is not like 3=tsd@0.31: number, robot, height") from error


def calibrate_lens(args: argparse.Namespace) -> None:
    """Calibrate a lens from views of the board, and write the camera file."""
    board = Board(square_m=1e-3 * args.square_mm, marker_m=0.75e-3 * args.square_mm)
    if args.simulate:
        camera, _ = simulated_camera(args)
        guide.calibrate_lens_simulated(camera, board, args.file, args.seed)
        return
    guide.calibrate_lens(open_source(args.source), board, args.file, program.stop_event(args))


def calibrate_floor(args: argparse.Namespace) -> None:
    """Find the place of a camera from tags on the floor, and write it into the camera file."""
    origin, numbers = _origin(args.origin), args.floor_tag
    distances_m = dict(_distance(text, numbers) for text in args.distance)
    setup = read_setup(args.file)
    if args.simulate:
        camera, on_floor = simulated_camera(args)
        pictures = [camera.draw([]) for _ in range(guide.FLOOR_PICTURES)]
        numbers, origin, distances_m = guide.measured(on_floor, args.seed)
    else:
        source = open_source(args.source)
        pictures = guide.take_pictures(source, guide.FLOOR_PICTURES)
    tags = {number: Tag(number, args.tag_size) for number in numbers}
    guide.calibrate_floor(setup, pictures, tags, origin, distances_m, args.file)


def _distance(text: str, numbers: Sequence[int]) -> tuple[tuple[int, int], float]:
    """Parse NUMBER-NUMBER=M, or M for the two lowest of `numbers`.

    Raises:
        TwinError: If it is something else, or names a tag that does not lie on the floor.
    """
    try:
        between, _, metres = text.rpartition("=")
        pair = sorted(map(int, between.split("-"))) if between else sorted(set(numbers))[:2]
        distance_m = flags.POSITIVE(metres)
    except (ValueError, argparse.ArgumentTypeError) as error:
        raise TwinError(f"--distance: '{text}' is not like 100-101=1.84: tags, m") from error
    if len(set(pair)) != 2 or not set(pair) <= set(numbers):
        raise TwinError(f"--distance: '{text}' needs two tags given by --floor-tag")
    return (pair[0], pair[-1]), distance_m


def _origin(text: str) -> SE2:
    try:
        x, y, heading_deg = (float(number) for number in text.split(","))
    except ValueError as error:
        raise TwinError(f"--origin: '{text}' is not like 0,0,90: m, m, degrees") from error
    return SE2(np.array([x, y, math.radians(heading_deg)]))


def print_sheets(args: argparse.Namespace) -> None:
    """Write the board or tags as PDF."""
    if args.tag:
        made = tags_pdf([Tag(number, args.tag_size) for number in args.tag], args.paper)
    else:
        board = Board(square_m=1e-3 * args.square_mm, marker_m=0.75e-3 * args.square_mm)
        made = board_pdf(board, args.paper)
    try:
        Path(args.out).write_bytes(made)
    except OSError as error:
        raise TwinError(f"{args.out} cannot be written: {error}") from error
    print(f"{args.out}: print it at 100 %, and measure the ruler on it")


def _add_source_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--source",
        default="0",
        metavar="CAMERA",
        help="number or device of a webcam, rtsp:// or http:// address, video, or folder of "
        "pictures; default 0",
    )
    parser.add_argument("--simulate", action="store_true", help="simulate the camera")
    parser.add_argument(
        "--height", type=flags.POSITIVE, default=2.5, metavar="M", help="of the simulated camera"
    )
    parser.add_argument(
        "--across",
        type=flags.number(10.0, 130.0),
        default=94.0,
        metavar="DEGREES",
        help="field of view of the simulated camera; default 94",
    )
    parser.add_argument(
        "--seed",
        type=flags.SEED,
        default=0,
        help="of the simulated lens, its place and noise; default 0, an ideal lens",
    )
    parser.add_argument("--exposure-ms", type=flags.POSITIVE, default=8.0, help="simulated")
    parser.add_argument("--delay-ms", type=flags.POSITIVE, default=50.0, help="simulated")
    parser.add_argument(
        "--tag-size",
        type=flags.POSITIVE,
        default=TAG_M,
        metavar="M",
        help=f"side of the black squares of tags; default {TAG_M:g}",
    )


def _add_sheet_flags(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--square-mm",
        type=flags.POSITIVE,
        default=1e3 * Board().square_m,
        metavar="MM",
        help="side of the board's squares; default 36",
    )


def _add_commands(parser: argparse.ArgumentParser) -> None:
    commands = parser.add_subparsers(metavar="calibrate | print")
    calibrate = commands.add_parser("calibrate", help="find out lens and place of a camera")
    steps = calibrate.add_subparsers(metavar="lens | floor", required=True)
    file: Sequence[str] = ("--file",)
    lens = steps.add_parser("lens", help="from a printed board that you hold before the camera")
    lens.add_argument(*file, required=True, metavar="FILE.toml", help="camera file to write")
    _add_source_flags(lens)
    _add_sheet_flags(lens)
    lens.set_defaults(body=calibrate_lens)
    floor = steps.add_parser("floor", help="from three or more tags on the floor")
    floor.add_argument(*file, required=True, metavar="FILE.toml", help="with the lens; completed")
    floor.add_argument(
        "--floor-tag", type=flags.whole(0), action="append", default=[], metavar="NUMBER"
    )
    floor.add_argument(
        "--distance",
        action="append",
        default=[],
        metavar="TAG-TAG=M",
        help="between the centres of two tags, measured; may be repeated, each one makes the "
        "scale more accurate; M alone is between the two lowest numbers",
    )
    floor.add_argument(
        "--origin",
        default="0,0,0",
        metavar="X,Y,DEGREES",
        help="of the first tag, with X toward the second one; default 0,0,0",
    )
    _add_source_flags(floor)
    floor.set_defaults(body=calibrate_floor)
    sheets = commands.add_parser("print", help="write the board, or tags, as PDF of true size")
    sheets.add_argument("--tag", type=flags.whole(0), action="append", default=[], metavar="NUMBER")
    sheets.add_argument("--tag-size", type=flags.POSITIVE, default=TAG_M, metavar="M")
    sheets.add_argument("--paper", choices=list(PAPERS_MM), default="a4")
    sheets.add_argument("--out", required=True, metavar="FILE.pdf")
    _add_sheet_flags(sheets)
    sheets.set_defaults(body=print_sheets)


def main() -> None:
    """Parse the flags and run."""
    program.add_client_flags(PARSER)
    _add_source_flags(PARSER)
    PARSER.add_argument("--name", default="ceiling", help="of the camera; default ceiling")
    PARSER.add_argument("--on", metavar="ROBOT", help="robot that carries it; default: the floor")
    PARSER.add_argument("--file", metavar="FILE.toml", help="camera file of `calibrate`")
    PARSER.add_argument(
        "--tag",
        action="append",
        default=[],
        metavar="NUMBER=ROBOT[@HEIGHT]",
        help="tag on a robot, and its height above the floor in m; may be repeated",
    )
    PARSER.set_defaults(body=serve)
    _add_commands(PARSER)
    program.run(PARSER, lambda args: args.body(args))


if __name__ == "__main__":
    main()
