"""The folder is authoritative: removed, damaged, and copied files."""

from __future__ import annotations

import shutil
from datetime import timedelta
from pathlib import Path

import pytest

from tests.support.key_folders import (
    ALICE,
    BOB,
    FIRST,
    GUEST,
    NOW,
    commanders,
    content,
    provision_folder,
    setting,
)
from tsd_twin.bus import client_config, from_file
from tsd_twin.errors import BusError, TwinError
from tsd_twin.security import certificates
from tsd_twin.security.key_folder import KeyFolder, certificate_identity


def test_keys_are_for_their_owner_alone(keys: Path) -> None:
    assert keys.stat().st_mode & 0o077 == 0
    for file in keys.glob("*.key"):
        assert file.stat().st_mode & 0o777 == 0o600
        assert file.read_bytes().startswith(b"-----BEGIN PRIVATE KEY-----")  # PKCS #8


def test_who_is_removed_is_out_of_the_rules_by_the_next_run(keys: Path) -> None:
    for file in keys.glob("guest.*"):
        file.unlink()
    (keys / "ca.key").unlink()  # It is not needed for that.
    assert provision_folder(keys) == ["robot.json5"]
    subjects = setting(keys, "robot", "access_control/subjects")
    assert [subject["id"] for subject in subjects] == ["alice"]


def test_a_certificate_alone_is_renewed(keys: Path) -> None:
    before, later = content(keys), NOW + timedelta(days=300)
    (keys / "alice.pem").unlink()
    assert provision_folder(keys, later, identities=(ALICE,)) == ["alice.pem"]
    assert KeyFolder(keys).end_of("alice") - later > timedelta(days=364)
    assert content(keys)["alice.key"] == before["alice.key"]


def test_what_was_interrupted_is_finished_by_the_next_run(keys: Path) -> None:
    whole = set(content(keys))
    for name in ("alice.pem", "alice.json5", "robot.json5", "robot.pem"):
        (keys / name).unlink()
    provision_folder(keys, **FIRST)
    assert set(content(keys)) == whole
    assert commanders(keys) == {"alice"}


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
        provision_folder(keys, identities=(BOB,))
    assert content(keys) == before


def test_the_key_of_another_authority_signs_nothing(keys: Path, tmp_path: Path) -> None:
    provision_folder(tmp_path / "other", **FIRST)
    shutil.copy(tmp_path / "other" / "ca.key", keys / "ca.key")
    with pytest.raises(TwinError, match="is not the key of"):
        provision_folder(keys, identities=(BOB,))


def test_a_key_is_never_overwritten(keys: Path) -> None:
    before = content(keys)
    with pytest.raises(TwinError, match="File exists"):
        certificates.write_key(keys / "alice.key", certificates.read_key(keys / "ca.key"))
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
