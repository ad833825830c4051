"""The folder: made by one order, added to by the next, never taken from."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tsd_twin import access
from tsd_twin.access import KeyFolder, Order, Role, certificate_identity, pem
from tsd_twin.bus import Config, client_config, from_file, node_config
from tsd_twin.errors import BusError, TwinError

NOW = datetime.now(UTC)
ALICE, BOB, GUEST = (
    access.client("alice", Role.OPERATOR),
    access.client("bob", Role.OPERATOR),
    access.client("guest", Role.VIEWER),
)
FIRST = Order(("robot.local", "192.168.1.7"), (ALICE, GUEST))


def fulfil(path: Path, order: Order, now: datetime = NOW) -> list[str]:
    """Return the names of the files that were made."""
    folder = KeyFolder(path)
    access.fulfil(
        order,
        folder,
        now,
        json.loads(node_config([]).json5),
        lambda endpoint: json.loads(client_config([endpoint]).json5),
    )
    return [file.name for file in folder.made]


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    fulfil(tmp_path / "keys", FIRST)
    return tmp_path / "keys"


def content(path: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in sorted(path.iterdir())}


def setting(path: Path, name: str, key: str) -> Any:
    """What Zenoh itself makes of a configuration."""
    return json.loads(from_file(str(path / f"{name}.json5")).parsed().get_json(key))


def commanders(path: Path) -> set[str]:
    """Return who may send commands."""
    policies = setting(path, "robot", "access_control/policies")
    return {
        name
        for policy in policies
        for name in policy["subjects"]
        if f"drive-{name}" in policy["rules"]
    }


def test_one_order_makes_all_that_robot_and_people_need(keys: Path) -> None:
    kinds = {"pem", "key", "json5"}
    people = {f"{n}.{kind}" for n in ("robot", "alice", "guest") for kind in kinds}
    assert set(content(keys)) == {"ca.pem", "ca.key", *people}
    for name in ("alice", "guest"):
        assert setting(keys, name, "connect/endpoints") == ["tls/robot.local:7447"]
        assert setting(keys, name, "listen/endpoints") == []
    assert setting(keys, "robot", "listen/endpoints") == ["tls/0.0.0.0:7447"]
    assert setting(keys, "robot", "transport/link/tls/enable_mtls") is True
    assert commanders(keys) == {"alice"}


def test_keys_are_for_their_owner_alone(keys: Path) -> None:
    assert keys.stat().st_mode & 0o077 == 0
    for file in keys.glob("*.key"):
        assert file.stat().st_mode & 0o777 == 0o600
        assert file.read_bytes().startswith(b"-----BEGIN PRIVATE KEY-----")  # PKCS #8


def leaves(tree: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Return the settings in a tree by their paths."""
    found: dict[str, Any] = {}
    for key, value in tree.items():
        here = f"{path}/{key}".removeprefix("/")
        found |= leaves(value, here) if isinstance(value, dict) else {here: value}
    return found


@pytest.mark.parametrize(
    ("name", "base"),
    [("robot", node_config([])), ("alice", client_config(["tls/robot.local:7447"]))],
)
def test_what_the_bus_has_tuned_stays_so(keys: Path, name: str, base: Config) -> None:
    """Leases, retries, no scouting, no shared memory: all as without TLS."""
    plain = leaves(json.loads(base.json5))
    changed = {key for key, value in plain.items() if setting(keys, name, key) != value}
    # Zenoh writes out what a filter leaves open, and the robot's filter is for more keys.
    assert changed - {"low_pass_filter"} == ({"listen/endpoints"} if name == "robot" else set())


def test_nothing_long_reaches_the_robot_on_any_key(keys: Path) -> None:
    (limit,) = setting(keys, "robot", "low_pass_filter")
    assert limit["size_limit"] == 4096
    for key in ("twin/tsd/cmd/alice/twist", "twin/tsd/desc", "twin/tsd/event/mode/@adv/pub/1"):
        within = [zenoh.KeyExpr(wide).includes(zenoh.KeyExpr(key)) for wide in limit["key_exprs"]]
        assert any(within)


