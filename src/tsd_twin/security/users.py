"""Users of a dashboard: password file and login sessions."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path

import argon2
import argon2.exceptions
import msgspec

from tsd_twin.errors import TwinError
from tsd_twin.security.access_rules import Role, client
from tsd_twin.security.certificates import replace_file
from tsd_twin.security.rate_limits import AttemptLimits, LoginRateLimiter
from tsd_twin.security.router_rules import EVERY_ROBOT, RobotRights, parse_robots, show_robots

_OTHERS = stat.S_IWGRP | stat.S_IRWXO
"""Permission bits that a file must not have; its group, for example of a service, may read it."""


def refuse_public(file: Path) -> None:
    """Reject a file that other users can read or change.

    Raises:
        TwinError: If others can access the file, or it does not exist.
    """
    try:
        status = file.stat()
    except OSError as error:
        raise TwinError(f"{file} cannot be read: {error.strerror}") from error
    if status.st_mode & _OTHERS:
        raise TwinError(f"{file} can be read or changed by others: run chmod 600 {file}")
    if status.st_uid not in (0, os.geteuid()):
        raise TwinError(f"{file} belongs to another user: make it your own, or root's")


LEAST_CHARACTERS = 10
_MOST_CHARACTERS = 256
_HASHER = argon2.PasswordHasher()
"""Second recommended parameter set of RFC 9106: 64 MiB, three passes."""
_HEAD = (
    "# Who may log in to the dashboard, and as what. Made by tsd-users; the dashboard reads it\n"
    "# when it starts. A viewer may stop the robot only with `may_stop = true`. Without `robots`\n"
    "# and `watch`, all robots are meant.\n"
)


@dataclass(frozen=True, slots=True)
class User:
    """User account of the dashboard."""

    name: str
    role: Role
    may_stop: bool
    rights: RobotRights = EVERY_ROBOT
    """Robots that the user may use and watch."""


class _UserRecord(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    role: str
    argon2: str
    may_stop: bool | None = None
    robots: list[str] | None = None
    watch: list[str] | None = None

    @property
    def rights(self) -> RobotRights:
        """Rights of the user: all robots unless some are listed."""
        if self.robots is None and self.watch is None:
            return EVERY_ROBOT
        return RobotRights(parse_robots(self.robots or ()), parse_robots(self.watch or ()))


class _File(msgspec.Struct, forbid_unknown_fields=True):
    users: dict[str, _UserRecord] = {}


class Users:
    """User accounts of a file."""

    def __init__(self, entries: dict[str, _UserRecord]) -> None:
        self._entries = entries

    @classmethod
    def load(cls, file: Path, *, may_be_empty: bool = False) -> Users:
        """Read a user file.

        Raises:
            TwinError: If the file cannot be read, is invalid, lists no users, or is readable by
                others.
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
        if not (content.users or may_be_empty):
            raise TwinError(f"{file} lists no user: see tsd-users --help")
        return cls(content.users)

    @property
    def names(self) -> list[str]:
        """Names of all users, sorted."""
        return sorted(self._entries)

    def user(self, name: str) -> User:
        """Return a user by name; raises KeyError if unknown."""
        entry = self._entries[name]
        role = Role(entry.role)
        may_stop = role is Role.OPERATOR or bool(entry.may_stop)
        return User(name, role, may_stop, entry.rights)

    def check(self, name: str, password: str) -> User | None:
        """Return the user if the password is correct, else None.

        Takes about 50 ms of CPU time and 64 MiB for every name, so do not call it on an event loop.
        """
        # An unknown name takes as long as a known one, so timing does not reveal names.
        stand_in = next(iter(self._entries.values()))
        try:
            _HASHER.verify(self._entries.get(name, stand_in).argon2, password[:_MOST_CHARACTERS])
        except argon2.exceptions.VerificationError:
            return None
        known = name in self._entries and len(password) <= _MOST_CHARACTERS
        return self.user(name) if known else None

    # Editing.

    def put(
        self,
        name: str,
        role: Role,
        password: str,
        *,
        may_stop: bool,
        rights: RobotRights = EVERY_ROBOT,
    ) -> None:
        """Add a user, or set a new role, password and rights.

        Raises:
            TwinError: If the name is invalid or the password is too short or too long.
        """
        client(name, role)
        if not LEAST_CHARACTERS <= len(password) <= _MOST_CHARACTERS:
            raise TwinError(
                f"a password has {LEAST_CHARACTERS} to {_MOST_CHARACTERS} characters: three or "
                "four words that have nothing to do with each other are good"
            )
        entry = _UserRecord(role, _HASHER.hash(password), may_stop=may_stop or None)
        self._entries[name] = entry
        self.limit(name, rights)

    def limit(self, name: str, rights: RobotRights) -> None:
        """Set the robots of a user.

        Raises:
            TwinError: If the user does not exist.
        """
        if (entry := self._entries.get(name)) is None:
            raise TwinError(f"there is no '{name}'")
        every = rights == EVERY_ROBOT
        entry.robots = None if every else show_robots(rights.use)
        entry.watch = None if every or not rights.watch else show_robots(rights.watch)

    def remove(self, name: str) -> None:
        """Remove a user.

        Raises:
            TwinError: If the user does not exist.
        """
        if self._entries.pop(name, None) is None:
            raise TwinError(f"there is no '{name}' to be removed")

    def save(self, file: Path) -> None:
        """Write the file, readable by its owner only.

        Raises:
            TwinError: If the file cannot be written.
        """
        text = _HEAD
        for name in self.names:
            entry = self._entries[name]
            text += f'\n[users.{name}]\nrole = "{entry.role}"\nargon2 = "{entry.argon2}"\n'
            text += "may_stop = true\n" if entry.may_stop else ""
            for key, robots in (("robots", entry.robots), ("watch", entry.watch)):
                text += "" if robots is None else f"{key} = {json.dumps(robots)}\n"
        replace_file(file, text.encode(), mode=0o600)


