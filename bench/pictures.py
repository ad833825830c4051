"""Age of a camera's picture on the screen, by a time stamp in its pixels, and its cost to commands.

`python -m bench.pictures camera ENDPOINT` publishes stamped pictures as `tsd-camera` does;
`python -m bench.pictures bare` sends the same pictures over a bare WebSocket, one per request.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from http import HTTPStatus

import cv2
import numpy as np
from playwright.sync_api import Page
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from bench.page import opened
from bench.peers import ready
from bench.programs import dashboard, mock, program, python, tool, until
from bench.table import Row, Run, percentile
from tsd_twin.bus import Bus, as_client, client_config
from tsd_twin.camera.lens import Lens
from tsd_twin.camera.publisher import CameraPublisher, encode_jpeg
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.sources import CameraFrame
from tsd_twin.messages.pictures import CameraName

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
_PATIENCE_MS = 60_000.0

WATCH = f"""
window.ages = [];
window.samples = [];
window.trips = [];
window.stampMs = 0;
window.reads = true;
const wall = () => performance.timeOrigin + performance.now();
const draw = CanvasRenderingContext2D.prototype.drawImage;
CanvasRenderingContext2D.prototype.drawImage = function (...drawn) {{
  draw.apply(this, drawn);
  const {{ width, height }} = this.canvas;
  if (!window.reads || !(drawn[0] instanceof ImageBitmap) || width < 200) return;
  const px = width * {_BLOCK_PX / SIZE[0]};
  const {{ data }} = this.getImageData(0, 0, width, Math.ceil(2 * px));
  let ms = 0;
  for (let bit = 0; bit < {_BITS}; bit += 1) {{
    const x = Math.floor((bit % {_COLUMNS} + 0.5) * px);
    const y = Math.floor((Math.floor(bit / {_COLUMNS}) + 0.5) * px);
    ms = 2 * ms + (data[4 * (y * width + x)] > 127 ? 1 : 0);
  }}
  window.stampMs = ms + Math.floor(wall() / 2 ** {_BITS}) * 2 ** {_BITS};
  window.widthPx = width;
  requestAnimationFrame(() => window.ages.push(wall() - window.stampMs));
}};
setInterval(() => window.stampMs && window.samples.push(wall() - window.stampMs), 20);
const Plain = WebSocket;
window.WebSocket = class extends Plain {{
  constructor(...words) {{
    super(...words);
    if (!String(words[0]).includes("teleop")) return;
    const sent = new Map();
    const send = this.send.bind(this);
    this.send = (text) => {{
      const message = JSON.parse(text);
      if (message.t === "heartbeat") sent.set(message.sent_ms ?? text, performance.now());
      send(text);
    }};
    this.addEventListener("message", ({{ data }}) => {{
      const message = JSON.parse(data);
      const atMs = message.t === "heartbeat" && sent.get(message.sent_ms ?? data);
      if (atMs) window.trips.push(performance.now() - atMs);
    }});
  }}
}};
"""
"""Records the age of each picture in the frame after it, and the round trips of heartbeats."""
BARE = """() => {
  const canvas = document.body.appendChild(document.createElement("canvas"));
  const socket = new WebSocket(location.href.replace("http", "ws"));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send("");
  socket.onmessage = async ({ data }) => {
    const bitmap = await createImageBitmap(new Blob([data], { type: "image/jpeg" }));
    socket.send("");
    Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
    canvas.getContext("2d").drawImage(bitmap, 0, 0);
    bitmap.close();
  };
}"""


def rows(run: Run) -> Iterator[Row]:
    """Measure the pane and a bare WebSocket in turn, then the pane over a thin and lossy link."""
    seconds = run.pick(6.0, 1.5)
    with ExitStack() as stack:
        endpoint = stack.enter_context(mock())
        stack.enter_context(program(python("bench.pictures", "camera", endpoint)))
        url = stack.enter_context(dashboard(endpoint))
        bare = stack.enter_context(program(python("bench.pictures", "bare")))
        page = opened(stack)
        page.add_init_script(WATCH)

        def ages(address: str, *, is_bare: bool) -> tuple[float, float]:
            shown(page, address, run.pick(0.4 * _SETTLED_S, 3.0), seconds, is_bare=is_bare)
            found: list[float] = page.evaluate("ages")
            return percentile(found, 0.5), percentile(found, 0.99)

        yield from run.alternate(
            ["pictures.age_p50", "pictures.age_p99"],
            lambda: ages(url, is_bare=False),
            lambda: ages(bare, is_bare=True),
            rounds=3,
        )
        seconds = run.pick(20.0, 1.5)
        yield from run.alternate(
            ["pictures.command"],
            lambda: [_trip_ms(run, page, url, seconds, pictures=True, reads=False)],
            lambda: [_trip_ms(run, page, url, seconds, pictures=False) + _MORE_MS],
            rounds=3,
        )
        if run.wants("pictures.thin_rate", "pictures.thin_old", "pictures.thin_command"):
            yield from _thin(run, stack, page, endpoint)


def _thin(run: Run, stack: ExitStack, page: Page, endpoint: str) -> Iterator[Row]:
    """Measure over a link between browser and dashboard, which the scene shares."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        near = f"127.0.0.1:{free.getsockname()[1]}"
    url = stack.enter_context(
        dashboard(endpoint, "--allow-host", near, "--viewport-origin", "http://127.0.0.1:1")
    )
    target = url.replace("http://", "tcp/").rstrip("/")
    stack.enter_context(
        tool("tsd_link", "--link", THIN, "--target", target, "--listen", f"tcp/{near}")
    )
    far = f"http://{near}/"
    seconds = run.pick(60.0, 2.0)
    found: dict[str, float] = {}

    def with_pictures() -> tuple[float, float]:
        shown(page, far, run.pick(_SETTLED_S, 3.0), seconds, is_main=True)
        samples: list[float] = page.evaluate("samples")
        found["px"] = page.evaluate("widthPx")
        old = sum(each > OLD_MS for each in samples) / len(samples)
        return page.evaluate("ages.length") / seconds, 100.0 * old

    def trip_ms(*, pictures: bool) -> float:
        return _trip_ms(run, page, far, seconds, pictures=pictures, is_main=pictures, reads=False)

    def note() -> str:
        return f"{found['px']:.0f} px wide, {THIN}" if found else THIN

    page.goto(far)
    page.evaluate("localStorage.setItem('tsd-pictures', 'true')")
    yield from run.alternate(
        ["pictures.thin_rate", "pictures.thin_old"],
        with_pictures,
        lambda: (REQUIRED_HZ, OLD_PERCENT),
        rounds=_THIN_ROUNDS,
        note=note,
    )
    yield from run.alternate(
        ["pictures.thin_command"],
        lambda: [trip_ms(pictures=True)],
        lambda: [trip_ms(pictures=False) + _MORE_THIN_MS],
        rounds=_THIN_ROUNDS,
        note=note,
    )


