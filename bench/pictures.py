"""Age of a camera's picture on the screen, by a time stamp in its pixels, and its cost to commands.

`python -m bench.pictures camera ENDPOINT` publishes stamped pictures as `tsd-camera` does;
`python -m bench.pictures bare` sends the same pictures over a bare WebSocket, one per request;
`python -m bench.pictures commands ENDPOINT` records when commands arrive on the bus.

Robot, dashboard, link and the programs in their places run as on machines of their own. Otherwise
the browser, which draws in software here, would delay commands with and without pictures.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import math
import re
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from http import HTTPStatus

import cv2
import numpy as np
from playwright.sync_api import Error, Locator, Page
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from bench.page import opened
from bench.peers import ready
from bench.programs import counter, dashboard, mock, program, python, realtime, tool, until
from bench.table import Row, Run, percentile
from tsd_twin.bus import Bus, as_client, client_config
from tsd_twin.camera.lens import Lens
from tsd_twin.camera.publisher import CameraPublisher, encode_jpeg
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.sources import CameraFrame
from tsd_twin.messages import topics
from tsd_twin.messages.commands import decode_command
from tsd_twin.messages.pictures import CameraName
from tsd_twin.messages.topics import Sample

SIZE = 1280, 720
RATE_HZ = 30.0
THIN = "delay=45ms,loss=2%,bandwidth=2Mbit"
REQUIRED_HZ = 15.0
OLD_MS, OLD_PERCENT = 300.0, 1.0
_MORE_MS, _MORE_THIN_MS = 5.0, 30.0
"""Delay of commands that pictures may add, on a good link and on `THIN`."""
_QUALITY = 80
_BITS, _COLUMNS, _BLOCK_PX = 40, 20, 64
_ACROSS_DEG = 62.0
_NOISE = 3
_SETTLED_S = 20.0
_THIN_ROUNDS = 3
"""Minutes with pictures over the thin link, and minutes with and without for commands."""
_CONNECT_S = 10.0
_STEP_RADPS = 1e-5
"""Turn rate per number of a command."""
_HELD_S, _PAUSE_S = 2.0, 0.5
"""Time for which a key is held, and between holds."""
_PATIENCE_MS = 60_000.0

WATCH = f"""
window.frames = 0;
window.pictures = [];
window.commands = [];
window.reads = true;
const wall = () => performance.timeOrigin + performance.now();
const pen = new OffscreenCanvas(1, 1).getContext("2d", {{ willReadFrequently: true }});
/** Return the stamp in the upper edge of a picture, whose pixels are `step` bytes apart. */
function stampMs(data, step, stride, px) {{
  let ms = 0;
  for (let bit = 0; bit < {_BITS}; bit += 1) {{
    const x = Math.floor((bit % {_COLUMNS} + 0.5) * px);
    const y = Math.floor((Math.floor(bit / {_COLUMNS}) + 0.5) * px);
    ms = 2 * ms + (data[y * stride + step * x] > 127 ? 1 : 0);
  }}
  return ms + Math.floor(wall() / 2 ** {_BITS}) * 2 ** {_BITS};
}}
async function ofFrame(frame, px) {{
  const rect = {{ x: 0, y: 0, width: frame.displayWidth, height: 2 * Math.ceil(px) }};
  const data = new Uint8Array(frame.allocationSize({{ rect }}));
  const [{{ offset, stride }}] = await frame.copyTo(data, {{ rect }});
  frame.close();
  return stampMs(data.subarray(offset), 1, stride, px);
}}
function ofBitmap(bitmap, px) {{
  const [width, height] = [bitmap.width, 2 * Math.ceil(px)];
  Object.assign(pen.canvas, {{ width, height }});
  pen.drawImage(bitmap, 0, 0);
  return stampMs(pen.getImageData(0, 0, width, height).data, 4, 4 * width, px);
}}
const stamps = new WeakMap();
const create = window.createImageBitmap;
window.createImageBitmap = async (from) => {{
  const frame = from instanceof window.VideoFrame ? from.clone() : null;
  const bitmap = await create(from);
  const px = bitmap.width * {_BLOCK_PX / SIZE[0]};
  if (reads) stamps.set(bitmap, frame ? ofFrame(frame, px) : ofBitmap(bitmap, px));
  else frame?.close();
  return bitmap;
}};
let next = null;
const show = ImageBitmapRenderingContext.prototype.transferFromImageBitmap;
ImageBitmapRenderingContext.prototype.transferFromImageBitmap = function (bitmap) {{
  if (next === null)
    requestAnimationFrame(async () => {{
      const [shown, shownMs] = [next, wall()];
      next = null;
      window.frames += 1;
      if (reads) pictures.push([shownMs, await shown.stamp, shown.width]);
    }});
  next = {{ stamp: stamps.get(bitmap), width: bitmap.width }};
  show.call(this, bitmap);
}};
const Plain = WebSocket;
window.WebSocket = class extends Plain {{
  constructor(...words) {{
    super(...words);
    if (!String(words[0]).includes("teleop")) return;
    const send = this.send.bind(this);
    this.send = (text) => {{
      const message = JSON.parse(text);
      if (message.t !== "drive") return send(text);
      window.commands.push([message.number, wall()]);
      const omega = {_STEP_RADPS} * message.number;
      send(JSON.stringify({{ ...message, vx: 0, vy: 0, omega }}));
    }};
  }}
}};
"""
"""Counts frames that show a new picture, and records the time of each and the stamp in ms, and the
width in pixels. Numbers commands by their turn rate.

