"""How the scene of a browser is lit that has no graphics card."""

from __future__ import annotations

import viser

_AMBIENT = "/ambient"
_INTENSITY = 1.5
"""As bright as the reflections that it stands for."""


def make_plain(own: viser.SceneApi) -> None:
    """Take shadows and reflections from the scene of one client: they take most of a frame's time.

    Also after its nodes have been reset.
    """
    own.configure_default_lights(cast_shadow=False)
    own.configure_environment_map(None)
    own.add_light_ambient(_AMBIENT, intensity=_INTENSITY)
