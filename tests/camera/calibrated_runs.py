"""Poses by cameras that calibrated themselves, against the covariance that they state.

`python -m tests.camera.calibrated_runs ACROSS_DEG RUNS` prints each run, and all together;
`exact` as a third word mounts the tag without errors.
"""

from __future__ import annotations

import contextlib
import io
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tsd_twin.camera import guide
from tsd_twin.camera.board import Board
from tsd_twin.camera.lens import View
from tsd_twin.camera.render import Body, SimulatedCamera, cylinder
from tsd_twin.camera.setup_file import CameraSetup, read_setup
from tsd_twin.camera.simulated import floor_tags, random_view
from tsd_twin.camera.tags import Tag
from tsd_twin.camera.tracker import TagTracker
from tsd_twin.lie import Array, wrap

SIZE, HEIGHT_M = (1280, 720), 2.5
ROBOT = Tag(3, 0.16, "tsd", 0.3)
"""Tag as the camera file states it."""
POSES = 20
SPEED_MPS, EXPOSURE_S, PERIOD_S = 1.0, 0.008, 1.0 / 30.0
_EXPOSED = np.linspace(-0.5, 0.5, 5) * EXPOSURE_S
_FRAMES = 4
"""Frames of each motion; the last one counts, because a motion is known from two."""
_FLOOR_PICTURES = 3


@dataclass
class Errors:
    """Errors of the poses of a run."""

    squares: list[float] = field(default_factory=list)
    """Squared errors of three numbers in standard deviations: 3 on average if they are right."""
    errors: list[Array] = field(default_factory=list)

    @property
    def nees(self) -> float:
        """Mean normalized estimation error squared."""
        return float(np.mean(self.squares))

    @property
    def rms_mm(self) -> float:
        """Root of the mean squared distance."""
        return 1e3 * math.sqrt(np.square([each[:2] for each in self.errors]).sum(axis=1).mean())

    @property
    def rms_deg(self) -> float:
        """Root of the mean squared error of the heading."""
        return math.degrees(math.sqrt(np.square([each[2] for each in self.errors]).mean()))


def calibrated(
    folder: Path, seed: int, across_deg: float
) -> tuple[SimulatedCamera, CameraSetup, np.random.Generator]:
    """Return a camera with an unknown lens and place, and the setup that the program finds."""
    random = np.random.default_rng(seed)
    view = random_view(SIZE, across_deg, HEIGHT_M, random)
    on_floor = floor_tags(view, ROBOT.size_m, random)
    camera = SimulatedCamera(view, on_floor, seed=seed)
    file = folder / f"{seed}.toml"
    with contextlib.redirect_stdout(io.StringIO()):
        guide.calibrate_lens_simulated(camera, Board(), str(file), seed)
        numbers, origin, distances_m = guide.measured(on_floor, seed)
        tags = {number: Tag(number, ROBOT.size_m) for number in numbers}
        pictures = [camera.draw([]) for _ in range(_FLOOR_PICTURES)]
        guide.calibrate_floor(read_setup(file), pictures, tags, origin, distances_m, str(file))
    setup = replace(read_setup(file), tags=(ROBOT,), exposure_s=EXPOSURE_S)
    return camera, setup, random


def run(folder: Path, seed: int, across_deg: float, *, is_exact: bool = False) -> dict[str, Errors]:
    """Calibrate a camera and return its errors: standing, at the edge, and driving.

    The tag is mounted with random errors of the standard deviations in the camera file, or exactly.
    """
    camera, setup, random = calibrated(folder, seed, across_deg)
    stated, scale = setup.errors, float(not is_exact)
    mounted = replace(
        ROBOT,
        height_m=ROBOT.height_m + scale * random.normal(0.0, stated.height_m),
        x_m=scale * random.normal(0.0, stated.place_m),
        y_m=scale * random.normal(0.0, stated.place_m),
        heading_rad=scale * random.normal(0.0, stated.heading_rad),
    )
    tilt = scale * random.normal(0.0, stated.tilt_rad, 2)
    body = Body([cylinder(0.2, 0.28)], [mounted])
    result = {"standing": Errors(), "edge": Errors(), "driving": Errors()}
    for name, found in result.items():
        for place in _places(camera.view, random, at_edge=name == "edge"):
            heading, way = random.uniform(-np.pi, np.pi, 2)
            speed = SPEED_MPS if name == "driving" else 0.0
            velocity = speed * np.array([math.cos(way), math.sin(way), 0.0, 0.0, 0.0])
            last = np.array([*place, heading, *tilt])
            for error, covariance in _look(camera, TagTracker(setup), body, last, velocity):
                found.errors.append(error)
                found.squares.append(float(error @ np.linalg.solve(covariance, error)))
    return result


def _places(view: View, random: np.random.Generator, *, at_edge: bool) -> Iterator[Array]:
    """Yield places (2,) with the whole tag in view; at the edge, its border is next to one."""
    scale = float(view.lens.parameters[0]) / (HEIGHT_M - ROBOT.height_m)
    # Half a diagonal with the white border, and as far as it moves.
    inset = (0.9 + 0.4 * (not at_edge)) * ROBOT.size_m * scale
    for _ in range(POSES):
        spot = random.uniform(inset, np.array(SIZE) - inset)
        if at_edge:
            axis = int(random.integers(2))
            spot[axis] = [inset, SIZE[axis] - inset][int(random.integers(2))]
        yield view.on_plane(spot[None], ROBOT.height_m)[0]


def _look(
    camera: SimulatedCamera, tracker: TagTracker, body: Body, last: Array, velocity: Array
) -> Iterator[tuple[Array, Array]]:
    """Show a motion that ends at a pose; yield the error and its covariance in the last frame."""
    frames = _FRAMES if velocity.any() else 1
    for i in range(frames):
        middle_s = (i - frames + 1) * PERIOD_S
        times_s = middle_s + _EXPOSED if velocity.any() else np.array([middle_s])
        picture = camera.draw([(body, [last + velocity * each for each in times_s])])
        seen = tracker.observe(picture, middle_s)
    for each in seen.poses.values():
        error = each.pose.xy_heading - last[:3]
        error[2] = wrap(error[2])
        yield error, each.covariance


def main() -> None:
    """Print each run and all of them together."""
    across_deg, runs = float(sys.argv[1]), int(sys.argv[2])
    together: dict[str, list[Errors]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(1, runs + 1):
            errors = run(Path(folder), seed, across_deg, is_exact=sys.argv[3:] == ["exact"])
            for name, found in errors.items():
                together.setdefault(name, []).append(found)
                words = f"{seed} {name}: {len(found.errors)} of {POSES}, {found.rms_mm:.2f} mm,"
                sys.stdout.write(f"{words} {found.rms_deg:.3f} deg, NEES {found.nees:.2f}\n")
                sys.stdout.flush()
    for name, each in together.items():
        mm, deg = [one.rms_mm for one in each], [one.rms_deg for one in each]
        nees = [one.nees for one in each]
        sys.stdout.write(
            f"{name}: {min(mm):.1f} to {max(mm):.1f} mm, {min(deg):.2f} to {max(deg):.2f} deg,"
            f" NEES {np.mean(nees):.2f} ({min(nees):.2f} to {max(nees):.2f})\n"
        )


if __name__ == "__main__":
    main()