A stamp is read before the GPU's process has the picture: reading from there holds the scene up.
"""
BARE = """() => {
  const canvas = document.body.appendChild(document.createElement("canvas"));
  const socket = new WebSocket(location.href.replace("http", "ws"));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send("");
  socket.onmessage = async ({ data }) => {
    const bitmap = await createImageBitmap(new Blob([data], { type: "image/jpeg" }));
    socket.send("");
    canvas.getContext("bitmaprenderer").transferFromImageBitmap(bitmap);
  };
}"""


def rows(run: Run) -> Iterator[Row]:
    """Measure the pane and a bare WebSocket in turn, then the pane over a thin and lossy link."""
    seconds = run.pick(6.0, 1.5)
    with ExitStack() as stack:
        with realtime():
            endpoint = stack.enter_context(mock())
            url = stack.enter_context(dashboard(endpoint))
            bare = stack.enter_context(program(python("bench.pictures", "bare")))
            arrivals = counter(python("bench.pictures", "commands", endpoint))
            stack.enter_context(arrivals)
        stack.enter_context(program(python("bench.pictures", "camera", endpoint)))
        page = opened(stack)
        page.add_init_script(WATCH)

        def ages(address: str, *, is_bare: bool) -> tuple[float, float]:
            found = shown(page, address, run.pick(0.4 * _SETTLED_S, 3.0), seconds, is_bare=is_bare)
            return percentile(found.ages_ms, 0.5), percentile(found.ages_ms, 0.99)

        yield from run.alternate(
            ["pictures.age_p50", "pictures.age_p99"],
            lambda: ages(url, is_bare=False),
            lambda: ages(bare, is_bare=True),
            rounds=3,
        )
        seconds = run.pick(20.0, 1.5)
        if run.wants("pictures.command"):
            yield from _commands(run, page, url, arrivals, "pictures.command", _MORE_MS, seconds)
        if run.wants("pictures.thin_rate", "pictures.thin_old", "pictures.thin_command"):
            yield from _thin(run, stack, page, endpoint, arrivals)


def _thin(
    run: Run, stack: ExitStack, page: Page, endpoint: str, arrivals: counter
) -> Iterator[Row]:
    """Measure over a link between browser and dashboard, which the scene shares."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        near = f"127.0.0.1:{free.getsockname()[1]}"
    with realtime():
        url = stack.enter_context(
            dashboard(endpoint, "--allow-host", near, "--viewport-origin", "http://127.0.0.1:1")
        )
        target = url.replace("http://", "tcp/").rstrip("/")
        stack.enter_context(
            tool("tsd_link", "--link", THIN, "--target", target, "--listen", f"tcp/{near}")
        )
    far = f"http://{near}/"
    seconds = run.pick(60.0, 2.0)
    widths_px: list[float] = []

    def with_pictures() -> tuple[float, float]:
        found = shown(page, far, run.pick(_SETTLED_S, 3.0), seconds, is_main=True)
        widths_px.append(found.width_px)
        return found.frames / seconds, 100.0 * found.older_than(OLD_MS)

    def note() -> str:
        return f"{min(widths_px, default=0):.0f} px wide, {THIN}"

    page.goto(far)
    page.evaluate("localStorage.setItem('tsd-pictures', 'true')")
    yield from run.alternate(
        ["pictures.thin_rate", "pictures.thin_old"],
        with_pictures,
        lambda: (REQUIRED_HZ, OLD_PERCENT),
        rounds=_THIN_ROUNDS,
        note=note,
    )
    name = "pictures.thin_command"
    if run.wants(name):
        yield from _commands(run, page, far, arrivals, name, _MORE_THIN_MS, seconds, is_main=True)


