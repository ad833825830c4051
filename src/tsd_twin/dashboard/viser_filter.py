"""What browsers may say to viser: what our panel and picture need, and nothing else.

viser's protocol can do more than its page shows: set any property of a control, switch off its
callbacks, press what is disabled, click any node, upload files, ask for a tunnel to the world.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias, cast

import msgspec
from msgspec import Meta

from tsd_twin.access import Role
from tsd_twin.errors import MessageError

LARGEST_BYTES = 16 * 2**10
"""A camera has 300; a control that is moved, fewer."""
_CAMERA = "ViewerCameraMessage"
_CONTROL = "GuiUpdateMessage"
_CLICK = "SceneNodeClickMessage"
_TARGET = r"^/w/r/[a-z0-9_-]{1,32}/x\Z"
"""What can be clicked on: the sphere of a robot."""
_NOT_OURS = frozenset(
    {
        "CommandTriggerMessage",
        "FileTransferPart",
        "FileTransferPartAck",
        "FileTransferStartUpload",
        "GetRenderResponseMessage",
        "GuiButtonHoldMessage",
        "GuiFormSubmitMessage",
        "LocalStorageGetItemResponseMessage",
        "SceneNodeDragMessage",
        "ScenePointerMessage",
        "ShareUrlDisconnect",
        "ShareUrlRequest",
        "TransformControlsDragEndMessage",
        "TransformControlsDragStartMessage",
        "TransformControlsUpdateMessage",
    }
)
"""What viser's page could say beside that. Nothing of ours listens."""
_OFF = 0.1
"""How far from 1 the length of a quaternion may be."""
_LONGEST = 200
"""Characters of a text that a control can have."""
_DECODER = msgspec.msgpack.Decoder(dict[str, Any])

_Number: TypeAlias = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Positive: TypeAlias = Annotated[float, Meta(gt=0.0, le=1e9)]
_Pixels: TypeAlias = Annotated[int, Meta(ge=0, le=100_000)]
_Triple: TypeAlias = tuple[_Number, _Number, _Number]

_Modifier: TypeAlias = Literal[
    "cmd/ctrl",
    "alt",
    "shift",
    "cmd/ctrl+alt",
    "cmd/ctrl+shift",
    "alt+shift",
    "cmd/ctrl+alt+shift",
]


class _FromBrowser(msgspec.Struct, forbid_unknown_fields=True, frozen=True, tag_field="type"):
    """One kind of message: each field with its type and range, and no other field."""


class _Camera(_FromBrowser, frozen=True, tag=_CAMERA):
    wxyz: tuple[_Number, _Number, _Number, _Number]
    position: _Triple
    fov: Annotated[float, Meta(gt=0.0, lt=math.pi)]
    near: _Positive
    far: _Positive
    image_height: _Pixels
    image_width: _Pixels
    look_at: _Triple
    up_direction: _Triple


class _Updates(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    value: bool | _Number | Annotated[str, Meta(max_length=_LONGEST)]


class _Control(_FromBrowser, frozen=True, tag=_CONTROL):
    uuid: Annotated[str, Meta(max_length=64)]
    updates: _Updates


class _Click(_FromBrowser, frozen=True, tag=_CLICK):
    name: Annotated[str, Meta(pattern=_TARGET)]
    ray_origin: _Triple
    ray_direction: _Triple
    instance_index: Annotated[int, Meta(ge=0, le=100_000)] | None = None
    screen_pos: tuple[_Number, _Number] = (0.0, 0.0)
    modifier: _Modifier | None = None
    owner: Annotated[str, Meta(max_length=64)] = ""


_KINDS: Mapping[str, type[_FromBrowser]] = MappingProxyType(
    {_CAMERA: _Camera, _CONTROL: _Control, _CLICK: _Click}
)


def passed(frame: bytes, role: Role) -> bytes | None:
    """Return what of a frame goes on to viser; None when nothing does.

    Where one looks from is the only thing that a viewer may say. What goes on is put together anew
    from fields of known types and ranges, so that viser reads what was judged here. A message of a
    kind that may pass but with other fields is dropped.

    Raises:
        MessageError: `shape`, when it is nothing that viser's page would say.
    """
    if len(frame) > LARGEST_BYTES:
        raise MessageError("shape", f"no message has more than {LARGEST_BYTES} bytes")
    try:
        message = _DECODER.decode(frame)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise MessageError("shape", str(error)) from error
    kind = message.get("type")
    if not isinstance(kind, str) or (kind not in _KINDS and kind not in _NOT_OURS):
        raise MessageError("shape", "viser's page says no such thing")
    if kind in _NOT_OURS or (kind != _CAMERA and role is not Role.OPERATOR):
        return None
    try:
        read = msgspec.convert(message, _KINDS[kind])
    except (msgspec.ValidationError, OverflowError):
        return None
    fields = msgspec.to_builtins(read)
    return msgspec.msgpack.encode(fields) if _is_finite(fields) else None


def _is_finite(value: Any) -> bool:
    """Tell whether no number in it is infinite or none at all, and a quaternion turns something."""
    match value:
        case float():
            return math.isfinite(value)
        case dict():
            fields = cast("dict[str, Any]", value)
            turned = fields.get("wxyz")
            unit = turned is None or abs(math.hypot(*turned) - 1.0) < _OFF
            return unit and all(map(_is_finite, fields.values()))
        case list() | tuple():
            return all(map(_is_finite, cast("Sequence[Any]", value)))
        case _:
            return True
