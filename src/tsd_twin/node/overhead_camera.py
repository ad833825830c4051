"""Simulated overhead camera: publishes delayed, noisy poses of a simulated robot on the bus."""

from __future__ import annotations

import threading
from typing import Self

import numpy as np

from tsd_twin.bus import Bus
from tsd_twin.lie import SE2
from tsd_twin.messages import topics
from tsd_twin.messages.commands import PoseStamped, encode_pose
from tsd_twin.messages.ros import decode_odometry
from tsd_twin.simulation import Camera, CameraNoise

_LOOK_S = 0.01


class OverheadCamera:
    """Simulated camera: publishes the true pose on `sensor/pose`, delayed and with noise.

    It uses the bus only, as the computer of a real camera would; use it as a context manager.
    """

    def __init__(
        self, bus: Bus, robot_id: str, seed: int | None = 0, noise: CameraNoise | None = None
    ) -> None:
        self._camera = Camera(noise or CameraNoise(), np.random.default_rng(seed))
        self._truths = bus.subscriber(topics.TRUTH.key(robot_id), 8)
        topic = topics.SENSOR_POSE
        self._poses = bus.publisher(topic.key(robot_id), topic.qos, topic.type)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._truths.close()
        self._poses.close()

    def _run(self) -> None:
        start_ns = None
        while not self._stop.wait(_LOOK_S):
            for sample in self._truths.take_samples():
                truth = decode_odometry(sample.payload)
                start_ns = truth.stamp_ns if start_ns is None else start_ns
                now_s = (truth.stamp_ns - start_ns) * 1e-9
                for frame in self._camera.capture(now_s, SE2(truth.xy_heading)):
                    stamp_ns = start_ns + round(frame.taken_s * 1e9)
                    message = PoseStamped.planar(SE2(frame.pose), stamp_ns)
                    self._poses.put(encode_pose(message))
