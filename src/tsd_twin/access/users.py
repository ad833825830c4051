"""Who may log in to a dashboard: a file with names, roles and hashes of passwords."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import argon2
import argon2.exceptions
import msgspec

from tsd_twin.access.identity import Role, client
from tsd_twin.access.pem import replace
from tsd_twin.access.private import refuse_public
from tsd_twin.errors import TwinError

LEAST_CHARACTERS = 10
_MOST_CHARACTERS = 256
_HASHER = argon2.PasswordHasher()
"""With the second set of parameters of RFC 9106: 64 MiB, three passes."""
_HEAD = (
    "# Who may log in to the dashboard, and as what. Made by tsd-users; the dashboard reads it\n"
    "# when it starts. A viewer may stop the robot only with `may_stop = true`.\n"
)


@dataclass(frozen=True, slots=True)
class User:
    """Somebody who can log in."""

    name: str
    role: Role
    may_stop: bool


class _Entry(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    role: str
    argon2: str
    may_stop: bool | None = None


class _File(msgspec.Struct, forbid_unknown_fields=True):
    users: dict[str, _Entry] = {}


class Users:
    """The users of one file."""

    def __init__(self, entries: dict[str, _Entry]) -> None:
        self._entries = entries

    @classmethod
    def load(cls, file: Path) -> Users:
        """Read a file.

        Raises:
            TwinError: it cannot be read, something in it is wrong, nobody is in it, or others can
                read it.
        """
        users = cls.load_any(file)
        if not users.names:
            raise TwinError(f"{file} has nobody who could log in: see tsd-users --help")
        return users

    @classmethod
    def load_any(cls, file: Path) -> Users:
        """Read a file, which may be empty.

        Raises:
            TwinError: it cannot be read, has something that is wrong, or others can read it.
        """
        refuse_public(file)
        try:
            content = msgspec.toml.decode(file.read_bytes(), type=_File)
        except OSError as error:
            raise TwinError(f"{file} cannot be read: {error.strerror}") from error
        except (msgspec.DecodeError, UnicodeError) as error:
            raise TwinError(f"{file} is no file of users: {error}") from error
        for name, entry in content.users.items():
            _check(file, name, entry)
        return cls(content.users)

    @property
    def names(self) -> list[str]:
        """Who there is, in order."""
        return sorted(self._entries)

    def user(self, name: str) -> User:
        """Return a user by name; KeyError when there is none."""
        entry = self._entries[name]
        role = Role(entry.role)
        return User(name, role, role is Role.OPERATOR or bool(entry.may_stop))

    def check(self, name: str, password: str) -> User | None:
        """Return the user whose name and password these are.

        Takes about 50 ms of a processor and 64 MiB, whoever is asked for: never on an event loop.
        """
        # Whoever asks for a name that is not there waits as long as for one that is.
        stand_in = next(iter(self._entries.values()))
        try:
            _HASHER.verify(self._entries.get(name, stand_in).argon2, password[:_MOST_CHARACTERS])
        except argon2.exceptions.VerificationError:
            return None
        known = name in self._entries and len(password) <= _MOST_CHARACTERS
        return self.user(name) if known else None

    # Changing.

    def put(self, name: str, role: Role, password: str, *, may_stop: bool) -> None:
        """Add somebody, or give a new role and password.

        Raises:
            TwinError: the name cannot be one, or the password is too short.
        """
        client(name, role)
        if not LEAST_CHARACTERS <= len(password) <= _MOST_CHARACTERS:
            raise TwinError(
                f"a password has {LEAST_CHARACTERS} to {_MOST_CHARACTERS} characters: three or "
                "four words that have nothing to do with each other are good"
            )
        entry = _Entry(role, _HASHER.hash(password), may_stop=may_stop or None)
        self._entries[name] = entry

    def remove(self, name: str) -> None:
        """Remove somebody.

        Raises:
            TwinError: there is no such user.
        """
        if self._entries.pop(name, None) is None:
            raise TwinError(f"there is no '{name}' to be removed")

    def save(self, file: Path) -> None:
        """Write the file, for its owner alone.

        Raises:
            TwinError: it cannot be written.
        """
        text = _HEAD
        for name in self.names:
            entry = self._entries[name]
            text += f'\n[users.{name}]\nrole = "{entry.role}"\nargon2 = "{entry.argon2}"\n'
            text += "may_stop = true\n" if entry.may_stop else ""
        replace(file, text.encode(), mode=0o600)


def _check(file: Path, name: str, entry: _Entry) -> None:
    if entry.role not in (Role.OPERATOR, Role.VIEWER):
        raise TwinError(f"{file}: the role of '{name}' is '{entry.role}', not operator or viewer")
    try:
        client(name, Role(entry.role))
    except TwinError as error:
        raise TwinError(f"{file}: {error}") from error
    try:
        argon2.extract_parameters(entry.argon2)
    except argon2.exceptions.InvalidHashError as error:
        raise TwinError(
            f"{file}: what '{name}' has is no argon2 hash: passwords are never kept, "
            "and tsd-users makes the hash"
        ) from error
