"""Pictures and commands of a page over an emulated link, in virtual time.

Links and budget are the real ones; camera, page and dashboard are reduced to their messages.
`python -m tests.dashboard.pictures.thin_link SECONDS SEEDS LAG_MS [LINK [CODING]]` prints each run.
Programs react to each message after a random time of this mean. CODING is `jpeg`, `h264` or
`chain`: H.264 with one encoder for all WebSockets.
"""

from __future__ import annotations

import heapq
import itertools
import math
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias, cast

import numpy as np

from tsd_twin.dashboard.pictures.link_budget import (
    FORMATS,
    VIDEO_FORMATS,
    LinkBudget,
    PictureFormat,
)
from tsd_twin.link_emulation import LinkSpec
from tsd_twin.link_emulation.channel import LinkChannel
from tsd_twin.link_emulation.link import LinkModel, Segment, Stream
from tsd_twin.link_emulation.relays import SEGMENT_BYTES, TCP_HEADER_BYTES

THIN = "delay=45ms,loss=2%,bandwidth=2Mbit"
OLD_S = 0.3
OWN_BYTES, OWN_WIDTH = 48_000, 1280
SIZES = dict(
    zip(
        FORMATS + VIDEO_FORMATS,
        (48_000, 25_800, 14_100, 10_800, 7_300, 6_100, 3_800, 9_700, 3_600, 2_200, 1_500, 970),
        strict=True,
    )
)
"""Bytes of the pictures of `bench.pictures` in each format; with H.264, the largest mean."""
CAMERA_HZ, STATES_HZ, HEARTBEATS_HZ = 30.0, 20.0, 10.0
STATE_BYTES, HEARTBEAT_BYTES, REQUEST_BYTES = 1500, 90, 70
ARRIVAL_S, ENCODED_S, DECODED_S, FRAME_S = 0.012, 0.006, 0.006, 1.0 / 60.0
SAMPLE_S = 0.02
MAX_SOCKETS, ADD_AFTER_S, MANY_SKIPPED = 8, 2.0, 0.2
SETTLED_S = 20.0

Event: TypeAlias = Callable[[], object]
Wire: TypeAlias = Callable[[int, Event], None]
"""Sends a message of a size over a connection and calls the event at its arrival."""


@dataclass
class _Timer:
    due: Event | None

    def cancel(self) -> None:
        self.due = None


class VirtualLoop:
    """Timers of an event loop in virtual time."""

    def __init__(self) -> None:
        self._timers: list[tuple[float, int, _Timer]] = []
        self._number = itertools.count()
        self._now_s = 0.0

    def time(self) -> float:
        return self._now_s

    def call_at(self, at_s: float, due: Event) -> _Timer:
        timer = _Timer(due)
        heapq.heappush(self._timers, (max(at_s, self._now_s), next(self._number), timer))
        return timer

    def call_later(self, delay_s: float, due: Event) -> _Timer:
        return self.call_at(self._now_s + delay_s, due)

    def every(self, period_s: float, due: Event) -> None:
        """Call at a fixed rate."""
        due()
        self.call_later(period_s, partial(self.every, period_s, due))

    def run(self, until_s: float) -> None:
        while self._timers and self._timers[0][0] <= until_s:
            self._now_s, _, timer = heapq.heappop(self._timers)
            if timer.due is not None:
                timer.due()
        self._now_s = until_s


class Direction:
    """One direction of a link; its connections lose and repeat segments separately."""

    def __init__(self, loop: VirtualLoop, spec: LinkSpec, seed: int) -> None:
        link: LinkModel[Segment[Event | None]] = LinkModel(spec, np.random.default_rng(seed), 0.0)
        self._loop = loop
        self._channel = LinkChannel(
            cast("Any", loop), link, lambda each: each.stream.arrived(each), lambda _: None
        )

    def connection(self) -> Wire:
        stream: Stream[Event | None] = Stream(
            self._channel.link, lambda arrived: arrived and arrived()
        )
        self._channel.resenders.add(stream)

        def send(size: int, arrived: Event) -> None:
            for left in range(size, 0, -SEGMENT_BYTES):
                is_last = left <= SEGMENT_BYTES
                data = min(left, SEGMENT_BYTES) + TCP_HEADER_BYTES
                stream.send(arrived if is_last else None, data, self._loop.time())
            self._channel.step()

        return send


