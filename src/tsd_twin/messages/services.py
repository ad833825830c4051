"""Requests, replies and the description of a robot: JSON on the bus."""

from __future__ import annotations

import re
from typing import Annotated, Literal, TypeAlias, TypeVar

import msgspec
from msgspec import Meta

from tsd_twin.messages.codes import Reason
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.sentences import sentence
from tsd_twin.messages.topics import Service

LeaseId: TypeAlias = Annotated[str, Meta(pattern=r"^[0-9a-f]{32}\Z")]
Operator: TypeAlias = Annotated[str, Meta(pattern=r"^[a-z0-9_-]{1,32}\Z")]
ShortText: TypeAlias = Annotated[str, Meta(max_length=200)]
"""Bounded length, because it may be repeated in every status."""
StructT = TypeVar("StructT", bound=msgspec.Struct)


class LeaseRequest(msgspec.Struct, frozen=True, kw_only=True):
    """`srv/lease`: `acquire`, `renew` or `release` the lease, or `peek` at its holder.

    `request` asks the holder for it, until `withdraw`; the holder responds with `grant` or `deny`.
    """

    op: Literal["acquire", "renew", "release", "peek", "request", "withdraw", "grant", "deny"]
    operator: Operator
    lease: LeaseId | None = None
    """Lease id, required for renew, release, grant and deny."""
    requester: Operator | None = msgspec.field(default=None, name="asker")
    """Requester addressed by grant or deny."""
    take_over: bool = False
    """Acquire the lease even if another operator holds it; the holder is notified."""
    reason: ShortText = ""
    """Reason for a take-over, published as an event."""
    max_age_s: Annotated[float, Meta(gt=0.0)] | None = None
    """Requested maximum command age for slow links; lowers the speed limit."""
    name: ShortText = ""
    """Display name of the operator, in any script."""


class HolderRequest(msgspec.Struct, frozen=True):
    """`srv/arm`, `srv/disarm`, `srv/reset`: requests that require the lease."""

    lease: LeaseId


class SetPoseRequest(msgspec.Struct, frozen=True):
    """`srv/set_pose`: new pose estimate in `odom`."""

    lease: LeaseId
    x_m: float
    y_m: float
    heading_rad: float


class SetOrientationRequest(msgspec.Struct, frozen=True):
    """`srv/set_pose` for a sphere: new orientation, by default the identity."""

    lease: LeaseId
    xyzw: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """Quaternion, not necessarily normalized, as in `geometry_msgs/msg/Quaternion`."""


class SpeedRequest(msgspec.Struct, frozen=True):
    """`srv/speed`: speed of continuously spinning wheels."""

    lease: LeaseId
    cruise_speed_rpm: float


class StopRequest(msgspec.Struct, frozen=True):
    """`stop`: open to all clients; all fields are optional."""

    operator: ShortText = ""
    reason: ShortText = ""
    name: ShortText = ""
    """Display name of the operator, in any script."""


class LeaseReply(msgspec.Struct, frozen=True):
    """Reply of `srv/lease`."""

    granted: bool
    lease: str | None = None
    holder: str | None = None
    ttl_s: float = 0.0
    reason: str = ""
    max_age_s: float = 0.0
    """Maximum age of accepted commands under this lease."""
    ok: bool = True
    """False if the request was malformed."""
    done: bool = False
    """Whether the request was carried out, also for operations that grant no lease."""
    why: Reason | None = None
    """Code and parameters behind `reason`."""
    key: str = ""
    """X25519 key of the robot in hex, if it requires signed commands."""


class Reply(msgspec.Struct, frozen=True):
    """Reply of all other services."""

    ok: bool
    reason: str = ""
    why: Reason | None = None
    """Code and parameters behind `reason`."""

    @staticmethod
    def refused(why: Reason) -> Reply:
        """Refusal for a reason."""
        return Reply(False, sentence(why), why)


class Description(msgspec.Struct, frozen=True):
    """Reply of `desc`."""

    robot: str
    """Description as TOML."""
    urdf: str


def decode_request(payload: bytes, kind: type[StructT]) -> StructT:
    """Decode a request.

    Raises:
        MessageError: If a field is missing or invalid (`shape`).
    """
    return decode_json(payload or b"{}", kind, "a request")


_RENAMED_KEYS = {
    b"asked_by": b"requested_by",
    b"asks_for_s": b"request_expires_in_s",
    b"explained": b"contributions",
    b"late_s": b"latency_s",
    b"reserved_s": b"reservation_expires_in_s",
    b"wanted_rpm": b"requested_rpm",
    b"without_lease": b"no_lease",
}
"""Keys of version 0.1 and before; still read, also from old recordings."""
_OLD_KEY = re.compile(b'"(' + b"|".join(_RENAMED_KEYS) + b')"(?=\\s*:)')


def with_current_keys(payload: bytes) -> bytes:
    """Replace renamed keys in JSON; inside a string, quotes are escaped and do not match."""
    return _OLD_KEY.sub(lambda found: b'"' + _RENAMED_KEYS[found[1]] + b'"', payload)


def decode_json(payload: bytes, kind: type[StructT], what: str) -> StructT:
    """Decode a JSON payload as `kind`; `what` names it in errors.

    Raises:
        MessageError: If a field is missing or invalid (`shape`).
    """
    try:
        return msgspec.json.decode(with_current_keys(payload), type=kind)
    # msgspec raises other errors for invalid UTF-8 and deep nesting.
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError("shape", f"not {what}: {error}") from error


def encode_refusal(service: Service, why: Reason) -> bytes:
    """Encode a reply that refuses a service request."""
    if service is Service.LEASE:
        return msgspec.json.encode(LeaseReply(False, reason=sentence(why), why=why))
    return msgspec.json.encode(Reply.refused(why))
