"""Portrait of a robot: a small rendered picture for cards and for the start of the page."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from PIL import Image

from tsd_twin.lie import Array
from tsd_twin.models.solids import Part

WIDTH_PX, HEIGHT_PX = 400, 300
_SAMPLES = 2
"""Samples per pixel and direction, against jagged edges."""
_FILL = 0.96
_AZIMUTH_RAD, _ELEVATION_RAD = math.radians(-150.0), math.radians(28.0)
"""Direction from the robot to the camera: behind it, to its right, and above, as in the scene."""
_KEY_LIGHT, _SKY_LIGHT, _GLOSS, _GLOSS_EXPONENT = 0.65, 0.32, 0.15, 24
_GAMMA = 2.2
_QUALITY = 85
_AT_ONCE = 50_000
"""Pixels of triangles that are computed at once; more do not fit into the caches."""


def render_portrait(parts: Iterable[tuple[Array, Part]]) -> bytes:
    """Return a WebP picture with transparent background, `WIDTH_PX` by `HEIGHT_PX`.

    Args:
        parts: vertices (n, 3) of each part in a frame with z up and x ahead, and the part.
    """
    triangles: list[Array] = []
    colours: list[Array] = []
    for vertices, part in parts:
        triangles.append(vertices[np.asarray(part.mesh.faces)])
        colours.append(np.broadcast_to(part.material.rgba[:3], (len(triangles[-1]), 3)))
    corners, normals, albedo = _front_faces(np.concatenate(triangles), np.concatenate(colours))
    shades = _shade(normals, albedo)
    width, height = _SAMPLES * WIDTH_PX, _SAMPLES * HEIGHT_PX
    nearest = rasterize(_fit(corners, width, height), width, height)
    seen = nearest >= 0
    samples = np.where(seen[..., None], shades[nearest], 0.0)
    # Premultiplied by their coverage, edges do not become dark.
    share = _mean_of_samples(seen[..., None].astype(float))
    colour = _mean_of_samples(samples) / np.maximum(share, 1e-9)
    rgba = np.concatenate([colour, share], axis=-1)
    picture = io.BytesIO()
    Image.fromarray((255.0 * rgba).round().astype(np.uint8)).save(picture, "WEBP", quality=_QUALITY)
    return picture.getvalue()


def rasterize(triangles: Array, width: int, height: int) -> npt.NDArray[np.intp]:
    """Return the index of the nearest triangle at each pixel (height, width), or -1.

    Args:
        triangles: (n, 3, 3): corners as x to the right and y down in pixels, and depth. The
            middle of the first pixel is (0.5, 0.5).
        width: Width of the picture in pixels.
        height: Height of the picture in pixels.
    """
    flat = triangles[..., :2]
    first = np.maximum(np.ceil(flat.min(axis=1) - 0.5), 0.0).astype(np.intp)
    last = np.minimum(np.floor(flat.max(axis=1) - 0.5), [width - 1, height - 1]).astype(np.intp)
    columns, rows = np.maximum(last - first + 1, 0).T
    count = columns * rows
    # Barycentric coordinates are linear in the place: u = g . (p - a).
    a = flat[:, 0]
    ab, ac = flat[:, 1] - a, flat[:, 2] - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    area[abs(area) < 1e-9] = np.nan  # Seen edge-on: no point is inside.
    gu = np.stack([ac[:, 1], -ac[:, 0]], axis=1) / area[:, None]
    gv = np.stack([-ab[:, 1], ab[:, 0]], axis=1) / area[:, None]
    nearest = np.full(width * height, -1)
    depth_of = np.full(width * height, np.inf)
    total = np.cumsum(count, dtype=np.intp)
    borders = np.searchsorted(total, np.arange(_AT_ONCE, int(total[-1]), _AT_ONCE))
    for part in np.split(np.arange(len(triangles)), borders):
        which = np.repeat(part, count[part])
        place = np.arange(len(which)) - np.repeat(np.cumsum(count[part]) - count[part], count[part])
        x = first[which, 0] + place % columns[which]
        y = first[which, 1] + place // columns[which]
        dx, dy = x + 0.5 - a[which, 0], y + 0.5 - a[which, 1]
        u = gu[which, 0] * dx + gu[which, 1] * dy
        v = gv[which, 0] * dx + gv[which, 1] * dy
        inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
        which, u, v, pixel = which[inside], u[inside], v[inside], (y * width + x)[inside]
        depths = triangles[which, :, 2]
        ab_depth, ac_depth = depths[:, 1] - depths[:, 0], depths[:, 2] - depths[:, 0]
        depth = depths[:, 0] + u * ab_depth + v * ac_depth
        near = np.flatnonzero(depth < depth_of[pixel])
        near = near[np.argsort(-depth[near], kind="stable")]
        nearest[pixel[near]] = which[near]  # The last assignment to a pixel stays.
        depth_of[pixel[near]] = depth[near]
    return nearest.reshape(height, width)


def _front_faces(triangles: Array, colours: Array) -> tuple[Array, Array, Array]:
    """Return corners in camera axes, normals and colours of the triangles that face the camera."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    facing = normals @ _camera_axes()[:, 2] < 0.0
    normals = normals[facing] / np.linalg.norm(normals[facing], axis=1, keepdims=True)
    return triangles[facing] @ _camera_axes(), normals, colours[facing]


def _camera_axes() -> Array:
    """Return right, down and ahead of the camera as columns."""
    cos_e, sin_e = math.cos(_ELEVATION_RAD), math.sin(_ELEVATION_RAD)
    ahead = -np.array([cos_e * math.cos(_AZIMUTH_RAD), cos_e * math.sin(_AZIMUTH_RAD), sin_e])
    right = np.array([-math.sin(_AZIMUTH_RAD), math.cos(_AZIMUTH_RAD), 0.0])
    return np.stack([right, np.cross(ahead, right), ahead], axis=1)


def _shade(normals: Array, albedo: Array) -> Array:
    """Return the colours (n, 3) of faces under a key light, a sky, and with some gloss."""
    right, _down, ahead = _camera_axes().T
    key = np.array([0.0, 0.0, 0.9]) - 0.6 * ahead - 0.35 * right
    key /= np.linalg.norm(key)
    half = (key - ahead) / np.linalg.norm(key - ahead)
    diffuse = _KEY_LIGHT * np.maximum(normals @ key, 0.0) + _SKY_LIGHT * (0.5 + 0.5 * normals[:, 2])
    gloss = _GLOSS * np.maximum(normals @ half, 0.0) ** _GLOSS_EXPONENT
    linear = albedo**_GAMMA * diffuse[:, None] + gloss[:, None]
    return np.asarray(np.clip(linear, 0.0, 1.0) ** (1.0 / _GAMMA))


def _fit(corners: Array, width: int, height: int) -> Array:
    """Return corners (n, 3, 3) scaled to a picture and centred in it."""
    least, most = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    scale = _FILL * (np.array([width, height]) / (most - least)[:2]).min()
    centred = scale * (corners - 0.5 * (least + most))
    return np.asarray(centred + np.array([0.5 * width, 0.5 * height, 0.0]))


def _mean_of_samples(samples: Array) -> Array:
    """Return pixels (h, w, k) from samples."""
    grouped = samples.reshape(HEIGHT_PX, _SAMPLES, WIDTH_PX, _SAMPLES, -1)
    return np.asarray(grouped.mean(axis=(1, 3)))
