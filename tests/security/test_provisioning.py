"""The key folder is created by a command and extended by the next, never reduced."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.support.key_folders import (
    ALICE,
    BOB,
    FIRST,
    NOW,
    commanders,
    content,
    provision_folder,
    setting,
)
from tsd_twin import security
from tsd_twin.bus import Config, client_config, from_file, node_config
from tsd_twin.errors import TwinError
from tsd_twin.security import Role
from tsd_twin.security.access_rules import LARGEST_BYTES
from tsd_twin.security.key_folder import KeyFolder


def test_one_order_makes_all_that_robot_and_people_need(keys: Path) -> None:
    kinds = {"pem", "key", "json5"}
    identities = {f"{n}.{kind}" for n in ("robot", "alice", "guest") for kind in kinds}
    assert set(content(keys)) == {"ca.pem", "ca.key", *identities}
    for name in ("alice", "guest"):
        assert setting(keys, name, "connect/endpoints") == ["tls/robot.local:7447"]
        assert setting(keys, name, "listen/endpoints") == []
    assert setting(keys, "robot", "listen/endpoints") == ["tls/0.0.0.0:7447"]
    assert setting(keys, "robot", "transport/link/tls/enable_mtls") is True
    assert commanders(keys) == {"alice"}


def leaves(tree: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Return the settings in a tree by their paths."""
    found: dict[str, Any] = {}
    for key, value in tree.items():
        here = f"{path}/{key}".removeprefix("/")
        found |= leaves(value, here) if isinstance(value, dict) else {here: value}
    return found


@pytest.mark.parametrize(
    ("name", "base", "changed"),
    [
        ("robot", node_config([]), {"access_control", "listen", "low_pass_filter", "transport"}),
        ("alice", client_config(["tls/robot.local:7447"]), {"transport"}),
    ],
)
def test_what_the_bus_has_tuned_stays_so(
    keys: Path, name: str, base: Config, changed: set[str]
) -> None:
    """Leases, retries, no scouting, no shared memory: all as without TLS."""
    plain = leaves(json.loads(str(base.parsed())))
    ours = leaves(json.loads(str(from_file(str(keys / f"{name}.json5")).parsed())))
    different = {key for key in ours if plain.get(key) != ours[key]}
    assert {key.partition("/")[0] for key in different} == changed
    assert {key for key in different if not key.startswith("transport/link/tls/")} <= {
        "access_control/enabled",
        "access_control/policies",
        "access_control/rules",
        "access_control/subjects",
        "listen/endpoints",
        "low_pass_filter",
        "transport/link/protocols",
        "transport/link/rx/max_message_size",
    }


def test_nothing_long_reaches_the_robot_on_any_key(keys: Path) -> None:
    (limit,) = setting(keys, "robot", "low_pass_filter")
    assert limit["size_limit"] == 4096
    assert setting(keys, "robot", "transport/link/rx/max_message_size") == LARGEST_BYTES
    for key in ("twin/tsd/cmd/alice/twist", "twin/tsd/desc", "twin/tsd/event/mode/@adv/pub/1"):
        within = [zenoh.KeyExpr(wide).includes(zenoh.KeyExpr(key)) for wide in limit["key_exprs"]]
        assert any(within)


def test_the_same_order_again_changes_nothing(keys: Path) -> None:
    before = content(keys)
    assert provision_folder(keys, NOW + timedelta(days=3), **FIRST) == []
    assert provision_folder(keys) == []
    assert content(keys) == before


def test_a_new_name_is_added_and_nobodys_key_or_certificate_changes(keys: Path) -> None:
    before = content(keys)
    made = provision_folder(keys, identities=(BOB,))
    assert made == ["bob.key", "bob.pem", "robot.json5", "bob.json5"]
    after = content(keys)
    assert {name for name in before if after[name] != before[name]} == {"robot.json5"}
    assert commanders(keys) == {"alice", "bob"}


def test_a_new_name_of_the_robot_gives_its_key_another_certificate(keys: Path) -> None:
    before = content(keys)
    assert provision_folder(keys, hosts=("10.0.0.9", "ROBOT.local")) == ["robot.pem"]
    assert KeyFolder(keys).hosts() == ["robot.local", "192.168.1.7", "10.0.0.9"]
    assert content(keys)["robot.key"] == before["robot.key"]


def test_what_was_changed_by_hand_stays(keys: Path) -> None:
    file = keys / "robot.json5"
    file.write_text(file.read_text().replace("tls/0.0.0.0:7447", "tls/10.0.0.9:7500"))
    mine = keys / "alice.json5"
    mine.write_text(mine.read_text().replace("robot.local", "10.0.0.9"))
    provision_folder(keys, identities=(BOB,))
    assert setting(keys, "robot", "listen/endpoints") == ["tls/10.0.0.9:7500"]
    assert setting(keys, "alice", "connect/endpoints") == ["tls/10.0.0.9:7447"]
    assert setting(keys, "bob", "connect/endpoints") == ["tls/robot.local:7500"]
    assert commanders(keys) == {"alice", "bob"}


def test_where_the_robot_listens_can_be_changed(keys: Path) -> None:
    assert provision_folder(keys, listen="tls/[::]:7448") == ["robot.json5"]
    assert setting(keys, "robot", "listen/endpoints") == ["tls/[::]:7448"]


def test_an_address_of_version_6_is_written_in_brackets(tmp_path: Path) -> None:
    provision_folder(tmp_path / "keys", hosts=("fe80::1",), identities=(ALICE,))
    assert setting(tmp_path / "keys", "alice", "connect/endpoints") == ["tls/[fe80::1]:7447"]


REFUSED = [
    ("", {"hosts": ("-",)}, "neither a host name nor an address"),
    (
        "",
        {"identities": (security.client("guest", Role.OPERATOR),)},
        "'guest' is a viewer",
    ),
    (
        "",
        {"identities": (security.client("alice-2", Role.VIEWER),)},
        "could be a page",
    ),
    ("", {"listen": "tcp/0.0.0.0:7447"}, "an endpoint with a port"),
    ("ca.key", {"identities": (BOB,)}, "ca.key: bring it back"),
    ("ca.pem", {"identities": (BOB,)}, "ca.pem: bring it back"),
]


@pytest.mark.parametrize(("missing", "order", "says"), REFUSED)
def test_what_cannot_be_is_refused_before_anything_is_written(
    keys: Path, missing: str, order: dict[str, Any], says: str
) -> None:
    if missing:
        (keys / missing).unlink()
    before = content(keys)
    with pytest.raises(TwinError, match=says):
        provision_folder(keys, **order)
    assert content(keys) == before


def test_an_order_without_a_host_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="--robot-host"):
        provision_folder(tmp_path / "keys", identities=(ALICE,))
    assert not (tmp_path / "keys").exists()


@pytest.mark.parametrize("days", [0, -1, 3651])
def test_impossible_days_are_refused(days: int, tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="1 to 3650 days"):
        provision_folder(tmp_path, days=days)


def test_the_longest_order_is_possible_at_once(tmp_path: Path) -> None:
    provision_folder(tmp_path / "keys", hosts=("r",), identities=(ALICE,), days=3650)
