"""A singularity drive whose modules are at positions of a test, in the description of `tsd`."""

from __future__ import annotations

from collections.abc import Sequence

from tsd_twin import robots
from tsd_twin.robots import SingularityDescription

CIRCLE = "azimuths_deg = [90.0, 210.0, 330.0]\npivot_radius_m = 0.15\n"
ODD = ((0.25, 0.15), (-0.2, 0.1), (0.02, -0.22))
"""A layout without any symmetry."""


def text(positions: Sequence[tuple[float, float]] = ODD, name: str = "odd") -> str:
    """TOML text with one `[[drive.modules]]` for each position; as many motors as there are."""
    shipped = robots.read_description("tsd")
    assert CIRCLE in shipped
    tables = "".join(f"[[drive.modules]]\nx_m = {x!r}\ny_m = {y!r}\n\n" for x, y in positions)
    toml = shipped.replace(CIRCLE, "").replace("[limits]", f"{tables}[limits]", 1)
    toml = toml.replace('name = "tsd"', f'name = "{name}"')
    before, rest = toml.split("speed_rpm = [\n", 1)
    curves, after = rest.split("\n]\n", 1)
    lines = curves.splitlines()
    listed = "\n".join(lines[i % len(lines)] for i in range(len(positions)))
    return f"{before}speed_rpm = [\n{listed}\n]\n{after}"


def placed(positions: Sequence[tuple[float, float]] = ODD) -> SingularityDescription:
    """Robot with modules at these positions, metres."""
    robot = robots.parse_description(text(positions), "odd.toml")
    return robots.description_of_kind(robot, SingularityDescription)
