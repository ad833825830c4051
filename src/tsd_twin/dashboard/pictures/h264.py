"""H.264 for pages on thin links, with PyAV, if it is installed."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAX_PIXELS = 1920 * 1088
"""Largest picture of level 4.2, which all decoders have."""
MIN_SIDE = 64
"""A quarter of it is a macroblock."""
_LEAST_BYTES = 500.0
_RATE_HZ = 30
"""Nominal rate; limits the size of each picture, so the real rate does not count."""
_QUALITY = "23"
"""Constant rate factor: pictures that need fewer bytes for this quality get no more."""
_OPTIONS = {
    "preset": "veryfast",
    "tune": "zerolatency",  # No picture waits in the encoder.
    "crf": _QUALITY,
    "sc_threshold": "0",  # TCP loses nothing, so key frames are needed at the start only.
    "color_range": "tv",
    "colorspace": "smpte170m",
    "color_primaries": "smpte170m",
    "color_trc": "smpte170m",
}


def is_available() -> bool:
    """Return whether PyAV is installed and has an encoder; imports it."""
    try:
        from av.codec import Codec

        Codec("libx264", "w")
    except (ImportError, ValueError):  # `UnknownCodecError` is a `ValueError`.
        return False
    return True


class H264Stream:
    """Encoder for the pictures on one WebSocket, each of which depends on the one before.

    Another WebSocket has another encoder, so that a lost segment stalls no pictures but its own.
    """

    def __init__(self) -> None:
        self._context: Any = None
        self._bytes = 0.0
        self._number = 0

    def end(self) -> None:
        """Free the encoder; the next picture is a key frame."""
        self._context = None

    def encode(self, pixels: NDArray[np.uint8], most_bytes: float) -> tuple[bytes, bool]:
        """Return a BGR picture in Annex B, of about `most_bytes` at most, and whether it is a key.

        Blocks for milliseconds. Another size, or a limit that differs much, starts a new encoder.
        """
        from av import VideoFrame

        height, width = (n // 2 * 2 for n in pixels.shape[:2])  # As 4:2:0 requires.
        context = self._context
        is_key = (
            context is None
            or (context.height, context.width) != (height, width)
            or not 0.6 < most_bytes / self._bytes < 1.6
        )
        if is_key:
            self._context = _opened(width, height, most_bytes)
            self._bytes = most_bytes
        frame = VideoFrame.from_ndarray(pixels, "bgr24").reformat(
            width, height, "yuv420p", dst_colorspace="ITU601"
        )
        frame.pts = self._number = self._number + 1
        return b"".join(bytes(packet) for packet in self._context.encode(frame)), is_key


def _opened(width: int, height: int, most_bytes: float) -> Any:
    from av.codec import CodecContext

    context = CodecContext.create("libx264", "w")
    context.width, context.height, context.pix_fmt = width, height, "yuv420p"
    context.framerate, context.time_base = Fraction(_RATE_HZ), Fraction(1, _RATE_HZ)
    context.max_b_frames, context.gop_size, context.thread_count = 0, 1 << 30, 1
    bits = round(8 * max(most_bytes, _LEAST_BYTES))  # FFmpeg rounds to 1000 bits.
    context.options = _OPTIONS | {"maxrate": str(bits * _RATE_HZ), "bufsize": str(2 * bits)}
    context.open()
    return context