def _commands(
    run: Run,
    page: Page,
    url: str,
    arrivals: counter,
    name: str,
    more_ms: float,
    seconds: float,
    *,
    is_main: bool = False,
) -> Iterator[Row]:
    """Drive by a page that stays in control, in turn with and without pictures."""
    sent_hz: dict[bool, list[float]] = {True: [], False: []}
    shown(page, url, 0.0, 0.0)
    page.evaluate("reads = false")  # Reading stamps blocks the page's thread.
    settled_s = run.pick(_SETTLED_S, 1.0)

    def drive() -> None:
        _drive(page, seconds)
        page.wait_for_timeout(1e3 * _HELD_S)  # Commands may still be in transit.

    def command_ms(*, pictures: bool) -> float:
        pane = page.get_by_role("region", name="Camera", exact=True)
        if pictures != pane.is_visible():
            within = pane if pane.is_visible() else page
            label = "Camera" if pictures else "Close the picture"
            within.get_by_role("button", name=label, exact=True).click(timeout=_PATIENCE_MS)
        if pictures and is_main:
            page.get_by_role("button", name="Camera as main view").click(timeout=_PATIENCE_MS)
        _drive(page, settled_s)
        page.evaluate("commands.length = 0")
        found = arrivals.during(drive)
        times_ms, numbers = np.array(found["times_ms"]), np.array(found["numbers"])
        sent: list[tuple[int, float]] = page.evaluate("commands")
        sent_hz[pictures].append(len(sent) / (_HELD_S * _holds(seconds)))
        delays = [
            float(times_ms[later][0] - sent_ms)
            for number, sent_ms in sent
            if (later := (times_ms >= sent_ms) & (numbers >= number)).any()
        ]
        return percentile(delays, 0.99)

    yield from run.alternate(
        [name],
        lambda: [command_ms(pictures=True)],
        lambda: [command_ms(pictures=False) + more_ms],
        rounds=_THIN_ROUNDS,
        note=lambda: (
            f"{min(sent_hz[True]):.0f} commands a second sent, without {min(sent_hz[False]):.0f}"
        ),
    )
    page.goto("about:blank")


def _drive(page: Page, seconds: float) -> None:
    """Turn in place for `seconds`, with pauses; arm the robot again if the link was lost."""
    ready = page.get_by_role("status", name="Mode").get_by_text("Ready")
    steps = page.get_by_role("button", name=re.compile("^(Take control|Arm)$"))
    for _ in range(_holds(seconds)):
        until(lambda: _step(ready, steps), _PATIENCE_MS / 1000)
        page.keyboard.down("q")
        page.wait_for_timeout(1e3 * _HELD_S)
        page.keyboard.up("q")
        page.wait_for_timeout(1e3 * _PAUSE_S)


def _holds(seconds: float) -> int:
    return max(1, round(seconds / (_HELD_S + _PAUSE_S)))


def _step(ready: Locator, steps: Locator) -> bool:
    """Return whether the robot is ready and controlled here; click the next step if not."""
    for step in steps.all():
        with contextlib.suppress(Error):  # It may have changed.
            step.click(timeout=1000.0)
    return ready.is_visible() and not steps.all()


class Shown:
    """Pictures that a page has shown."""

    def __init__(self, frames: int, pictures: Sequence[tuple[float, float, float]]) -> None:
        """`pictures` has the time of a frame and the stamp, in ms, and the width in pixels."""
        self.frames = frames
        self._shown_ms, self._stamps_ms, widths_px = np.array(pictures).T
        self.width_px = float(widths_px[-1])

    @property
    def ages_ms(self) -> list[float]:
        """Ages of all pictures when they are shown."""
        return (self._shown_ms - self._stamps_ms).tolist()

    def older_than(self, limit_ms: float) -> float:
        """Return the fraction of the time in which the shown picture is older."""
        until_ms = self._shown_ms[1:]
        old_ms = np.minimum(until_ms - self._stamps_ms[:-1] - limit_ms, np.diff(self._shown_ms))
        return float(np.maximum(old_ms, 0.0).sum() / np.diff(self._shown_ms).sum())


