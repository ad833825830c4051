"""ROS nodes over the system's rclpy, with a separate node and DDS participant per robot.

rclpy is imported only when a port is opened, because it is installed with ROS; a `TwinError` names
what is missing. Messages are passed as CDR, so all ports share the topic table and conversions.
"""

from __future__ import annotations

import importlib
import itertools
import logging
import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from tsd_twin.adapters.ros.arrivals import Origin
from tsd_twin.adapters.ros.port import (
    ADAPTER,
    UNKNOWN_PUBLISHER,
    Endpoints,
    PortCallbacks,
    types_of,
)
from tsd_twin.adapters.ros_messages import RosMessage
from tsd_twin.adapters.ros_topics import RosNames, RosQoS, RosTopic
from tsd_twin.errors import TwinError
from tsd_twin.messages.ros_types import TRIGGER

_LOG = logging.getLogger(__name__)
_END_S = 2.0
_PAUSE_S = 0.01
_DEPTH = {RosQoS.SENSOR: 5, RosQoS.STATE: 10, RosQoS.LATCHED: 1, RosQoS.COMMAND: 1, RosQoS.DRIVE: 1}


def load_rclpy() -> Any:
    """Import rclpy."""
    try:
        return importlib.import_module("rclpy")
    except ImportError as error:
        raise TwinError(
            f"rclpy of ROS 2 cannot be imported ({error}): run "
            "`source /opt/ros/<distro>/setup.bash` first, and use the Python of that ROS"
        ) from error


def load_type(type_name: str) -> Any:
    """Import a message or service class."""
    package, kind, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise TwinError(
            f"{type_name} of ROS 2 cannot be imported ({error}): install the package {package}"
        ) from error


def check_ros(endpoints: Endpoints = ADAPTER) -> None:
    """Check early that all required imports are available."""
    load_rclpy()
    published = (row.type for row in endpoints.published)
    for type_name in itertools.chain(published, *map(types_of, endpoints.read), [TRIGGER]):
        load_type(type_name)


class DdsPort:
    """Node for a robot, and a second one for the other type of `cmd_vel`.

    A Fast DDS participant cannot have a topic with two types.
    """

    def __init__(
        self,
        domain: int,
        names: RosNames,
        inputs: PortCallbacks | None,
        endpoints: Endpoints = ADAPTER,
    ) -> None:
        """Without `inputs`, subscribe to nothing and offer no services.

        Raises:
            TwinError: If ROS cannot open a node.
        """
        self._published: dict[str, Any] = {}
        self._nodes: list[_Node] = []
        self._own_name = endpoints.node
        self._read: dict[str, list[str]] = {}
        """Our own nodes reading each topic."""
        try:
            self._open(domain, names, inputs, endpoints)
        except Exception as error:  # rclpy has no common error class.
            self.close()
            raise TwinError(f"no node of ROS can be opened: {error}") from error

    def _open(
        self, domain: int, names: RosNames, inputs: PortCallbacks | None, endpoints: Endpoints
    ) -> None:
        namespace = f"/{names.namespace}" if names.shared else "/"
        self._nodes.append(_Node(endpoints.node, domain, namespace))
        for row in endpoints.published:
            name = names.topic(row.name)
            self._published[name] = self._nodes[0].publisher(name, row)
        if inputs is None:
            return
        if any(len(types_of(row)) > 1 for row in endpoints.read):
            self._nodes.append(_Node(f"{endpoints.node}_stamped", domain, namespace))
        for row in endpoints.read:
            for node, type_name in zip(self._nodes, types_of(row), strict=False):
                node.subscribe(names.topic(row.name), row, type_name, inputs)
                self._read.setdefault(names.topic(row.name), []).append(node.name)
        for service in endpoints.services:
            self._nodes[0].serve(names.topic(service), partial(inputs.on_call, service))
        for node in self._nodes:
            node.start()

    def wants(self, topic: str) -> bool:
        """Return whether a topic has a subscriber."""
        try:
            return self._published[topic].get_subscription_count() > 0
        except Exception:  # rclpy has no common error class.
            return False

    def publish(self, message: RosMessage) -> None:
        """Publish a message.

        Raises:
            TwinError: If the port is closed or the middleware fails.
        """
        try:
            self._published[message.name].publish(message.payload)
        except Exception as error:  # rclpy has no common error class.
            raise TwinError(f"ROS does not publish it: {error}") from error

    def publishers(self, topic: str) -> list[str]:
        """Return the names of other nodes publishing a topic."""
        found = self._nodes[0].rclpy_node.get_publishers_info_by_topic(topic)
        return _other_nodes(found, [self._own_name] if topic in self._published else [])

    def subscribers(self, topic: str) -> list[str]:
        """Return the names of other nodes reading a topic."""
        found = self._nodes[0].rclpy_node.get_subscriptions_info_by_topic(topic)
        return _other_nodes(found, self._read.get(topic, []))

    def close(self) -> None:
        """Leave the graph."""
        for node in self._nodes:
            node.close()


