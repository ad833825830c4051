"""Load generator of ten viewers that flood the dashboard.

`python -m attack.flooder PORT SECONDS COOKIE [COOKIE ...]`: each cookie is one viewer, with a
socket that sends as fast as the gateway accepts, and reconnects after each disconnection. Prints
the number of disconnections and of frames sent.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import sys
import threading
import time
from collections import Counter

from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Frame, Opcode
from websockets.sync.client import connect

FRAMES = 200
"""Frames sent per call."""
FLOODS: tuple[tuple[Opcode, bytes], ...] = (
    (Opcode.TEXT, b'{"t":"clear_plan"}'),
    (Opcode.TEXT, b'{"t":"clear_plan"}'),
    (Opcode.CONT, b""),
    (Opcode.TEXT, b'{"t":"heartbeat","status_seq":0,"sent_ms":1.0,"focus":true}'),
    (Opcode.TEXT, b'{"t":"robot","id":"unknown"}'),
    (Opcode.TEXT, b'{"t":"drive","vx":1,"vy":0,"omega":0,"status_seq":0}'),
    (Opcode.TEXT, b'{"t":"lease","op":"acquire"}'),
    (Opcode.TEXT, b"[" * 2000),
    (Opcode.TEXT, b'{"t":"plan","kind":"to","points":[[0.5,0.5]],"on":"picture"}'),
    (Opcode.PING, b"x"),
)
"""One message type per viewer; or fragments of a message that never ends."""


def flood(port: int, cookie: str, number: int, end_s: float, counts: Counter[str]) -> None:
    """Send until `end_s`."""
    opcode, payload = FLOODS[number % len(FLOODS)]
    fragments = opcode is Opcode.CONT
    begin = Frame(Opcode.TEXT, b"", fin=False).serialize(mask=True) if fragments else b""
    blob = Frame(opcode, payload, fin=not fragments).serialize(mask=True) * FRAMES
    while time.monotonic() < end_s:
        try:
            with connect(
                f"ws://127.0.0.1:{port}/teleop?page={secrets.token_hex(8)}",
                additional_headers={"Cookie": cookie},
                compression=None,
                ping_interval=None,
                close_timeout=0.1,
            ) as socket:
                counts["sockets"] += 1
                raw = socket.socket
                raw.settimeout(1.0)
                raw.sendall(begin)
                while time.monotonic() < end_s:
                    raw.sendall(blob)
                    counts["frames"] += FRAMES
                raw.close()
        except InvalidStatus as refusal:
            counts[f"status {refusal.response.status_code}"] += 1
        except (OSError, ConnectionClosed, TimeoutError):
            counts["cut off"] += 1


def main(port: int, seconds: float, cookies: list[str]) -> None:
    """Flood with all viewers simultaneously."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # Disconnections are expected.
    os.nice(19)  # Low priority, because they represent other machines without load on this one.
    counts: Counter[str] = Counter()
    end_s = time.monotonic() + seconds
    threads = [
        threading.Thread(target=flood, args=(port, cookie, number, end_s, counts))
        for number, cookie in enumerate(cookies)
    ]
    for thread in threads:
        thread.start()
    sys.stdout.write("flooding\n")
    sys.stdout.flush()
    for thread in threads:
        thread.join()
    sys.stdout.write(json.dumps(counts) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3:])
