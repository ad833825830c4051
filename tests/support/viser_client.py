"""viser client without a browser: decodes messages and keeps the resulting scene.

It implements viser's wire format without code of viser.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.support.withheld import PATIENCE_S, wait_for
from tsd_twin.dashboard.scene.appearance import METRES
from tsd_twin.dashboard.scene.viser_compat import KEY_HEADER, ROBOTS_HEADER, access_key

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1.0, 1.0],
    "image_height": 720,
    "image_width": 1280,
    "fov": 0.8,
    "near": 0.01,
    "far": 1000.0,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


@dataclass
class Node:
    """Scene node."""

    kind: str
    props: dict[str, Any]
    position: Any = (0.0, 0.0, 0.0)
    wxyz: Any = (1.0, 0.0, 0.0, 0.0)
    visible: bool = True
    virtual: bool = False
    """Whether the node was created only as a parent, without a separate message."""


@dataclass
class Control:
    """Control of a plain viser dashboard, such as the example."""

    kind: str
    uuid: str
    props: dict[str, Any]
    value: Any = None


@dataclass
class ViserClient:
    """Scene of a client: shared and private nodes by name."""

    socket: ClientConnection
    shared: dict[str, Node] = field(default_factory=dict)
    own: dict[str, Node] = field(default_factory=dict)
    scales: dict[str, Any] = field(default_factory=dict)
    controls: dict[str, Control] = field(default_factory=dict)
    messages: list[dict[str, Any]] = field(default_factory=list)
    camera: dict[str, Any] = field(default_factory=dict)
    dark: bool | None = None
    closed: bool = False

    def __post_init__(self) -> None:
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def send(self, message: dict[str, Any]) -> None:
        self.socket.send(msgspec.msgpack.encode(message))

    def set(self, label: str, value: Any) -> None:
        """Move a control like the browser."""
        control = self.control(label)
        control.value = value
        message = {"type": "GuiUpdateMessage", "uuid": control.uuid, "updates": {"value": value}}
        self.send(message)

    def control(self, label: str) -> Control:
        return next(c for c in self.controls.values() if c.props.get("label") == label)

    def labels(self) -> set[str]:
        return {str(c.props["label"]) for c in self.controls.values() if c.props.get("label")}

    def node(self, name: str) -> Node:
        """Return the visible node; a private node overrides the shared one unless implicit."""
        own, shared = self.own.get(name), self.shared.get(name)
        return own if own is not None and (shared is None or not own.virtual) else self.shared[name]

    def until(self, condition: Callable[[], Any]) -> None:
        """Wait until received messages make a condition true."""

        def holds() -> bool:
            try:
                return bool(condition())
            except (KeyError, StopIteration, ValueError):  # Not received yet.
                return False

        with self._changed:
            assert wait_for(self._changed, holds), "it was not sent"

    def join(self) -> None:
        self.socket.close()
        self._reader.join(PATIENCE_S)

    def _read(self) -> None:
        try:
            for frame in self.socket:
                assert isinstance(frame, bytes)
                with self._changed:
                    for message in decoded(frame):
                        self.messages.append(message)
                        self._take(message)
                    self._changed.notify_all()
        except ConnectionClosed:
            pass
        with self._changed:
            self.closed = True
            self._changed.notify_all()

    def _take(self, message: dict[str, Any]) -> None:
        kind, name = message["type"], message.get("name")
        nodes = self.own if message.get("owner") else self.shared
        if kind.startswith("Gui") and "props" in message:
            self.controls[message["uuid"]] = Control(
                kind, message["uuid"], message["props"], message.get("value")
            )
        elif kind == "GuiUpdateMessage" and message["uuid"] in self.controls:
            control = self.controls[message["uuid"]]
            control.value = message["updates"].get("value", control.value)
            control.props.update(message["updates"])
        elif kind == "ThemeConfigurationMessage":
            self.dark = message["dark_mode"]
        elif kind.startswith("SetCamera"):
            self.camera[kind] = message
        elif name is not None and "props" in message:
            self._add(nodes, name, message)
        elif kind == "RemoveSceneNodeMessage":
            nodes.pop(name, None)
        elif name in nodes:
            self._change(nodes[name], message)

    def _add(self, nodes: dict[str, Node], name: str, message: dict[str, Any]) -> None:
        """Add a node; an existing node keeps its pose, as in a browser."""
        node = Node(message["type"], message["props"], virtual=message.get("virtual", False))
        if (before := nodes.get(name)) is not None:
            node.position, node.wxyz, node.visible = before.position, before.wxyz, before.visible
            node.virtual = node.virtual and before.virtual
        nodes[name] = node

    def _change(self, node: Node, message: dict[str, Any]) -> None:
        match message["type"]:
            case "SceneNodeUpdateMessage":
                node.props.update(message["updates"])
            case "SetPositionMessage":
                node.position = message["position"]
            case "SetOrientationMessage":
                node.wxyz = message["wxyz"]
            case "SetSceneNodeVisibilityMessage":
                node.visible = message["visible"]
            case _:
                pass


def decoded(frame: bytes) -> list[dict[str, Any]]:
    """Decode a frame: sizes, packed messages, and their arrays aligned to 8 bytes."""
    plain, packed = (int.from_bytes(frame[i : i + 8], "little") for i in (0, 8))
    body = zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed], plain)
    content = msgspec.msgpack.decode(body)
    at, arrays = 16 + packed, list[bytes]()
    for length in content["binaryBufferLengths"]:
        at += -at % 8
        arrays.append(frame[at : at + length])
        at += length

    def restored(value: Any) -> Any:
        if isinstance(value, dict):
            if "__binary_index" in value:
                return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
            return {key: restored(item) for key, item in value.items()}
        return value

    return [restored(message) for message in content["messages"]]


def chosen(viewer: ViserClient) -> dict[str, Node]:
    """Return the private nodes of a client, except its stage."""
    stage = ("/stage", "/w/g", METRES)
    return {
        name: node
        for name, node in viewer.own.items()
        if not (node.virtual or name.startswith(stage))
    }


@contextmanager
def viser_client(
    port: int, page: str | None = None, *, plain: bool = False, robots: str = ""
) -> Generator[ViserClient]:
    """Connect a client and receive the whole scene, or only some `robots`."""
    headers = {KEY_HEADER: access_key(), "X-Tsd-Look": "dark-plain" if plain else "dark"}
    headers |= {} if page is None else {"X-Tsd-Page": page}
    headers |= {ROBOTS_HEADER: robots} if robots else {}
    socket = connect(
        f"ws://127.0.0.1:{port}",
        subprotocols=["viser-v1.1.1"],
        additional_headers=headers,
        compression=None,
        max_size=None,
    )
    viewer = ViserClient(socket)
    try:
        viewer.send(CAMERA)
        viewer.until(lambda: any(m["type"] == "ReplayDoneMessage" for m in viewer.messages))
        yield viewer
    finally:
        viewer.join()
