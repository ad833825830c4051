"""Colours and meshes that lights do not change.

viser maps the tones of the whole picture (ACES, as in three.js), so a colour has to be sent as the
inverse of its image.
"""

from __future__ import annotations

import itertools
import json
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from tsd_twin.dashboard.scene.appearance import Rgb
from tsd_twin.lie import Array

_ACES_IN = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_ACES_OUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_EXPOSURE = 1.0 / 0.6


def linear(colour: Rgb) -> Array:
    """Return linear intensities (3,) of an sRGB colour; IEC 61966-2-1."""
    part = np.array(colour) / 255.0
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)


def srgb(intensities: Array) -> Array:
    """Return sRGB components (..., 3), 0 to 1, of linear intensities (..., 3)."""
    part = np.clip(intensities, 0.0, 1.0)
    shown: Array = np.where(part <= 0.0031308, 12.92 * part, 1.055 * part ** (1.0 / 2.4) - 0.055)
    return shown


def tone_mapped(intensities: Array) -> Array:
    """Return linear intensities (..., 3) as viser shows them."""
    x = _EXPOSURE * intensities @ _ACES_IN.T
    y = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    return np.clip(y @ _ACES_OUT.T, 0.0, 1.0)


@lru_cache(maxsize=4096)
def _fitted(colour: Rgb, most: float) -> tuple[float, float, float]:
    """Return the intensities, at most `most`, whose image is closest to a colour."""
    y = np.clip(np.linalg.solve(_ACES_OUT, linear(colour)), 0.0, 0.98)
    a, b, c = 1.0 - 0.983729 * y, 0.0245786 - 0.4329510 * y, -(0.000090537 + 0.238081 * y)
    exact = (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    best = np.clip(np.linalg.solve(_ACES_IN, exact) / _EXPOSURE, 0.0, most)
    goal, step = np.array(colour) / 255.0, 0.25
    while step > _LEAST_STEP:  # Pattern search in the bounds, which the exact solution may leave.
        tried = np.clip(best + step * (_MOVES * np.maximum(best, 0.05)), 0.0, most)
        errors = np.linalg.norm(srgb(tone_mapped(tried)) - goal, axis=-1)
        closest = int(np.argmin(errors))
        best, step = tried[closest], step if closest else 0.5 * step
    r, g, b = (float(part) for part in best)
    return r, g, b


_MOVES = np.array([(0, 0, 0), *itertools.product((-1, 0, 1), repeat=3)], float)
_LEAST_STEP = 0.01
_MOST_INTENSITY = 8.0


def before_tone_mapping(colour: Rgb, most: float = _MOST_INTENSITY) -> Array:
    """Return the linear intensities (3,), at most `most`, that viser shows as a colour.

    The most saturated colours have no such intensities; the result is the closest.
    """
    return np.array(_fitted(colour, most))


def line_colour(colour: Rgb) -> Rgb:
    """Return the colour to send for unlit lines, which are limited to 8 bits."""
    r, g, b = (round(255.0 * float(part)) for part in srgb(before_tone_mapping(colour, 1.0)))
    return r, g, b


def vertex_colour(colour: Rgb) -> Rgb:
    """Return the colour to send for an end of an unlit line; viser takes it for linear."""
    r, g, b = (round(255.0 * float(part)) for part in before_tone_mapping(colour, 1.0))
    return r, g, b


def mixed(one: Rgb, other: Rgb, share: float) -> Rgb:
    """Return a colour between two, `share` of the first."""
    r, g, b = (round(share * p + (1.0 - share) * q) for p, q in zip(one, other, strict=True))
    return r, g, b


def coloured(count: int, colour: Rgb, opacity: float | Array = 1.0) -> Array:
    """Return linear RGBA (count, 4) of vertices in a colour; `opacity` is a number or (count,)."""
    return np.column_stack(
        [np.tile(before_tone_mapping(colour), (count, 1)), np.broadcast_to(opacity, count)]
    )


def unlit_glb(
    vertices: npt.NDArray[np.floating[Any]], faces: npt.NDArray[np.uint32], rgba: Array
) -> bytes:
    """Return binary glTF of a mesh that lights and shadows do not change.

    Args:
        vertices: (n, 3): metres.
        faces: (m, 3).
        rgba: (n, 4): linear intensities and opacity of the vertices.
    """
    position, colour = vertices.astype("<f4"), rgba.astype("<f4")
    index = faces.astype("<u4").reshape(-1)
    blobs = [position.tobytes(), colour.tobytes(), index.tobytes()]
    offsets = np.cumsum([0, *(len(blob) for blob in blobs)]).tolist()
    material: dict[str, Any] = {
        "extensions": {"KHR_materials_unlit": {}},
        "alphaMode": "BLEND" if bool((rgba[:, 3] < 1.0).any()) else "OPAQUE",
    }
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}
    head: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "buffers": [{"byteLength": offsets[-1]}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": at, "byteLength": len(blob)}
            for at, blob in zip(offsets, blobs, strict=False)
        ],
        "accessors": _accessors(position, colour, index),
    }
    return _container(json.dumps(head).encode(), b"".join(blobs))


def _accessors(
    position: npt.NDArray[Any], colour: npt.NDArray[Any], index: npt.NDArray[Any]
) -> list[dict[str, Any]]:
    bounds = {"min": position.min(axis=0).tolist(), "max": position.max(axis=0).tolist()}
    kinds = ((position, 5126, "VEC3"), (colour, 5126, "VEC4"), (index, 5125, "SCALAR"))
    accessors: list[dict[str, Any]] = [
        {"bufferView": view, "componentType": number, "count": len(data), "type": kind}
        for view, (data, number, kind) in enumerate(kinds)
    ]
    accessors[0] |= bounds
    return accessors


def _container(head: bytes, body: bytes) -> bytes:
    """Return a GLB container with its two chunks, each padded to 4 bytes."""
    head, body = head + b" " * (-len(head) % 4), body + b"\0" * (-len(body) % 4)
    chunks = b"".join(
        np.array([len(data)], "<u4").tobytes() + kind + data
        for kind, data in ((b"JSON", head), (b"BIN\0", body))
    )
    return b"glTF" + np.array([2, 12 + len(chunks)], "<u4").tobytes() + chunks
