"""Adapters to ROS 2 and Foxglove: what connects where, and what stops the robot."""

from __future__ import annotations

from svg import AMBER, BLUE, GREEN, GREY, INK, ORANGE, Point, Sheet


def draw() -> str:
    """Return the drawing."""
    sheet = Sheet(980, 450, "ROS 2 and Foxglove on the bus")
    _programs(sheet)
    _adapters(sheet)
    _bus(sheet)
    return sheet.svg()


def _names(words: str) -> str:
    """Return ROS names whose `_` does not start a subscript."""
    return words.replace("_", "_\u200b")


def _box(sheet: Sheet, corner: Point, size: Point, words: str, colour: str = INK) -> None:
    title, _, rest = _names(words).partition("\n")
    sheet.box(corner, size, colour=colour, fill="#f5f7fa")
    sheet.text((corner[0] + size[0] / 2, corner[1] + 24), title, size=14, style="b", halo=False)
    if rest:
        sheet.text((corner[0] + size[0] / 2, corner[1] + 44), rest, size=11, halo=False)


def _flow(sheet: Sheet, points: list[Point], words: str, at: Point, colour: str = INK) -> None:
    sheet.line(points, colour=colour, width=2, arrow=True)
    sheet.text(at, _names(words), size=11, colour=colour)


def _programs(sheet: Sheet) -> None:
    _box(
        sheet,
        (20, 40),
        (190, 84),
        "Foxglove\nor another client with\nits WebSocket protocol",
        ORANGE,
    )
    _box(
        sheet,
        (20, 180),
        (190, 84),
        "ROS 2 nodes\nrviz, nav2, teleop,\nros2 topic and service",
        BLUE,
    )
    _box(
        sheet,
        (20, 320),
        (190, 84),
        "third-party robot\nfollows cmd_vel,\nhas odom and a URDF",
        GREY,
    )
    _flow(sheet, [(410, 66), (210, 66)], "topics, URDF, meshes", (310, 58), ORANGE)
    _flow(sheet, [(210, 92), (410, 92)], "cmd_vel, services", (310, 108), ORANGE)
    sheet.text((310, 126), "port 8765 on loopback;\nelse TLS and a token", size=10, colour=GREY)
    _flow(sheet, [(410, 206), (210, 206)], "/tf, odom, joint_states ...", (310, 198), BLUE)
    _flow(sheet, [(210, 232), (410, 232)], "cmd_vel, arm, stop ...", (310, 248), BLUE)
    sheet.text((310, 266), _names("rmw_zenoh at 7447, or DDS"), size=10, colour=GREY)
    _flow(sheet, [(210, 346), (410, 346)], "odom, joint_states, URDF", (310, 338), GREY)
    _flow(sheet, [(410, 372), (210, 372)], "cmd_vel, then zeros", (310, 388), GREY)


def _adapters(sheet: Sheet) -> None:
    driver = "a regular operator:\n0.2 s of silence stops"
    _box(sheet, (410, 40), (190, 84), f"tsd-foxglove\n{driver}", ORANGE)
    _box(sheet, (410, 180), (190, 84), f"tsd-ros\n{driver}", BLUE)
    _box(
        sheet,
        (410, 320),
        (190, 84),
        "tsd-ros --import\na robot node here: lease,\narming, limits, timeouts",
        GREY,
    )


def _bus(sheet: Sheet) -> None:
    sheet.box((690, 30), (44, 390), colour=AMBER, fill="#fff7e6")
    sheet.text((712, 22), "Zenoh", size=14, colour=AMBER, style="b")
    for y, colour in ((66, ORANGE), (206, BLUE)):
        _flow(sheet, [(690, y), (600, y)], "state, desc", (645, y - 8), colour)
        _flow(sheet, [(600, y + 26), (690, y + 26)], "lease, twist", (645, y + 42), colour)
    _flow(sheet, [(600, 346), (690, 346)], "state, desc", (645, 338), GREY)
    _flow(sheet, [(690, 372), (600, 372)], "lease, twist", (645, 388), GREY)
    node = "robot node\ncommand gate, limits,\nautomatic stops"
    _box(sheet, (800, 80), (160, 84), node, GREEN)
    _flow(sheet, [(734, 110), (800, 110)], "", (0, 0), GREEN)
    _flow(sheet, [(800, 136), (734, 136)], "", (0, 0), GREEN)
    _box(
        sheet,
        (800, 250),
        (160, 84),
        "dashboard, scripts\na person may take over\nat any time",
        GREEN,
    )
    _flow(sheet, [(734, 280), (800, 280)], "", (0, 0), GREEN)
    _flow(sheet, [(800, 306), (734, 306)], "", (0, 0), GREEN)
