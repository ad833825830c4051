"""Who may speak on a bus that others can reach, and as what."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from tsd_twin import topics
from tsd_twin.errors import BusError, TwinError

LONGEST = 23
"""An operator id has 32 characters, of which each page of a dashboard takes a dash and 8 digits."""
ROBOT = "robot"
AUTHORITY = "ca"


class Role(StrEnum):
    """What a certificate says that its owner is."""

    ROBOT = "robot"
    OPERATOR = "operator"
    """Sees, drives, and stops."""
    VIEWER = "viewer"
    """Sees, and stops."""
    SENSOR = "sensor"
    """Tells robots where they are, as a camera does; sees, and stops."""


@dataclass(frozen=True, slots=True)
class Identity:
    """The owner of a certificate: its common name and its organizational unit."""

    name: str
    role: Role


def client(name: str, role: Role) -> Identity:
    """Return the identity of an operator, a viewer or a sensor.

    Raises:
        TwinError: the name cannot be part of a key, leaves no room for pages, or is not for people.
    """
    try:
        topics.checked(name)
    except BusError as error:
        raise TwinError(str(error)) from error
    if len(name) > LONGEST:
        raise TwinError(f"'{name}' is too long: pages add to it, so {LONGEST} characters are left")
    if name in (ROBOT, AUTHORITY):
        raise TwinError(f"'{name}' is not for people here: choose another")
    return Identity(name, role)


def merged(known: Sequence[Identity], new: Iterable[Identity]) -> list[Identity]:
    """Return all identities, each once, by name.

    Raises:
        TwinError: two of them could be taken for each other.
    """
    roles = {person.name: person.role for person in known}
    for person in new:
        if roles.setdefault(person.name, person.role) is not person.role:
            raise TwinError(
                f"'{person.name}' is {_a(roles[person.name])} and cannot be {_a(person.role)} "
                "as well: choose another name"
            )
    for name in roles:
        for other in roles:
            # Who is alice may use all keys of alice-<page>.
            if other.startswith(f"{name}-"):
                raise TwinError(
                    f"'{other}' could be a page of '{name}': a name must not continue another "
                    "with a dash"
                )
    return [Identity(name, roles[name]) for name in sorted(roles)]


def _a(role: Role) -> str:
    return f"an {role}" if role is Role.OPERATOR else f"a {role}"
