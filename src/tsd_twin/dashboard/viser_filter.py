"""What browsers may say to viser: what our panel and picture need, and nothing else.

viser's protocol can do more than its page shows: set any property of a control, switch off its
callbacks, press what is disabled, click any node, upload files, ask for a tunnel to the world.
"""

from __future__ import annotations

import re
from typing import Any

import msgspec

from tsd_twin.access import Role
from tsd_twin.errors import MessageError

LARGEST_BYTES = 16 * 2**10
"""A camera has 300; a control that is moved, fewer."""
_CAMERA = "ViewerCameraMessage"
_CONTROL = "GuiUpdateMessage"
_CLICK = "SceneNodeClickMessage"
_TARGET = re.compile(r"/w/r/[a-z0-9_-]{1,32}/x\Z")
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
_DECODER = msgspec.msgpack.Decoder(dict[str, Any])


def passed(frame: bytes, role: Role) -> bytes | None:
    """Return what of a frame goes on to viser; None when nothing does.

    Where one looks from is the only thing that a viewer may say. It is encoded anew, so that viser
    reads what was judged here.

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
    operates = role is Role.OPERATOR
    if (
        kind == _CAMERA
        or (kind == _CONTROL and operates and _sets_value(message))
        or (kind == _CLICK and operates and _is_on_target(message))
    ):
        return msgspec.msgpack.encode(message)
    if kind in (_CONTROL, _CLICK) or (isinstance(kind, str) and kind in _NOT_OURS):
        return None
    raise MessageError("shape", "viser's page says no such thing")


def _sets_value(message: dict[str, Any]) -> bool:
    updates = message.get("updates")
    return isinstance(updates, dict) and list(updates) == ["value"]  # pyright: ignore[reportUnknownArgumentType]


def _is_on_target(message: dict[str, Any]) -> bool:
    name = message.get("name")
    rays = (message.get("ray_origin"), message.get("ray_direction"))
    return isinstance(name, str) and bool(_TARGET.match(name)) and all(_is_triple(r) for r in rays)


def _is_triple(value: Any) -> bool:
    return (
        isinstance(value, list)
        and len(value) == 3  # pyright: ignore[reportUnknownArgumentType]
        and all(isinstance(number, float | int) for number in value)  # pyright: ignore[reportUnknownVariableType]
    )