@dataclass
class Outcome:
    """Measurements of the page after `SETTLED_S`."""

    seconds: float
    arrivals_s: list[float] = field(default_factory=list[float])
    widths: list[int] = field(default_factory=list[int])
    ages_s: list[float] = field(default_factory=list[float])
    trips_s: list[float] = field(default_factory=list[float])

    @property
    def rate_hz(self) -> float:
        return len(self.arrivals_s) / self.seconds

    @property
    def old(self) -> float:
        """Fraction of the time with a picture older than `OLD_S`."""
        return float(np.mean(np.array(self.ages_s) > OLD_S))

    @property
    def narrow(self) -> float:
        """Fraction of pictures narrower than 480 pixels."""
        return float(np.mean(np.array(self.widths) < 480))

    @property
    def command_p99_s(self) -> float:
        return float(np.percentile(self.trips_s, 99))


class Page:
    """A page with its dashboard at the other end of a link."""

    def __init__(
        self,
        spec: str,
        seed: int,
        seconds: float,
        *,
        pictures: bool = True,
        lag_s: float = 0.0,
        width: int = 1280,
        video: bool = False,
        in_order: bool = False,
    ) -> None:
        """`in_order`: each picture depends on all before, of which others may be in flight."""
        self.loop, self.lag_s, self.width = VirtualLoop(), lag_s, width
        self.random = np.random.default_rng((seed, 2))
        parsed = LinkSpec.parse(spec)
        self.up, self.down = (Direction(self.loop, parsed, 2 * seed + half) for half in range(2))
        self.budget = LinkBudget()
        self.outcome = Outcome(seconds)
        self._trips: deque[float] = deque(maxlen=50)
        self._newest = self._sent = self._shown = 0
        self._video, self._in_order = video, in_order
        self._flying, self._arrived = set[int](), set[int]()
        self._exposed: dict[int, float] = {}
        self._shown_exposed_s = -math.inf
        self._waiting: deque[int] = deque()
        self._wires: list[tuple[Wire, Wire]] = []
        self._got = self._skipped = self._last = 0
        self._added_s = 0.0
        self._timer: _Timer | None = None
        self._is_encoding = False
        up, down = self.up.connection(), self.down.connection()

        def beat() -> None:
            ended = partial(self._later, partial(self._trip, self.loop.time()))
            answered = partial(self._later, partial(down, HEARTBEAT_BYTES, ended))
            up(HEARTBEAT_BYTES, answered)

        self.loop.every(1.0 / HEARTBEATS_HZ, beat)
        self.loop.every(1.0 / STATES_HZ, lambda: down(STATE_BYTES, lambda: None))
        if pictures:
            self.loop.every(1.0 / CAMERA_HZ, self._expose)
            self._connect()
            self.loop.every(SAMPLE_S, self._sample)

    def run(self) -> Outcome:
        self.loop.run(SETTLED_S + self.outcome.seconds)
        return self.outcome

    @property
    def is_settled(self) -> bool:
        return self.loop.time() >= SETTLED_S

    def _later(self, due: Event, least_s: float = 0.0) -> None:
        lag_s = self.random.exponential(self.lag_s) if self.lag_s else 0.0
        self.loop.call_later(least_s + lag_s, due)

    def _trip(self, began_s: float) -> None:
        trip_s = self.loop.time() - began_s
        self._trips.append(trip_s)
        if self.is_settled:
            self.outcome.trips_s.append(trip_s)

    def _sample(self) -> None:
        if self.is_settled:
            self.outcome.ages_s.append(self.loop.time() - self._shown_exposed_s)

    def _expose(self) -> None:
        exposed_s = self.loop.time()

        def arrive() -> None:
            self._newest += 1
            self._exposed[self._newest] = exposed_s
            self._exposed.pop(self._newest - 300, None)
            self._send()

        self._later(arrive, ARRIVAL_S)

    def _connect(self) -> None:
        self._wires.append((self.up.connection(), self.down.connection()))
        socket = len(self._wires) - 1
        self._ask(socket, lambda: None)

    def _ask(self, socket: int, acknowledge: Event) -> None:
        def asked() -> None:
            acknowledge()
            self._waiting.append(socket)
            self._send()

        self._wires[socket][0](REQUEST_BYTES, lambda: self._later(asked))

    def _send(self) -> None:
        """Send as `Viewer` does."""
        now_s = self.loop.time()
        if not self._waiting or self._newest <= self._sent or self._is_encoding:
            return
        if (waits_s := self.budget.waits_s(now_s)) > 0.0:
            if self._timer is None:

                def due() -> None:
                    self._timer = None
                    self._send()

                self._timer = self.loop.call_later(waits_s + 1e-6, due)
            return
        socket, number = self._waiting.popleft(), self._newest
        self._sent = number
        chosen = self.budget.format_for(OWN_BYTES, OWN_WIDTH, self.width, video=self._video)
        size = self._size(chosen)
        self._is_encoding = True
        self._flying.add(number)
        self._later(partial(self._encoded, socket, number, chosen, size), ENCODED_S)

    def _size(self, chosen: PictureFormat) -> int:
        return round(SIZES[chosen] * self.random.uniform(0.95, 1.05))

    def _encoded(self, socket: int, number: int, chosen: PictureFormat, size: int) -> None:
        self._is_encoding = False
        now_s = self.loop.time()
        if not chosen.is_video:
            self.budget.encoded(chosen, OWN_BYTES, size)
        self.budget.sent(size, now_s)
        width = OWN_WIDTH * chosen.eighths // 8
        taken = partial(self._take, socket, number, size, now_s, width)
        arrived = partial(self._later, taken)
        self._wires[socket][1](size, arrived)
        self._send()

    def _take(self, socket: int, number: int, size: int, sent_s: float, width: int) -> None:
        self._count(number)

        def acknowledge() -> None:
            took_s = self.loop.time() - sent_s - DECODED_S
            rtt_s = min(self._trips, default=0.0)
            self.budget.add(size, took_s, rtt_s, self.loop.time())

        def decoded() -> None:
            self._ask(socket, acknowledge)
            self._flying.discard(number)
            self._arrived.add(number)
            complete = min(self._flying, default=math.inf) if self._in_order else math.inf
            latest = max((each for each in self._arrived if each < complete), default=0)
            if latest > self._shown:
                self._shown = latest
                self._arrived = {each for each in self._arrived if each > latest}
                due_s = math.ceil(self.loop.time() / FRAME_S) * FRAME_S
                self.loop.call_at(due_s, partial(self._show, self._exposed[latest], width))

        self.loop.call_later(DECODED_S, decoded)

    def _show(self, exposed_s: float, width: int) -> None:
        self._shown_exposed_s = max(self._shown_exposed_s, exposed_s)
        if self.is_settled:
            self.outcome.arrivals_s.append(self.loop.time())
            self.outcome.widths.append(width)

    def _count(self, number: int) -> None:
        """Open another socket as `PictureFeed` does."""
        now_s = self.loop.time()
        self._got += 1
        if 0 < self._last < number:
            self._skipped += number - self._last - 1
        self._last = max(self._last, number)
        if now_s - self._added_s < ADD_AFTER_S:
            return
        is_stalled = self._skipped > MANY_SKIPPED * (self._got + self._skipped)
        if is_stalled and len(self._wires) < MAX_SOCKETS:
            self._connect()
        self._added_s, self._got, self._skipped = now_s, 0, 0


