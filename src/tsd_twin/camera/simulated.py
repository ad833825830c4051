"""Source of pictures of simulated robots: their true poses on the bus, drawn by a camera."""

from __future__ import annotations

import contextlib
import logging
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from tsd_twin import robots
from tsd_twin.bus import Bus
from tsd_twin.camera.board import Board
from tsd_twin.camera.bodies import FALLBACK_HEIGHT_M, FALLBACK_RADIUS_M, robot_solids
from tsd_twin.camera.detect import Gray
from tsd_twin.camera.lens import LENS_PARAMETERS, CameraPlace, Lens, View, rotation_matrix
from tsd_twin.camera.render import Body, SimulatedCamera, Solid, cylinder, exposure_poses
from tsd_twin.camera.sources import CameraFrame
from tsd_twin.camera.tags import Tag
from tsd_twin.errors import BusError, NoAnswerError, TwinError
from tsd_twin.lie import SE2, Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import decode_odometry
from tsd_twin.messages.errors import MessageError
from tsd_twin.messages.services import Description, decode_request
from tsd_twin.messages.topics import Service

_LOG = logging.getLogger(__name__)

_MEMORY_S = 1.0
"""Memory of true poses; a robot without newer ones disappears from the picture."""
_MOST_AHEAD_S = 0.1
"""Longest extrapolation beyond the latest pose; the robot is then drawn at rest."""
_DEPTH = 512
_PATIENCE, _PAUSE_S = 10, 0.3
"""Attempts to get the description of a robot, and the pause between them."""


@dataclass(slots=True)
class _Truth:
    """True poses of a robot, with their wall-clock time."""

    poses: deque[tuple[int, SE2]] = field(default_factory=lambda: deque(maxlen=128))

    def at(self, stamp_ns: int) -> SE2 | None:
        """Return the pose at a time, interpolated along the motion; None if it is unknown."""
        if not self.poses or self.poses[-1][0] < stamp_ns - _MEMORY_S * 1e9:
            return None
        known = list(self.poses)
        after = next((i for i, (t_ns, _) in enumerate(known) if t_ns >= stamp_ns), None)
        if after == 0:
            return None
        if after is None:
            return _ahead(known, stamp_ns)
        (from_ns, before), (to_ns, pose) = known[after - 1], known[after]
        share = (stamp_ns - from_ns) / (to_ns - from_ns)
        return before @ SE2.exp(share * (before.inverse() @ pose).log())


def _ahead(known: list[tuple[int, SE2]], stamp_ns: int) -> SE2:
    """Continue the latest motion, for at most 0.1 s."""
    last_ns, last = known[-1]
    if len(known) < 2:
        return last
    from_ns, before = known[-2]
    ahead_ns = min(stamp_ns - last_ns, _MOST_AHEAD_S * 1e9)
    return last @ SE2.exp(ahead_ns / (last_ns - from_ns) * (before.inverse() @ last).log())


