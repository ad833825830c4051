"""Stage of a client: lights, ground, grid, and pictures of the floor."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import viser

from tsd_twin.dashboard.scene.appearance import GROUND_NODE, PALETTES, ROOT, Rgb, Theme
from tsd_twin.dashboard.scene.unlit import coloured, line_colour, mixed, unlit_glb
from tsd_twin.lie import Array
from tsd_twin.messages.pictures import GroundGrid

_KEY_RAD, _RIM_RAD = math.radians(62.0), math.radians(205.0)
"""Azimuths of key and rim light from the camera's, seen from the robot."""
_KEY_COLOUR: Rgb = (255, 242, 226)
_RIM_COLOUR: Rgb = (188, 214, 255)
_INTENSITIES = {Theme.DARK: (1.1, 0.9, 0.05, 0.24), Theme.LIGHT: (1.15, 0.5, 0.1, 0.36)}
"""Intensities of key, rim and ambient light, and of the environment."""
_PLAIN_AMBIENT = 0.9
"""Intensity of ambient light without an environment."""
_SHADOW_OPACITY = {Theme.DARK: 0.55, Theme.LIGHT: 0.22}

_GROUND_M = 60.0
_POOL_M = 2.64
"""Radius of the pool of light around the robot."""
_GROUND_Z_M = -0.002
_PICTURE_Z_M, _PICTURE_QUALITY = 0.0005, 60
_SHADOW_Z_M = 0.0033
"""Above the overlays on the floor, which would hide it."""
_SECTORS = 72


def add_lights(
    scene: viser.SceneApi, theme: Theme, heading_rad: float = 0.0, *, plain: bool = False
) -> None:
    """Add lights, or move them.

    Args:
        scene: Scene of a client, or of a recording.
        theme: Its theme.
        heading_rad: Azimuth of the camera's view, to which the lights are fixed.
        plain: Without shadows and reflections, which take most of the time without a graphics card.
    """
    key, rim, ambient, environment = _INTENSITIES[theme]
    scene.configure_default_lights(enabled=False)
    if plain:
        scene.configure_environment_map(None)
    else:
        scene.configure_environment_map("studio", environment_intensity=environment)
    scene.add_light_ambient("/stage/ambient", intensity=_PLAIN_AMBIENT if plain else ambient)
    behind = heading_rad + math.pi
    for name, azimuth, height_m, colour, intensity in (
        ("key", behind + _KEY_RAD, 2.6 / 1.6, _KEY_COLOUR, key),
        ("rim", behind + _RIM_RAD, 1.3 / 3.0, _RIM_COLOUR, rim),
    ):
        scene.add_light_directional(
            f"/stage/{name}",
            color=colour,
            intensity=intensity,
            cast_shadow=name == "key" and not plain,
            position=(math.cos(azimuth), math.sin(azimuth), height_m),
        )


def add_ground(scene: viser.SceneApi, theme: Theme, *, plain: bool = False) -> None:
    """Add background, floor and grid; a `plain` floor receives no shadows."""
    palette = PALETTES[theme]
    scene.set_background_image(np.full((8, 8, 3), palette.far, np.uint8), format="png")
    scene.add_glb("/stage/ground", _ground(theme), cast_shadow=False, receive_shadow=False)
    scene.add_grid(
        f"{ROOT}/g",
        infinite_grid=True,
        cell_size=0.25,
        cell_color=line_colour(mixed(palette.line, palette.floor, 0.5)),
        cell_thickness=0.7,
        section_size=1.0,
        section_color=line_colour(palette.line),
        section_thickness=1.1,
        fade_distance=7.0,
        fade_strength=1.5,
        shadow_opacity=0.0 if plain else _SHADOW_OPACITY[theme],
    )


@lru_cache(maxsize=len(Theme))
def _ground(theme: Theme) -> bytes:
    """Return a disc with a pool of light that fades to the background, binary glTF."""
    palette = PALETTES[theme]
    radii = np.concatenate([np.linspace(0.0, _POOL_M, 25)[1:], [_GROUND_M]])
    angles = np.arange(_SECTORS) * 2.0 * np.pi / _SECTORS
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    flat = np.concatenate([np.zeros((1, 2)), *(radius * ring for radius in radii)])
    shades = [coloured(1, mixed(palette.floor, palette.far, share)) for share in _pool(radii)]
    rgba = np.concatenate(
        [coloured(1, palette.floor), *(np.repeat(shade, _SECTORS, axis=0) for shade in shades)]
    )
    return unlit_glb(np.insert(flat, 2, _GROUND_Z_M, axis=1), disc_faces(len(radii)), rgba)


def _pool(radii: Array) -> Array:
    """Return the brightness of the pool, 1 in its middle and 0 outside."""
    part = np.clip(radii / _POOL_M, 0.0, 1.0)
    return (1.0 - part * part * (3.0 - 2.0 * part)) ** 2


def disc_faces(rings: int, sectors: int = _SECTORS) -> npt.NDArray[np.uint32]:
    """Return upward faces (n, 3) between a centre vertex and the rings around it."""
    one = np.arange(sectors)
    other = (one + 1) % sectors
    faces = [np.stack([0 * one, 1 + one, 1 + other], axis=-1)]
    for ring in range(rings - 1):
        inner, outer = 1 + ring * sectors, 1 + (ring + 1) * sectors
        faces.append(np.stack([inner + one, outer + one, outer + other], axis=-1))
        faces.append(np.stack([inner + one, outer + other, inner + other], axis=-1))
    return np.concatenate(faces).astype(np.uint32)


def contact_shadow(outline: Array) -> bytes:
    """Return a soft dark area below an outline (n, 2) around the origin, binary glTF."""
    reach = np.linalg.norm(outline, axis=-1)
    scales = np.array([0.55, 0.8, 0.95, 1.08, 1.22])
    opacities = np.array([0.75, 0.75, 0.6, 0.25, 0.0])
    flat = np.concatenate([np.zeros((1, 2)), *(scale * outline for scale in scales)])
    alpha = np.concatenate([[0.75], np.repeat(opacities, len(reach))])
    black = np.zeros((len(flat), 3))
    return unlit_glb(
        np.insert(flat, 2, _SHADOW_Z_M, axis=1),
        disc_faces(len(scales), len(outline)),
        np.column_stack([black, alpha]),
    )


class GroundPictures:
    """Pictures of cameras on the floor of a client's scene, by the camera's key."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._scene = client.scene
        self._drawn: dict[str, tuple[GroundGrid, viser.ImageHandle]] = {}

    def draw(
        self, key: str, picture: npt.NDArray[np.uint8] | None, grid: GroundGrid | None
    ) -> None:
        """Draw a picture (h, w, 3) over the floor of a grid, y upwards; None removes it."""
        if picture is not None:
            picture = np.ascontiguousarray(picture[::-1])  # The y axis of viser's images is down.
        before, image = self._drawn.get(key, (None, None))
        if picture is None or grid is None:
            if image is not None:
                image.remove()
                del self._drawn[key]
        elif image is not None and before == grid and image.image.shape == picture.shape:
            image.image = picture
        else:
            (x, y), (width, depth) = grid.corner_m, grid.size_m
            image = self._scene.add_image(
                f"{GROUND_NODE}/{key.replace('/', '-')}",
                picture,
                width,
                depth,
                format="jpeg",
                jpeg_quality=_PICTURE_QUALITY,
                cast_shadow=False,
                position=(x + 0.5 * width, y + 0.5 * depth, _PICTURE_Z_M),
            )
            self._drawn[key] = grid, image

    def clear(self) -> None:
        """Forget this client's nodes."""
        self._drawn.clear()