def test_the_same_order_again_changes_nothing(keys: Path) -> None:
    before = content(keys)
    assert fulfil(keys, FIRST, NOW + timedelta(days=3)) == []
    assert fulfil(keys, Order()) == []
    assert content(keys) == before


def test_a_new_name_is_added_and_nobodys_key_or_certificate_changes(keys: Path) -> None:
    before = content(keys)
    made = fulfil(keys, Order(people=(BOB,)))
    assert made == ["bob.key", "bob.pem", "robot.json5", "bob.json5"]
    after = content(keys)
    assert {name for name in before if after[name] != before[name]} == {"robot.json5"}
    assert commanders(keys) == {"alice", "bob"}


def test_a_new_name_of_the_robot_gives_its_key_another_certificate(keys: Path) -> None:
    before = content(keys)
    assert fulfil(keys, Order(("10.0.0.9", "ROBOT.local"))) == ["robot.pem"]
    assert KeyFolder(keys).hosts() == ["robot.local", "192.168.1.7", "10.0.0.9"]
    assert content(keys)["robot.key"] == before["robot.key"]


def test_who_is_removed_is_out_of_the_rules_by_the_next_run(keys: Path) -> None:
    for file in keys.glob("guest.*"):
        file.unlink()
    (keys / "ca.key").unlink()  # It is not needed for that.
    assert fulfil(keys, Order()) == ["robot.json5"]
    subjects = setting(keys, "robot", "access_control/subjects")
    assert [subject["id"] for subject in subjects] == ["alice"]


def test_a_certificate_alone_is_renewed(keys: Path) -> None:
    before, later = content(keys), NOW + timedelta(days=300)
    (keys / "alice.pem").unlink()
    assert fulfil(keys, Order(people=(ALICE,)), later) == ["alice.pem"]
    assert KeyFolder(keys).end_of("alice") - later > timedelta(days=364)
    assert content(keys)["alice.key"] == before["alice.key"]


def test_what_was_interrupted_is_finished_by_the_next_run(keys: Path) -> None:
    whole = set(content(keys))
    for name in ("alice.pem", "alice.json5", "robot.json5", "robot.pem"):
        (keys / name).unlink()
    fulfil(keys, FIRST)
    assert set(content(keys)) == whole
    assert commanders(keys) == {"alice"}


def test_what_was_changed_by_hand_stays(keys: Path) -> None:
    file = keys / "robot.json5"
    file.write_text(file.read_text().replace("tls/0.0.0.0:7447", "tls/10.0.0.9:7500"))
    mine = keys / "alice.json5"
    mine.write_text(mine.read_text().replace("robot.local", "10.0.0.9"))
    fulfil(keys, Order(people=(BOB,)))
    assert setting(keys, "robot", "listen/endpoints") == ["tls/10.0.0.9:7500"]
    assert setting(keys, "alice", "connect/endpoints") == ["tls/10.0.0.9:7447"]
    assert setting(keys, "bob", "connect/endpoints") == ["tls/robot.local:7500"]
    assert commanders(keys) == {"alice", "bob"}


def test_where_the_robot_listens_can_be_changed(keys: Path) -> None:
    assert fulfil(keys, Order(listen="tls/[::]:7448")) == ["robot.json5"]
    assert setting(keys, "robot", "listen/endpoints") == ["tls/[::]:7448"]


def test_an_address_of_version_6_is_written_in_brackets(tmp_path: Path) -> None:
    fulfil(tmp_path / "keys", Order(("fe80::1",), (ALICE,)))
    assert setting(tmp_path / "keys", "alice", "connect/endpoints") == ["tls/[fe80::1]:7447"]


