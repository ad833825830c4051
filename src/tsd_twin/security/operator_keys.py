"""Signing keys of the operators in a key folder, and the signed list of them for the robots."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime

import msgspec

from tsd_twin.errors import TwinError
from tsd_twin.security.access_rules import Role
from tsd_twin.security.certificates import create_file, replace_file
from tsd_twin.security.key_folder import KeyFolder
from tsd_twin.security.operator_list import (
    OPERATORS,
    ListedOperator,
    OperatorList,
    decode_list,
    encode_list,
)
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights
from tsd_twin.security.signing_keys import (
    SIGNING_SUFFIX,
    key_pem,
    new_signing_key,
    public_bytes,
    read_signing_key,
)


def provision_operators(
    folder: KeyFolder,
    now: datetime,
    *,
    rights: Mapping[str, RobotRights],
    gateways: Collection[str] = (),
    revoked: Collection[str] = (),
) -> None:
    """Write missing signing keys of operators, and the list if it has changed.

    The key of a revoked operator is listed as revoked and removed with its name; `rights` limits
    operators to robots. The key of the authority is needed if the list changes.

    Raises:
        TwinError: If a file is invalid, a name to revoke is unknown, or the authority's key is
            needed but missing.
    """
    file = folder.path / OPERATORS
    old = OperatorList(0, {})
    if file.exists():
        public = folder.authority_certificate().public_key()
        old = decode_list(file.read_bytes().strip(), public)  # pyright: ignore[reportArgumentType]
    gone = set(old.revoked)
    for name in revoked:
        if name not in old.operators:
            raise TwinError(f"there is no operator '{name}' whose key could be revoked")
        gone |= set(old.operators[name].keys)
    listed: dict[str, ListedOperator] = {}
    for person in folder.identities():
        if person.role is not Role.OPERATOR or person.name in revoked:
            continue
        key_file = folder.path / f"{person.name}{SIGNING_SUFFIX}"
        before = old.operators.get(person.name)
        keys = before.keys if before else ()
        if not before and not key_file.exists():
            create_file(key_file, key_pem(new_signing_key()))
            folder.made.append(key_file)
        if key_file.exists():
            key = public_bytes(read_signing_key(key_file)).hex()
            keys = tuple(dict.fromkeys([*keys, key]))
        keys = tuple(key for key in keys if key not in gone)
        own = rights.get(person.name, RobotRights(EVERY_ROBOT.use, frozenset()))
        robots = None if own.use == EVERY_ROBOT.use else tuple(sorted(own.use))
        is_gateway = person.name in gateways or bool(before and before.for_users)
        if keys:
            listed[person.name] = ListedOperator(keys, is_gateway, robots)
    new = OperatorList(old.number, listed, frozenset(gone))
    if new != old:
        new = msgspec.structs.replace(new, number=old.number + 1)
        replace_file(file, encode_list(new, folder.authority(now).key))
        folder.made.append(file)
