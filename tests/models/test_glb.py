"""Binary glTF: same shapes and materials, with shading that distinguishes edges from curves."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

import numpy as np
import pytest
import trimesh

from tsd_twin.models import draw_parts, glb
from tsd_twin.models.solids import Material, Part
from tsd_twin.robots import load_robot

PARTS = draw_parts(load_robot("tsd"))
GREY = Material((0.5, 0.5, 0.5, 1.0), 0.0, 1.0, 1000.0)


def opened(data: bytes) -> dict[str, trimesh.Trimesh]:
    scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    return dict(scene.geometry)


def header(data: bytes) -> dict[str, Any]:
    """Return the JSON chunk; layout from the glTF 2.0 specification, section 4.4."""
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    return json.loads(data[20 : 20 + size])


@pytest.mark.parametrize("link", PARTS)
def test_every_part_is_there_with_its_shape(link: str) -> None:
    meshes = opened(glb(PARTS[link]))
    assert sorted(meshes) == sorted(part.name for part in PARTS[link])
    for part in PARTS[link]:
        np.testing.assert_allclose(meshes[part.name].bounds, part.mesh.bounds, atol=1e-6)
        assert meshes[part.name].area == pytest.approx(part.mesh.area, rel=1e-3)


def test_materials_are_those_of_the_parts() -> None:
    for part in PARTS["chassis"]:
        (material,) = header(glb([part]))["materials"]
        surface = material["pbrMetallicRoughness"]
        assert surface.get("metallicFactor", 1.0) == pytest.approx(part.material.metallic)
        assert surface.get("roughnessFactor", 1.0) == pytest.approx(part.material.roughness)
        translucent = part.material.rgba[3] < 1.0
        assert material.get("alphaMode", "OPAQUE") == ("BLEND" if translucent else "OPAQUE")
        assert surface["baseColorFactor"][3] == pytest.approx(part.material.rgba[3], abs=1 / 255)


def test_colours_are_linear_in_gltf() -> None:
    """Mid grey of sRGB, 188 of 255, reflects half of the light."""
    material = Material((188 / 255, 0.0, 1.0, 1.0), 0.0, 1.0, 1000.0)
    part = Part("box", "wheel", trimesh.creation.box(), material)
    factor = header(glb([part]))["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"]
    np.testing.assert_allclose(factor, [0.5, 0.0, 1.0, 1.0], atol=0.006)


def test_curved_surfaces_are_shaded_as_the_sphere_they_stand_for() -> None:
    shell = opened(glb(PARTS["wheel"]))["shell"]
    radius = load_robot("tsd").drive.wheel_radius_m
    corners, normals = np.asarray(shell.vertices), np.asarray(shell.vertex_normals)
    outside = np.linalg.norm(corners, axis=1) > radius * 0.999
    upright = np.abs(normals[:, 2]) > 0.999
    inside_the_rim = (corners[:, 2] < -0.1 * radius) & ~upright
    curved = outside & inside_the_rim & (np.sum(normals * corners, axis=1) > 0.9 * radius)
    assert curved.sum() > 300
    radial = corners[curved] / radius
    assert (
        np.degrees(np.arccos(np.clip(np.sum(normals[curved] * radial, axis=1), -1, 1))).max() < 6.0
    )


def test_flat_faces_are_shaded_flat() -> None:
    """On a box and on the decks, every corner has the normal of its face."""
    box = Part("box", "wheel", trimesh.creation.box((0.1, 0.2, 0.3)), GREY)
    decks = next(part for part in PARTS["chassis"] if part.name == "decks")
    for part in (box, decks):
        mesh = opened(glb([part]))[part.name]
        level = np.abs(mesh.face_normals[:, 2]) > 0.999
        assert level.any()
        shading = np.asarray(mesh.vertex_normals)[mesh.faces[level]]
        facing = np.broadcast_to(mesh.face_normals[level][:, None], shading.shape)
        np.testing.assert_allclose(shading, facing, atol=1e-3)