def shown(
    page: Page,
    url: str,
    settled_s: float,
    seconds: float,
    *,
    is_bare: bool = False,
    is_main: bool = False,
) -> Shown:
    """Open the page, or the bare one, and return the pictures that it shows in `seconds`."""
    page.goto(url)
    if is_bare:
        page.evaluate(BARE)
    if is_main:
        page.get_by_role("button", name="Camera as main view").click(timeout=_PATIENCE_MS)
    until(lambda: page.evaluate("pictures.length > 0"), 60.0)
    page.wait_for_timeout(1e3 * settled_s)
    page.evaluate("pictures.splice(0, pictures.length - 1); frames = 0")
    page.wait_for_timeout(1e3 * seconds)
    return Shown(*page.evaluate("[frames, pictures]"))


class StampedPictures:
    """Moving noise the size of a webcam picture, with the time encoded in black and white."""

    def __init__(self) -> None:
        random = np.random.default_rng(0)
        width, height = SIZE
        coarse = random.integers(40, 215, (height // 80, 2 * width // 80, 3), np.uint8)
        size = 2 * width, height
        smooth = np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC), np.uint8)
        noise = random.integers(-_NOISE, _NOISE + 1, smooth.shape, np.int16)
        self._ground = np.clip(noise + smooth, 0, 255).astype(np.uint8)
        self._number = itertools.count()

    def next(self) -> CameraFrame:
        """Return a picture that is exposed now."""
        width, height = SIZE
        left = 4 * next(self._number) % width
        picture = self._ground[:height, left : left + width].copy()
        stamp_ns = time.time_ns()
        stamp = stamp_ns // 1_000_000
        bits = [(stamp >> (_BITS - 1 - i)) & 1 for i in range(_BITS)]
        blocks = np.array(bits, np.uint8).reshape(-1, _COLUMNS) * 255
        stamped = np.kron(blocks, np.ones((_BLOCK_PX, _BLOCK_PX), np.uint8))
        picture[: stamped.shape[0], : stamped.shape[1]] = stamped[:, :, None]
        return CameraFrame(picture, stamp_ns)


def camera(endpoint: str) -> None:
    """Publish stamped pictures on the bus."""
    pictures = StampedPictures()
    with Bus(as_client(client_config([endpoint]), _CONNECT_S)) as bus:
        setup = CameraSetup(Lens.ideal(*SIZE, _ACROSS_DEG))
        publisher = CameraPublisher(bus, bus, CameraName("stamped"), setup)

        def run() -> None:
            next_s = time.monotonic()
            while True:
                publisher.publish(pictures.next(), None, time.monotonic())
                next_s += 1.0 / RATE_HZ
                time.sleep(max(0.0, next_s - time.monotonic()))

        threading.Thread(target=run, daemon=True).start()
        ready(endpoint)


def bare() -> None:
    """Send stamped pictures over a WebSocket, one per request."""
    pictures = StampedPictures()
    newest: list[bytes] = [b""]
    came = asyncio.Event()

    async def answer(page: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            async for _ in page:
                await came.wait()
                await page.send(newest[0])

    def blank(connection: ServerConnection, request: Request) -> Response | None:
        return None if "Upgrade" in request.headers else connection.respond(HTTPStatus.OK, "")

    async def main() -> None:
        async with serve(answer, "127.0.0.1", 0, compression=None, process_request=blank) as server:
            port = server.sockets[0].getsockname()[1]
            ending = asyncio.create_task(asyncio.to_thread(ready, f"http://127.0.0.1:{port}"))
            while not ending.done():
                newest[0] = encode_jpeg(pictures.next().picture, _QUALITY)
                came.set()
                await asyncio.sleep(0)
                came.clear()
                await asyncio.sleep(1.0 / RATE_HZ)

    asyncio.run(main())


def commands(endpoint: str) -> None:
    """Record when commands arrive on the bus, and their numbers; a release has the highest.

    Records from one line of the standard input to the next, and prints JSON.
    """
    times_ms: list[float] = []
    numbers: list[float] = []

    def note(sample: Sample) -> None:
        turn_rate = decode_command(sample).twist[-1]
        times_ms.append(1e3 * time.time())
        numbers.append(round(turn_rate / _STEP_RADPS) if turn_rate else math.inf)

    with Bus(as_client(client_config([endpoint]), _CONNECT_S)) as bus:
        bus.subscribe(topics.TWIST.key("*"), note)
        print(f"ready: {endpoint}", flush=True)
        while sys.stdin.readline():
            times_ms.clear()
            numbers.clear()
            sys.stdin.readline()
            print(json.dumps({"times_ms": times_ms, "numbers": numbers}), flush=True)


if __name__ == "__main__":
    {"camera": camera, "bare": bare, "commands": commands}[sys.argv[1]](*sys.argv[2:])
