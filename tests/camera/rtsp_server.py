"""RTSP server of GStreamer with stamped pictures: `python3 rtsp_server.py PORT`.

Runs on the Python of the system, which has the bindings of GStreamer. Each picture shows the wall
clock in ms as black and white squares (`read_stamp_ms`), taken before the encoder.
"""

import sys
import time

SIZE = WIDTH, HEIGHT = 1280, 720
RATE_HZ = 30
BITS, COLUMNS, SQUARE_PX = 40, 20, 64
BLACK, GRAY, WHITE = (bytes([level]) for level in (16, 128, 235))
LAUNCH = (
    f"( appsrc name=camera is-live=true do-timestamp=true format=time "
    f"caps=video/x-raw,format=I420,width={WIDTH},height={HEIGHT},framerate={RATE_HZ}/1 "
    "! x264enc tune=zerolatency speed-preset=ultrafast key-int-max=30 bitrate=4000 "
    "! rtph264pay name=pay0 pt=96 config-interval=1 )"
)


def stamped(ms: int) -> bytes:
    """Return a gray picture (I420) that shows a time."""
    levels = [WHITE if ms >> (BITS - 1 - i) & 1 else BLACK for i in range(BITS)]
    rows = [levels[at : at + COLUMNS] for at in range(0, BITS, COLUMNS)]
    lines = [b"".join(level * SQUARE_PX for level in row) for row in rows]
    luma = b"".join(line * SQUARE_PX for line in lines)
    return luma.ljust(WIDTH * HEIGHT, GRAY) + GRAY * (WIDTH * HEIGHT // 2)


def serve(port: str) -> None:
    """Serve `rtsp://127.0.0.1:PORT/camera` until the process is killed."""
    import gi  # pyright: ignore

    for name in ("Gst", "GstRtspServer"):
        gi.require_version(name, "1.0")
    from gi.repository import GLib, Gst, GstRtspServer  # pyright: ignore

    Gst.init(None)
    sources = []

    def push() -> bool:
        picture = stamped(time.time_ns() // 1_000_000)
        for source in sources:
            source.emit("push-buffer", Gst.Buffer.new_wrapped(picture))
        return True

    def configure(_factory, media) -> None:
        sources[:] = [media.get_element().get_child_by_name("camera")]

    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(LAUNCH)
    factory.set_shared(True)
    factory.connect("media-configure", configure)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    server.get_mount_points().add_factory("/camera", factory)
    server.attach(None)
    GLib.timeout_add(1000 // RATE_HZ, push)
    sys.stdout.write(f"ready: rtsp://127.0.0.1:{server.get_bound_port()}/camera\n")
    sys.stdout.flush()
    GLib.MainLoop().run()


if __name__ == "__main__":
    serve(sys.argv[1])
