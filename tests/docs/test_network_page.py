"""The network page against the access rules in use."""

from __future__ import annotations

import re

import pytest
import zenoh

from tests.support.markdown_pages import code, page, quoted, section, tables
from tsd_twin.security import LISTEN, Role, access_control, client

PAGE = page("network.md")
MESSAGES = {
    "reads": "declare_subscriber",
    "watches": "declare_liveliness_subscriber",
    "asks": "query",
    "sends": "put",
}
RULES = access_control(
    [
        client("alice", Role.OPERATOR),
        client("guest", Role.VIEWER),
        client("camera", Role.SENSOR),
        client("tape", Role.RECORDER),
    ]
)


def allowed(name: str, message: str) -> set[str]:
    """Return the keys below a robot that `name` may use with a message type."""
    ids = {i for p in RULES["policies"] if name in p["subjects"] for i in p["rules"]}
    return {
        key.removeprefix("twin/*/")
        for rule in RULES["rules"]
        if rule["id"] in ids and rule["flows"] == ["ingress"] and message in rule["messages"]
        for key in rule["key_exprs"]
    }


@pytest.mark.parametrize(
    ("name", "column"), [("guest", 1), ("alice", 2), ("camera", 3), ("tape", 4)]
)
def test_the_table_is_what_is_allowed(name: str, column: int) -> None:
    (rows,) = tables(section(PAGE, "## Who may what"))
    shown: dict[str, set[zenoh.KeyExpr]] = {word: set() for word in MESSAGES}
    for row in rows:
        key = quoted(row[0])[0].replace("<name>", name).replace("-*", "-$*")
        for word in filter(None, re.split(r",\s*", row[column])):
            shown[word].add(zenoh.KeyExpr(key))
    for word, message in MESSAGES.items():
        keys = {zenoh.KeyExpr(k) for k in allowed(name, message) if "@adv" not in k}
        for key in keys:
            assert any(row.includes(key) for row in shown[word]), f"{name} {word} {key}"
        for row in shown[word]:
            assert any(row.intersects(key) for key in keys), f"{name} does not: {word} {row}"


def test_the_port_on_the_page_is_the_one_that_is_used() -> None:
    port = LISTEN.rpartition(":")[2]
    assert f"TCP {port}" in PAGE
    assert all(f":{port} " in block for block in code(PAGE, "sh") if "openssl" in block)
