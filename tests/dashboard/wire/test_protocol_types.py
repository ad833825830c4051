"""The types that the page's scripts are checked with, against the messages of the server."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from tests.support.page_stage import robot
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.dashboard.wire import fleet, from_page, student, to_page
from tsd_twin.dashboard.wire.from_page import Message
from tsd_twin.dashboard.wire.view import Layer
from tsd_twin.messages import status
from tsd_twin.robots import load_robot, robot_names

SERVER = Path(to_page.__file__).parent
TYPES = (SERVER / "protocol.d.ts").read_text(encoding="utf-8")
STATIC = SERVER.parent / "static"
DECLARED = {
    name: set(re.findall(r"^  (\w+)\??:", body, re.MULTILINE))
    for name, body in re.findall(r"^interface (\w+) \{\n(.*?)^\}", TYPES, re.MULTILINE | re.DOTALL)
}
STRUCTS = {
    name: struct
    for module in (fleet, from_page, student, to_page, status)
    for name, struct in vars(module).items()
    if isinstance(struct, type) and issubclass(struct, msgspec.Struct)
}
FROM_PAGE = {
    *get_args(from_page.PageMessage),
    *get_args(from_page.RecordedPageMessage),
}
FROM_SERVER = {
    struct
    for struct in STRUCTS.values()
    if issubclass(struct, Message) and struct not in FROM_PAGE | {Message}
}


def fields(struct: type[msgspec.Struct]) -> set[str]:
    return {field.encode_name for field in msgspec.structs.fields(struct)}


@pytest.mark.parametrize("name", sorted(DECLARED.keys() & STRUCTS.keys()))
def test_a_declared_message_has_the_fields_that_are_sent(name: str) -> None:
    declared, sent = DECLARED[name] - {"t"}, fields(STRUCTS[name])
    if STRUCTS[name] in FROM_PAGE:
        assert declared <= sent
        assert sent - declared <= {"status_seq", "level"}  # Added where the page sends it.
    else:
        assert declared == sent


@pytest.mark.parametrize("struct", sorted(FROM_SERVER, key=lambda each: each.__name__))
def test_every_message_of_the_server_is_declared_with_its_tag(struct: type[msgspec.Struct]) -> None:
    body = TYPES.split(f"interface {struct.__name__} {{\n")[1].split("\n}")[0]
    assert f'  t: "{struct.__struct_config__.tag}";' in body
    union = TYPES.split("type ServerMessage =")[1].split(";")[0]
    assert f"| {struct.__name__}\n" in f"{union}\n"


def test_the_page_knows_every_message_that_it_may_send_by_its_tag() -> None:
    tags = {str(struct.__struct_config__.tag) for struct in FROM_PAGE}
    said = TYPES.split("// From the page.")[1].split("// Within the page.")[0]
    said += TYPES.split("type TimelineRequest =")[1].split("\n\n")[0]
    quoted = set(re.findall(r'"(\w+)"', "".join(re.findall(r"\bt: ([^;}]*)[;}]", said))))
    assert quoted == tags


def test_the_robot_of_tests_in_a_browser_has_the_fields_that_are_sent() -> None:
    assert robot("tsd").keys() - {"t"} == fields(to_page.RobotInfo)


def test_the_presets_know_every_layer_and_every_tab_of_actuators() -> None:
    text = (STATIC / "view_settings.js").read_text(encoding="utf-8")
    layers = text.split("export const LAYERS = [")[1].split("\n];")[0]
    assert set(re.findall(r'"([^"]+)"', layers)) == {str(layer) for layer in Layer}
    presets = (STATIC / "presets.js").read_text(encoding="utf-8")
    (away,) = re.findall(r"Operator: \{\s+away: \[(.*?)\]", presets, re.DOTALL)
    # The tab with what is not promised for robots of others stays.
    actuators = {view_of(load_robot(name)).label for name in robot_names()} | {"Joints"}
    assert actuators <= set(re.findall(r'"([^"]+)"', away))
    shown = set(re.findall(r'"([^"]+)"', "".join(re.findall(r"layers: \[(.*?)\]", presets))))
    assert shown <= {str(layer) for layer in Layer}
