"""Sizes, quality and CPU time of H.264 and JPEG, without links and pages.

`python -m tests.dashboard.pictures.h264_sizes [SOCKETS]` prints them for the stamped pictures of
`bench.pictures`, a moving ground, and for three driving robots under a simulated camera.
"""

from __future__ import annotations

import sys
import time

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from bench.camera import PERIOD_S, driving_robots
from bench.pictures import StampedPictures
from tests.dashboard.pictures.test_h264 import Decoder
from tsd_twin.camera.publisher import encode_jpeg
from tsd_twin.dashboard.pictures.feed import Picture, jpeg_of, pixels_of
from tsd_twin.dashboard.pictures.h264 import H264Stream
from tsd_twin.dashboard.pictures.link_budget import FORMATS, VIDEO_FORMATS, PictureFormat

Pixels = NDArray[np.uint8]
PICTURES, SETTLED, QUALITY = 120, 60, 80
STAMP_PX = 128


def psnr_db(shown: Pixels, camera: Pixels) -> float:
    """Return the quality of a picture in the size of the camera, without the stamp."""
    height, width = camera.shape[:2]
    large = cv2.resize(shown, (width, height), interpolation=cv2.INTER_LINEAR)
    difference = large[STAMP_PX:].astype(float) - camera[STAMP_PX:]
    return float(10.0 * np.log10(255.0**2 / np.mean(difference**2)))


def measured(
    scene: list[Pixels], jpegs: list[bytes], chosen: PictureFormat, sockets: int
) -> tuple[float, float, float]:
    """Return mean size, quality and CPU time in ms of all pictures after the first `SETTLED`."""
    streams = [(H264Stream(), Decoder()) for _ in range(sockets)]
    found = list[tuple[float, float, float]]()
    for number, (camera, jpeg) in enumerate(zip(scene, jpegs, strict=True)):
        picture = Picture(0, jpeg, b"", camera.shape[1], camera.shape[0], 0.0)
        stream, decoder = streams[number % sockets]
        began_s = time.thread_time()
        if chosen.is_video:
            pixels = pixels_of(picture, chosen.eighths)
            data, _ = stream.encode(pixels, chosen.bytes_share * len(jpeg))
        elif chosen.quality is None:
            data = jpeg
        else:
            data = jpeg_of(picture, chosen.eighths, chosen.quality)
        used_ms = 1e3 * (time.thread_time() - began_s)
        shown = decoder.decode(data) if chosen.is_video else simplejpeg.decode_jpeg(data, "BGR")
        found.append((len(data), psnr_db(shown, camera), used_ms))
    size_bytes, quality_db, used_ms = np.mean(found[SETTLED:], axis=0)
    return float(size_bytes), float(quality_db), float(used_ms)


def main() -> None:
    """Print each format."""
    sockets = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    cv2.setNumThreads(1)
    stamped = StampedPictures()
    camera, _, robots = driving_robots([PERIOD_S * i for i in range(PICTURES)])
    for name, drawn in (
        ("moving ground", [stamped.next().picture for _ in range(PICTURES)]),
        ("three robots", [camera.draw(each) for each in robots]),
    ):
        jpegs = [encode_jpeg(each, QUALITY) for each in drawn]
        scene = [np.atleast_3d(each).repeat(3 if each.ndim == 2 else 1, 2) for each in drawn]
        sys.stdout.write(f"{name}: {np.mean([len(each) for each in jpegs]):.0f} bytes\n")
        for chosen in FORMATS[1:] + VIDEO_FORMATS:
            coding = "H.264" if chosen.is_video else f"JPEG {chosen.quality}"
            size_bytes, quality_db, used_ms = measured(scene, jpegs, chosen, sockets)
            sys.stdout.write(
                f"  {scene[0].shape[1] * chosen.eighths // 8:4} px {coding}: "
                f"{size_bytes:.0f} bytes, {quality_db:.1f} dB, {used_ms:.1f} ms\n"
            )


if __name__ == "__main__":
    main()
