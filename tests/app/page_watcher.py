"""Who watches the bus while a person drives on the page, and the controls that are held there."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from playwright.sync_api import Page

from tests.support.browser import centre, get_ready
from tests.support.withheld import budget, wait_for
from tsd_twin.bus import Bus, Config, client_config
from tsd_twin.lie import Array
from tsd_twin.messages import topics
from tsd_twin.messages.cdr import Odometry, decode_joints, decode_odometry, decode_twist
from tsd_twin.messages.topics import Sample

PRESSES, PRESS_S = 10, 5.0
"""How often a control is pressed until the robot does what it should, and for how long."""


@dataclass
class Press:
    """A control that is held."""

    down: Callable[[], None]
    up: Callable[[], None]


def key(page: Page, name: str) -> Press:
    return Press(lambda: page.keyboard.down(name), lambda: page.keyboard.up(name))


def stick_forward(page: Page) -> Press:
    x, y, reach = centre(page, "application", "Stick")

    def down() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x, y - reach)

    return Press(down, page.mouse.up)


class Watcher:
    """Observer of the bus, independent of page and robot."""

    def __init__(self, bus: Bus, page: Page) -> None:
        self._page = page
        self._news = threading.Condition()
        self.truth: Array = np.zeros(3)
        self.twist: Array = np.zeros(3)
        self.tilt_rad = 0.0
        self.set_tilt_rad = 0.0
        self.way: list[Array] = []
        self.commands: list[Array] = []
        self._estimate: Odometry | None = None
        bus.subscribe(topics.TRUTH.key("tsd"), self._on_truth)
        bus.subscribe(topics.ODOM.key("tsd"), self._on_estimate)
        bus.subscribe(topics.JOINTS.key("tsd"), self._on_joints)
        bus.subscribe(topics.SETPOINT.key("tsd"), self._on_setpoint)
        bus.subscribe(topics.TWIST.key("tsd"), self._on_command)

    def _on_truth(self, sample: Sample) -> None:
        odometry = decode_odometry(sample.payload)
        with self._news:
            self.truth, self.twist = odometry.xy_heading, odometry.twist
            self.way.append(self.truth[:2])
            self._news.notify_all()

    def _on_estimate(self, sample: Sample) -> None:
        self._estimate = decode_odometry(sample.payload)

    @property
    def estimate(self) -> Odometry:
        """The estimated pose and its covariance."""
        assert self._estimate is not None
        return self._estimate

    def _on_joints(self, sample: Sample) -> None:
        self.tilt_rad = float(np.nanmax(np.abs(decode_joints(sample.payload).position_rad)))

    def _on_setpoint(self, sample: Sample) -> None:
        self.set_tilt_rad = float(np.nanmax(np.abs(decode_joints(sample.payload).position_rad)))

    def _on_command(self, sample: Sample) -> None:
        self.commands.append(decode_twist(sample.payload).twist)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until the truth is as expected."""
        with self._news:
            assert wait_for(self._news, condition), f"never: {what}, at {self.truth}"

    def holding(self, press: Press, condition: Callable[[], bool], what: str) -> None:
        """Hold a control until the truth is as expected.

        A page that is drawn without a GPU stalls at times. The robot then stops, as it must,
        and obeys the control again only after its release. So release and press it again, as a
        person would, who also takes control again if the page has lost it.
        """
        for _ in budget.tries(f"hold until {what}", PRESSES):
            press.down()
            with self._news:
                if self._news.wait_for(condition, PRESS_S):
                    return
            press.up()
            self.until(lambda: self.at_rest, "standstill")
            get_ready(self._page)
        raise AssertionError(f"never: {what}, at {self.truth}")

    @property
    def at_rest(self) -> bool:
        return bool(np.abs(self.twist).max() < 1e-3)


def observer(endpoint: str) -> Config:
    """Return a client session, because peers do not receive commands of other sessions."""
    config = client_config([endpoint])
    return Config(config.json5.replace('"mode": "peer"', '"mode": "client"'), endpoint)
