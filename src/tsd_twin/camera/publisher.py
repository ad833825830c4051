"""Publishes pictures, outlines of the tags in them, and poses of robots on the bus."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import simplejpeg

from tsd_twin.bus import Bus
from tsd_twin.camera.ground import ground_grid
from tsd_twin.camera.setup_file import CameraSetup
from tsd_twin.camera.sources import CameraFrame
from tsd_twin.camera.tracker import Observation
from tsd_twin.messages import topics
from tsd_twin.messages.pictures import (
    IMAGE_TYPE,
    INFO_TYPE,
    LARGEST_PICTURE,
    CameraInfo,
    CameraName,
    CompressedImage,
    encode_camera_info,
    encode_clock,
    encode_ground,
    encode_picture,
)
from tsd_twin.messages.pose import PoseStamped, encode_pose
from tsd_twin.messages.topics import QoS

QUALITIES = 80, 65, 50, 35, 20
"""JPEG qualities, tried until a picture is small enough for the bus."""
_INFO_PERIOD_S = 1.0


@dataclass(frozen=True, slots=True)
class PictureRates:
    """Counts of a publisher since its start."""

    pictures: int = 0
    poses: int = 0


class CameraPublisher:
    """Publishes the frames of a camera.

    Pictures have a separate session with low priority, so that they cannot delay poses.
    """

    def __init__(self, pictures: Bus, poses: Bus, name: CameraName, setup: CameraSetup) -> None:
        self._name, self._setup = name, setup
        self._pictures = pictures.publisher(name.key, QoS.LOG, IMAGE_TYPE)
        self._info = pictures.publisher(name.info_key, QoS.LOG, INFO_TYPE)
        on_floor = name.robot is None and setup.place is not None
        grid = ground_grid(setup.view) if on_floor else None
        self._ground = None if grid is None else pictures.publisher(name.ground_key, QoS.LOG)
        self._grid = b"" if grid is None else encode_ground(grid)
        pictures.serve(name.clock_key, lambda query: query.reply(encode_clock(time.time_ns())))
        self._token = pictures.declare_token(name.alive_key)
        topic = topics.SENSOR_POSE
        robots = sorted({tag.robot for tag in setup.tags if tag.robot is not None})
        self._poses = {
            robot: poses.publisher(topic.key(robot), topic.qos, topic.type) for robot in robots
        }
        self._quality = QUALITIES[0]
        self._info_s = -_INFO_PERIOD_S
        self.counts = PictureRates()
        """Pictures and poses published so far."""

    def publish(self, frame: CameraFrame, seen: Observation | None, now_s: float) -> None:
        """Publish the poses in a frame, then the frame if it has a subscriber."""
        pictures, poses = self.counts.pictures, self.counts.poses
        for robot, found in (seen.poses if seen is not None else {}).items():
            self._poses[robot].put(encode_pose(PoseStamped.planar(found.pose, frame.stamp_ns)))
            poses += 1
        if now_s - self._info_s >= _INFO_PERIOD_S:
            self._info_s = now_s
            self._info.put(encode_camera_info(self._described(frame)))
            if self._ground is not None:
                self._ground.put(self._grid)
        if self._pictures.has_subscribers:
            data = self._encoded(frame)
            message = CompressedImage(self._name.name, data, frame.stamp_ns)
            self._pictures.put(encode_picture(message), encode_outlines(self._setup, seen))
            pictures += 1
        self.counts = PictureRates(pictures, poses)

    def close(self) -> None:
        """End the camera's presence on the bus."""
        self._token.close()
        for publisher in (self._pictures, self._info, self._ground, *self._poses.values()):
            if publisher is not None:
                publisher.close()

    def _described(self, frame: CameraFrame) -> CameraInfo:
        height, width = frame.picture.shape[:2]
        lens = self._setup.lens
        return CameraInfo(
            self._name.name, width, height, lens.matrix, lens.distortion, frame.stamp_ns
        )

    def _encoded(self, frame: CameraFrame) -> bytes:
        """Return a JPEG that fits into a message; a full one lowers the quality from then on."""
        data = encode_jpeg(frame.picture, self._quality)
        while len(data) > LARGEST_PICTURE and self._quality != QUALITIES[-1]:
            self._quality = QUALITIES[QUALITIES.index(self._quality) + 1]
            data = encode_jpeg(frame.picture, self._quality)
        while len(data) > LARGEST_PICTURE:
            frame = CameraFrame(np.ascontiguousarray(frame.picture[::2, ::2]), frame.stamp_ns)
            data = encode_jpeg(frame.picture, self._quality)
        return data


def encode_jpeg(picture: np.ndarray, quality: int) -> bytes:
    """Return a gray or blue, green, red picture as JPEG."""
    if picture.ndim == 2:
        gray = np.ascontiguousarray(picture)[:, :, None]
        return simplejpeg.encode_jpeg(gray, quality=quality, colorspace="GRAY")
    return simplejpeg.encode_jpeg(
        np.ascontiguousarray(picture), quality=quality, colorspace="BGR", colorsubsampling="420"
    )


def encode_outlines(setup: CameraSetup, seen: Observation | None) -> bytes:
    """Return the attachment of a picture: its size, and the tags that were found, as JSON.

    Each tag has its number, robot, the four corners in pixels, and the reason if it is refused.
    """
    if seen is None:
        return b""
    owners = {(tag.family, tag.number): tag.robot for tag in setup.tags}
    reasons = {(tag.family, tag.number): reason.value for tag, reason in seen.refused}
    tags: Sequence[dict[str, object]] = [
        {
            "number": each.number,
            "robot": owners.get((each.family, each.number)),
            "corners": each.corners.round(1).tolist(),
            "refused": reasons.get((each.family, each.number)),
        }
        for each in seen.sightings
    ]
    size = [setup.lens.width, setup.lens.height]
    return json.dumps({"size": size, "tags": tags}).encode()