REFUSED = [
    ("", Order(("-",)), "neither a host name nor an address"),
    ("", Order(people=(access.client("guest", Role.OPERATOR),)), "'guest' is a viewer"),
    ("", Order(people=(access.client("alice-2", Role.VIEWER),)), "could be a page"),
    ("", Order(listen="tcp/0.0.0.0:7447"), "an endpoint with a port"),
    ("ca.key", Order(people=(BOB,)), "ca.key: bring it back"),
    ("ca.pem", Order(people=(BOB,)), "ca.pem: bring it back"),
]


@pytest.mark.parametrize(("missing", "order", "says"), REFUSED)
def test_what_cannot_be_is_refused_before_anything_is_written(
    keys: Path, missing: str, order: Order, says: str
) -> None:
    if missing:
        (keys / missing).unlink()
    before = content(keys)
    with pytest.raises(TwinError, match=says):
        fulfil(keys, order)
    assert content(keys) == before


def test_an_order_without_a_host_makes_no_folder(tmp_path: Path) -> None:
    with pytest.raises(TwinError, match="--robot-host"):
        fulfil(tmp_path / "keys", Order(people=(ALICE,)))
    assert not (tmp_path / "keys").exists()


@pytest.mark.parametrize("days", [0, -1, 3651])
def test_impossible_days_are_refused(days: int) -> None:
    with pytest.raises(TwinError, match="1 to 3650 days"):
        Order(days=days)


def test_the_longest_order_is_possible_at_once(tmp_path: Path) -> None:
    fulfil(tmp_path / "keys", Order(("r",), (ALICE,), days=3650))


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("robot.json5", "{mode: 'router'}", "robot.json5 was changed"),
        ("robot.json5", '{"listen": {"endpoints": []}}', "must listen at an endpoint"),
        ("mallory.pem", "nonsense", "mallory.pem cannot be read as a certificate"),
        ("ca.key", "nonsense", "ca.key cannot be read as a private key"),
    ],
)
def test_a_file_that_is_not_what_it_should_be_is_named(
    keys: Path, name: str, text: str, says: str
) -> None:
    (keys / name).write_text(text)
    before = content(keys)
    with pytest.raises(TwinError, match=says):
        fulfil(keys, Order(people=(BOB,)))
    assert content(keys) == before


def test_the_key_of_another_authority_signs_nothing(keys: Path, tmp_path: Path) -> None:
    fulfil(tmp_path / "other", FIRST)
    shutil.copy(tmp_path / "other" / "ca.key", keys / "ca.key")
    with pytest.raises(TwinError, match="is not the key of"):
        fulfil(keys, Order(people=(BOB,)))


def test_a_key_is_never_overwritten(keys: Path) -> None:
    before = content(keys)
    with pytest.raises(TwinError, match="File exists"):
        pem.write_key(keys / "alice.key", pem.read_key(keys / "ca.key"))
    assert content(keys) == before


def test_the_folder_can_be_moved_and_lacks_nothing_but_what_it_does_not_need(
    keys: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("robot", "alice"):
        away = tmp_path / f"machine of {name}"
        away.mkdir()
        for file in KeyFolder(keys).files_of(name):
            shutil.copy(file, away)
        monkeypatch.chdir(tmp_path)
        config = from_file(f"machine of {name}/{name}.json5")
        monkeypatch.chdir("/")
        assert {file.parent for file in config.files.values()} == {away}
        for file in away.glob("*.*"):
            if file.suffix != ".json5":
                file.rename(file.with_suffix(".away"))
                with pytest.raises(BusError, match=file.name):
                    from_file(str(away / f"{name}.json5"))
                file.with_suffix(".away").rename(file)


def test_a_configuration_leads_to_the_name_and_the_role_in_its_certificate(keys: Path) -> None:
    for person in (ALICE, GUEST):
        file = from_file(str(keys / f"{person.name}.json5")).certificate
        assert file is not None
        assert certificate_identity(file) == person
    assert from_file(str(keys / "robot.json5")).certificate is None
    assert client_config(["tcp/127.0.0.1:7447"]).certificate is None