class SimulatedSource:
    """Pictures of all simulated robots on a bus, at the rate and with the delay of a sensor."""

    def __init__(
        self,
        bus: Bus,
        camera: SimulatedCamera,
        tags: Sequence[Tag],
        clock_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        """`tags` are those on robots; robots without one are drawn as well."""
        self._bus, self._camera, self._tags = bus, camera, tags
        self._clock_ns = clock_ns
        self._truths: dict[str, _Truth] = {}
        self._bodies: dict[str, Body] = {}
        self._samples = bus.subscriber(topics.TRUTH.key("*"), _DEPTH)
        self._period_ns = round(1e9 / camera.sensor.rate_hz)
        self._next_ns = clock_ns()

    def read(self, timeout_s: float) -> CameraFrame | None:
        """Return the next picture once its delay has passed, or None after the timeout."""
        sensor = self._camera.sensor
        ready_ns = self._next_ns + round(sensor.delay_s * 1e9)
        wait_s = (ready_ns - self._clock_ns()) * 1e-9
        time.sleep(max(0.0, min(wait_s, timeout_s)))
        if wait_s > timeout_s:
            return None
        self._take_samples()
        stamp_ns = self._next_ns
        # Pictures that are late already are skipped.
        late = max(0, (self._clock_ns() - ready_ns) // self._period_ns)
        self._next_ns += (1 + late) * self._period_ns
        return CameraFrame(self._draw(stamp_ns), stamp_ns)

    def close(self) -> None:
        """Stop listening."""
        self._samples.close()

    def truth(self, robot: str, stamp_ns: int) -> SE2 | None:
        """Return the true pose of a robot at a time in the last second, or None."""
        known = self._truths.get(robot)
        return None if known is None else known.at(stamp_ns)

    def _draw(self, stamp_ns: int) -> Gray:
        half_ns = round(0.5e9 * self._camera.sensor.exposure_s)
        shown: list[tuple[Body, Array]] = []
        for robot, truth in self._truths.items():
            before, after = truth.at(stamp_ns - half_ns), truth.at(stamp_ns + half_ns)
            if before is not None and after is not None:
                shown.append((self._body(robot), exposure_poses(before, after)))
        return self._camera.draw(shown)

    def _take_samples(self) -> None:
        for sample in self._samples.take_samples():
            try:
                robot, message = topics.robot_of(sample.key), decode_odometry(sample.payload)
            except (BusError, MessageError):
                continue
            if not np.isfinite(message.xy_heading).all():
                continue
            poses = self._truths.setdefault(robot, _Truth()).poses
            if not poses or message.stamp_ns > poses[-1][0]:
                poses.append((message.stamp_ns, SE2(message.xy_heading)))

    def _body(self, robot: str) -> Body:
        if robot not in self._bodies:
            tags = [tag for tag in self._tags if tag.robot == robot]
            self._bodies[robot] = Body(described_solids(self._bus, robot), tags)
        return self._bodies[robot]


def described_solids(bus: Bus, robot: str) -> list[Solid]:
    """Return the parts of a robot on the bus; a robot without a description is a cylinder."""
    try:
        answer = _answer(bus, Service.DESC.key(robot))
        description = decode_request(answer, Description)
        return robot_solids(robots.parse_description(description.robot, robot))
    except TwinError as error:
        _LOG.warning("%s is drawn as a cylinder: %s", robot, error)
        return [cylinder(FALLBACK_RADIUS_M, FALLBACK_HEIGHT_M)]


def _answer(bus: Bus, key: str) -> bytes:
    """Query a service that may just have started.

    Raises:
        BusError: If nobody answers.
    """
    for _ in range(_PATIENCE):
        with contextlib.suppress(NoAnswerError):
            return bus.query(key, b"")
        time.sleep(_PAUSE_S)
    return bus.query(key, b"")


FLOOR_TAGS = 100
"""Number of the first tag on the floor of the simulated camera."""
_SPOTS = np.array([[-0.6, -0.5], [0.6, -0.5], [0.6, 0.5], [-0.6, 0.5], [0.0, 0.6], [0.0, -0.6]])
"""Tags on the floor, relative to half of the width and height of the picture, from its middle."""
_LENS_SPREAD = np.array([8.0, 8.0, 8.0, 8.0, 0.03, 0.01, 0.0005, 0.0005])
"""Standard deviations of a webcam's lens around the ideal one (assumed)."""
_DISTORTION = np.array([0.0, 0.0, 0.0, 0.0, -0.08, 0.02, 0.0, 0.0])


def random_view(
    size: tuple[int, int], across_deg: float, height_m: float, random: np.random.Generator
) -> View:
    """Return a webcam on a ceiling, with a distorted lens, and not exactly straight down."""
    ideal = Lens.ideal(*size, across_deg)
    spread = _LENS_SPREAD * random.standard_normal(LENS_PARAMETERS)
    spread[1] = spread[0]  # Pixels are square.
    lens = Lens(*size, ideal.parameters + _DISTORTION + spread)
    position = np.array([*random.normal(0.0, 0.1, 2), height_m])
    return View(lens, CameraPlace.looking_at(position, np.array([*random.normal(0, 0.1, 2), 0.0])))


def floor_tags(view: View, size_m: float, random: np.random.Generator) -> tuple[Tag, ...]:
    """Return six tags on the floor in view, at any heading."""
    half = 0.5 * np.array([view.lens.width, view.lens.height])
    places = view.on_plane(half * (1.0 + _SPOTS * [1.0, -1.0])).tolist()
    return tuple(
        Tag(FLOOR_TAGS + i, size_m, x_m=x, y_m=y, heading_rad=float(random.uniform(-3.0, 3.0)))
        for i, (x, y) in enumerate(places)
    )


def board_pictures(
    camera: SimulatedCamera, board: Board, count: int, random: np.random.Generator
) -> Iterator[Gray]:
    """Yield pictures of a board held in front of a camera, in any pose that fills a part of it."""
    texture, scale = board.picture()
    lens = camera.view.lens
    half = np.array([lens.width, lens.height]) / (2.0 * lens.parameters[0])
    for _ in range(count):
        away_m = random.uniform(0.3, 0.6)
        aside = 0.55 * away_m * half * random.uniform(-1.0, 1.0, 2)
        slant = np.array([*random.normal(0.0, 0.45, 2), random.normal(0.0, 0.3)])
        turn = rotation_matrix(slant) @ np.diag([1.0, -1.0, -1.0])
        axes = np.column_stack([turn[:, 0], turn[:, 1], [*aside, away_m]])
        yield camera.draw_sheet(texture, scale, axes)