def added_ms(spec: str, seed: int, seconds: float) -> float:
    """Return the increase of the 99th percentile of the commands' round trips by pictures."""
    both = [Page(spec, seed, seconds, pictures=pictures).run() for pictures in (True, False)]
    return 1e3 * (both[0].command_p99_s - both[1].command_p99_s)


def main() -> None:
    """Print each run."""
    seconds, seeds = float(sys.argv[1]), int(sys.argv[2])
    lag_s = 1e-3 * float(sys.argv[3])
    spec = sys.argv[4] if len(sys.argv) > 4 else THIN
    coding = sys.argv[5] if len(sys.argv) > 5 else "jpeg"
    video, in_order = coding != "jpeg", coding == "chain"
    for seed in range(seeds):
        seen = Page(spec, seed, seconds, lag_s=lag_s, video=video, in_order=in_order).run()
        alone = Page(spec, seed, seconds, lag_s=lag_s, pictures=False).run()
        trips = [1e3 * np.percentile(each.trips_s, [50, 90, 99]) for each in (seen, alone)]
        sys.stdout.write(
            f"{seed}: {seen.rate_hz:.1f} Hz, {np.mean(seen.widths):.0f} px wide, "
            f"{1e3 * np.median(seen.ages_s):.0f} ms old, {100 * seen.old:.2f} % of the time over "
            f"{1e3 * OLD_S:.0f}; commands {trips[0].round()}, without {trips[1].round()} ms\n"
        )


if __name__ == "__main__":
    main()
