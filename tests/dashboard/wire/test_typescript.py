"""The generated TypeScript matches the server's messages, codes, sentences and texts."""

from __future__ import annotations

import re
from typing import get_args

import msgspec
import pytest

from tests.support.page_stage import robot
from tsd_twin.dashboard.wire import to_page
from tsd_twin.dashboard.wire.from_page import Message, PageMessage, RecordedPageMessage
from tsd_twin.dashboard.wire.to_page import encode_message
from tsd_twin.dashboard.wire.typescript import FOLDER, generated, wire_module, wire_structs
from tsd_twin.messages.codes import PARAMETERS

pytestmark = pytest.mark.computes
INTERFACES: dict[str, str] = dict(
    re.findall(r"^export interface (\w+) \{\n(.*?)^\}", wire_module(), re.MULTILINE | re.DOTALL)
)
UNIONS = dict(re.findall(r"^export type (\w+) =\n((?:  \| \w+\n?)+);", wire_module(), re.MULTILINE))


def members(union: str) -> set[str]:
    return set(re.findall(r"\w+", UNIONS[union]))


def properties(name: str) -> dict[str, bool]:
    """Property names of an interface, and whether they are optional."""
    found = re.findall(r"^  (\w+)(\??):", INTERFACES[name], re.MULTILINE)
    return {each: mark == "?" for each, mark in found}


@pytest.mark.parametrize("name", ["wire.ts", "codes.ts", "sentences.ts", "texts.ts"])
def test_committed_files_are_those_that_the_generator_writes(name: str) -> None:
    text = (FOLDER / name).read_text(encoding="utf-8")
    assert text == generated()[name], "run python -m tsd_twin.dashboard.wire.typescript"


def test_a_message_has_exactly_the_properties_that_its_json_has() -> None:
    info = msgspec.convert(robot("tsd"), to_page.RobotInfo, strict=False)
    assert properties("RobotInfo") == dict.fromkeys(
        msgspec.json.decode(encode_message(info)), False
    )


def test_a_page_may_leave_out_the_fields_that_have_a_default() -> None:
    assert properties("DriveCommand") == {
        **dict.fromkeys(("t", "vx", "vy", "omega", "status_seq"), False),
        **dict.fromkeys(("number", "selection", "frame"), True),
    }
    assert properties("Reason") == {"code": False, "params": True, "cause": True}


def test_every_message_is_in_the_union_of_its_direction() -> None:
    live, recorded = get_args(PageMessage), get_args(RecordedPageMessage)
    assert members("PageMessage") == {each.__name__ for each in live}
    assert members("RecordedPageMessage") == {each.__name__ for each in recorded}
    tagged = {name for name, body in INTERFACES.items() if re.match(r"  t: ", body)}
    received = members("ServerMessage") | members("RecordedServerMessage") - {"ServerMessage"}
    assert tagged == received | members("PageMessage") | members("RecordedPageMessage")
    assert not received & (members("PageMessage") | members("RecordedPageMessage"))
    assert {"RobotState", "Timeline"} <= received


def test_tags_are_unique_in_each_direction() -> None:
    for union in ("ServerMessage", "PageMessage", "RecordedPageMessage"):
        tags = [re.findall(r't: "(\w+)"', INTERFACES[name])[0] for name in members(union)]
        assert len(set(tags)) == len(tags)


def test_every_type_that_is_named_is_declared() -> None:
    text = re.sub(r'/\*\*.*?\*/|//[^\n]*|"[^"\n]*"', "", wire_module(), flags=re.DOTALL)
    named = set(re.findall(r"\b[A-Z]\w*[a-z]\w*\b", text))
    declared = set(re.findall(r"^export (?:type|interface) (\w+)", text, re.MULTILINE))
    assert named - declared == {"Record"}


def test_comments_have_docstrings_of_fields_and_their_limits() -> None:
    body = INTERFACES["StudentRequest"]
    assert "  /** Returned in the reply. At least 0, at most 9 007 199 254 740 992. */\n" in body
    assert "  /** At most 32 characters. */\n  base: string;\n" in body


def test_the_base_class_of_messages_is_not_a_message() -> None:
    assert Message.__name__ not in INTERFACES


def test_codes_and_sentences_are_those_of_the_robot() -> None:
    codes, sentences = generated()["codes.ts"], generated()["sentences.ts"]
    table = codes.split("export const PARAMETERS = {\n")[1].split("\n} satisfies")[0]
    assert re.findall(r"^  (\w+): ", table, re.MULTILINE) == [str(code) for code in PARAMETERS]
    templates = sentences.split("const templates = {\n")[1].split("\n} satisfies")[0]
    assert set(re.findall(r"^  (\w+): ", templates, re.MULTILINE)) == set(map(str, PARAMETERS))
    assert "  stop_requested: { by?: string };\n" in codes
    assert '  stop_requested: { by: "operator", cause: "cause" },\n' in codes


PAGE = "\n".join(
    re.sub(r"/\*.*?\*/|(?<!:)//[^\n]*", "", path.read_text("utf-8"), flags=re.DOTALL)
    for path in sorted(FOLDER.parent.rglob("*.ts*"))
    if FOLDER not in path.parents
)


def is_read(name: str) -> bool:
    """Return whether the page names a property: by a dot, in a pattern, or as a key."""
    return re.search(rf'\.{name}\b|[{{,]\s*{name}\s*[,}}:=]|"{name}"', PAGE) is not None


def test_the_page_reads_every_field_that_the_server_sends() -> None:
    """Exempt are numbers in a state that only the plots read, and messages of the bus."""
    plotted = {"truth", "mode_age_s", "estimate_difference", "degrees"}
    sent = {
        f"{struct.__name__}.{field}"
        for struct in wire_structs()
        if struct not in {*get_args(PageMessage), *get_args(RecordedPageMessage)}
        for field in struct.__struct_fields__
        if field not in plotted and not is_read(field)
    }
    assert sent == set()
    assert not is_read("alpha_setpoint")