class _Node:
    """Only node of an rclpy participant, with a receiving thread."""

    def __init__(self, name: str, domain: int, namespace: str) -> None:
        rclpy: Any = load_rclpy()
        self.name = name
        self._executors: Any = importlib.import_module("rclpy.executors")
        self._qos: Any = importlib.import_module("rclpy.qos")
        self._context: Any = rclpy.Context()
        # This program handles its own flags and signals.
        rclpy.init(args=[], context=self._context, domain_id=domain)
        self.rclpy_node: Any = rclpy.create_node(
            name,
            context=self._context,
            namespace=namespace,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor: Any = None
        self._thread = threading.Thread(target=self._run, name=f"ros {namespace}", daemon=True)
        self._ending = threading.Event()

    def publisher(self, name: str, row: RosTopic) -> Any:
        """Create a publisher."""
        return self.rclpy_node.create_publisher(load_type(row.type), name, self._profile(row.qos))

    def subscribe(self, name: str, row: RosTopic, type_name: str, inputs: PortCallbacks) -> None:
        """Forward the messages of a topic as CDR."""
        numbers = itertools.count()

        # rclpy passes message info to callbacks with two parameters.
        def receive(payload: bytes, info: Mapping[str, int]) -> None:
            # rclpy does not identify the publisher of a message, only all current publishers.
            several = self.rclpy_node.get_publishers_info_by_topic(name)
            if not several:  # It has left, or is not yet in the graph.
                return
            publisher = bytes(several[0].endpoint_gid) if len(several) == 1 else UNKNOWN_PUBLISHER
            origin = Origin(publisher, next(numbers), info["source_timestamp"])
            inputs.on_message(row, type_name, payload, origin)

        self.rclpy_node.create_subscription(
            load_type(type_name), name, receive, self._profile(row.qos), raw=True
        )

    def serve(self, name: str, call: Callable[[Callable[[bool, str], None]], None]) -> None:
        """Offer a service that may respond later, from any thread."""
        trigger = load_type(TRIGGER)
        service: Any = self.rclpy_node.create_service(trigger, name, _same_response)
        send = service.send_response

        # The executor would busy-poll a coroutine until it completes.
        def answer_later(_response: Any, header: Any) -> None:
            def answer(success: bool, text: str) -> None:
                try:
                    send(trigger.Response(success=success, message=text), header)
                except Exception as error:  # The client or this node is gone.
                    _LOG.info("%s cannot be answered: %s", name, error)

            call(answer)

        service.send_response = answer_later

    def start(self) -> None:
        """Start receiving."""
        self._executor = self._executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.rclpy_node)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._ending.set()
        if self._executor is not None:
            self._executor.shutdown(_END_S)
            self._thread.join(_END_S)
        self.rclpy_node.destroy_node()
        self._context.try_shutdown()

    def _run(self) -> None:
        while not self._ending.is_set():
            try:
                self._executor.spin_once()
            except Exception as error:  # Invalid requests must not end this thread.
                if not self._ending.is_set():
                    _LOG.warning("a message of ROS is ignored: %s", error)
                    self._ending.wait(_PAUSE_S)

    def _profile(self, qos: RosQoS) -> Any:
        made = self._qos
        reliable = qos in (RosQoS.STATE, RosQoS.LATCHED, RosQoS.DRIVE)
        latched = qos is RosQoS.LATCHED
        reliability, durability = made.ReliabilityPolicy, made.DurabilityPolicy
        return made.QoSProfile(
            history=made.HistoryPolicy.KEEP_LAST,
            depth=_DEPTH[qos],
            reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
            durability=durability.TRANSIENT_LOCAL if latched else durability.VOLATILE,
        )


def _same_response(_request: Any, response: Any) -> Any:
    return response


def _other_nodes(found: list[Any], own: list[str]) -> list[str]:
    """Return node names without our own; the graph cannot tell nodes with equal names apart."""
    nodes = [each.node_name for each in found]
    for name in own:
        if name in nodes:
            nodes.remove(name)
    return nodes