def _trip_ms(
    run: Run,
    page: Page,
    url: str,
    seconds: float,
    *,
    pictures: bool,
    is_main: bool = False,
    reads: bool = True,
) -> float:
    """Return the 99th percentile of the heartbeats' round trips on the socket of commands."""
    page.goto(url)
    page.evaluate(f"localStorage.setItem('tsd-pictures', '{str(pictures).lower()}')")
    settled_s = run.pick(_SETTLED_S, 3.0)
    shown(page, url, settled_s, seconds, pictures=pictures, is_main=is_main, reads=reads)
    return percentile(page.evaluate("trips"), 0.99)


def shown(
    page: Page,
    url: str,
    settled_s: float,
    seconds: float,
    *,
    pictures: bool = True,
    is_bare: bool = False,
    is_main: bool = False,
    reads: bool = True,
) -> None:
    """Open the page, or the bare one, and record the displayed pictures for `seconds`.

    Without `reads`, their stamps are not read, because that blocks the page's thread.
    """
    page.goto(url)
    if is_bare:
        page.evaluate(BARE)
    if is_main:
        page.get_by_role("button", name="Camera as main view").click(timeout=_PATIENCE_MS)
    if pictures:
        until(lambda: page.evaluate("window.stampMs > 0"), 60.0)
    page.wait_for_timeout(1e3 * settled_s)
    page.evaluate(f"ages.length = samples.length = trips.length = 0; reads = {str(reads).lower()}")
    page.wait_for_timeout(1e3 * seconds)


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


if __name__ == "__main__":
    camera(sys.argv[2]) if sys.argv[1] == "camera" else bare()
