"""Values that clients give to controls of viser: taken only where they fit.

viser 1.1.1 casts whatever comes to the type of the value before, with a traceback on standard error
where that fails, presses what is disabled, and chooses in a menu what is not on it.
"""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import viser

_CONTROLS = attrgetter("_gui_input_handle_from_uuid")
_SETTER = "_handle_gui_updates"
VISERS_OWN = getattr(viser.GuiApi, _SETTER)
"""What is replaced."""


async def update(gui: Any, client_id: int, message: Any) -> None:
    """Do what a client says about a control, if that can be chosen there."""
    handle = _CONTROLS(gui).get(message.uuid)
    value = message.updates.get("value")
    if handle is not None and list(message.updates) == ["value"] and fits(handle, value):
        await VISERS_OWN(gui, client_id, message)


def fits(handle: Any, value: object) -> bool:
    """Tell whether `value` can be chosen by a hand at a control."""
    if handle.disabled or not handle.visible:
        return False
    now = handle.value
    if isinstance(now, bool) or isinstance(value, bool):
        return isinstance(now, bool) and isinstance(value, bool)
    if isinstance(now, float | int):
        return isinstance(value, float | int)
    options = getattr(handle, "options", None)
    return type(value) is type(now) and (options is None or value in options)


def take_strictly() -> None:
    """Let all servers that are made from now on do so; calling it again does nothing."""
    setattr(viser.GuiApi, _SETTER, update)