def _check(file: Path, name: str, entry: _UserRecord) -> None:
    if entry.role not in (Role.OPERATOR, Role.VIEWER):
        raise TwinError(f"{file}: the role of '{name}' is '{entry.role}', not operator or viewer")
    try:
        client(name, Role(entry.role))
        _ = entry.rights
    except TwinError as error:
        raise TwinError(f"{file}: {error}") from error
    try:
        argon2.extract_parameters(entry.argon2)
    except argon2.exceptions.InvalidHashError as error:
        raise TwinError(
            f"{file}: what '{name}' has is no argon2 hash: passwords are never kept, "
            "and tsd-users makes the hash"
        ) from error


IDLE_S = 30 * 60.0
"""Idle timeout: a login ends after this time without open pages or requests."""
ABSOLUTE_S = 12 * 3600.0
"""Maximum lifetime of a login."""
_AT_ONCE = 16
"""Maximum logins per user; one more ends the oldest."""


@dataclass(slots=True)
class Login:
    """Login session of a user in a browser; its id is a digest of the cookie's secret."""

    id: str
    user: User
    began_s: float
    used_s: float


class Logins:
    """Login sessions and rate limits; `now_s` is monotonic time."""

    def __init__(
        self,
        *,
        idle_s: float = IDLE_S,
        absolute_s: float = ABSOLUTE_S,
        attempts: AttemptLimits | None = None,
    ) -> None:
        self._idle_s = idle_s
        self._absolute_s = absolute_s
        self._logins: dict[str, Login] = {}
        self._limits = attempts or AttemptLimits()
        self._names = LoginRateLimiter(free=10, first_s=10.0, longest_s=300.0)

    # Attempts.

    def wait_s(self, address: str, name: str, now_s: float) -> float:
        """Return the wait before the next try; if 0, count the try until `right` is called."""
        wait_s = self._limits.wait_s(address, now_s, self._names.wait_s(name, now_s))
        if wait_s <= 0.0:
            self._names.count_attempt(name, now_s)
        return wait_s

    def wait_nameless_s(self, address: str, now_s: float) -> float:
        """Return the wait before the next try without a name; if 0, count the try."""
        return self._limits.wait_s(address, now_s)

    def right(self, address: str, name: str) -> None:
        """Record that a try succeeded. Other tries from the address still count."""
        self._limits.right(address)
        self._names.forget(name)

    # Sessions.

    def open(self, user: User, now_s: float) -> str:
        """Open a login and return its secret for the cookie, which is stored nowhere else."""
        own = [login for login in self._logins.values() if login.user.name == user.name]
        for login in own[: max(0, len(own) - _AT_ONCE + 1)]:
            self.close(login.id)
        secret = secrets.token_urlsafe(32)
        login = Login(_digest(secret), user, now_s, now_s)
        self._logins[login.id] = login
        return secret

    def find(self, secret: str | None, now_s: float) -> Login | None:
        """Return the active login for a cookie, and mark it as used."""
        # Digests are looked up, so timing reveals nothing about the secrets.
        login = None if secret is None else self._logins.get(_digest(secret))
        if login is None or self._is_over(login, now_s):
            return None
        login.used_s = now_s
        return login

    def close(self, login_id: str) -> None:
        """End a login."""
        self._logins.pop(login_id, None)

    def sweep(self, used: set[str], now_s: float) -> None:
        """Mark logins with open pages as used, and end expired ones."""
        for login_id in used & self._logins.keys():
            self._logins[login_id].used_s = now_s
        over = [login.id for login in self._logins.values() if self._is_over(login, now_s)]
        for login_id in over:
            self.close(login_id)

    def is_open(self, login_id: str) -> bool:
        """Return whether a login is active."""
        return login_id in self._logins

    def _is_over(self, login: Login, now_s: float) -> bool:
        return now_s - login.used_s > self._idle_s or now_s - login.began_s > self._absolute_s


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
