"""Base of the sessions of pages, live or with a recording: identity, outgoing messages, stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tsd_twin.client.monitor import RobotMonitor
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.sessions.principal import Principal, operator_name, shown_name
from tsd_twin.dashboard.sessions.send_queue import SendQueue
from tsd_twin.dashboard.sessions.stops import LiveRobots, PageStops
from tsd_twin.dashboard.wire.from_page import StopCommand
from tsd_twin.dashboard.wire.to_page import (
    ActionReply,
    RobotName,
    SessionInfo,
    encode_message,
)
from tsd_twin.dashboard.wire.view import ViewSettings
from tsd_twin.messages.codes import Code, because
from tsd_twin.messages.errors import MessageError
from tsd_twin.security import Role

VIEWER_REFUSAL = because(Code.VIEWER)


class PageSession:
    """Base class of page sessions with the page's id and login, outgoing messages and running
    stops.
    """

    def __init__(self, page: str, principal: Principal, name: str, live: LiveRobots) -> None:
        """`principal` owns the page; each page has its own operator id.

        `name` is the name typed by the operator, used only without logins; `live` are the robots
        that the page can stop.
        """
        self.page = page
        self.principal = principal
        self.view: ViewSettings | None = None
        """View settings, if the page has sent any."""
        self.frame = Rectangle()
        """Part of the picture that the page leaves free."""
        self.send_queue = SendQueue()
        self.rejected = 0
        """Number of invalid messages."""
        self._operator = f"{operator_name(principal, name)}-{page[:8]}"
        self._live = live
        self._stops = PageStops(live, self._operator, self._send)
        self._stops.name = shown_name(principal, name)
        self._plot_fields: Sequence[str] = ()
        self._shows_map = False

    def reject(self, error: MessageError) -> None:
        """Count an invalid message and reply to it."""
        self.rejected += 1
        if self.rejected == 1:
            self._send(ActionReply(to="message", ok=False, why=error.why))

    def _stop(self, message: StopCommand, shown: str | None) -> Sequence[RobotMonitor]:
        """Publish a stop and return the robots addressed; the page shows robot `shown`."""
        if self.principal.may_stop:
            return self._stops.stop(message, shown)
        self._send(ActionReply(to="stop", ok=False, why=VIEWER_REFUSAL))
        return ()

    def _show_fleet(self, *, on: bool) -> None:
        if on:
            self._live.feed.subscribe(self.send_queue)
        else:
            self._live.feed.unsubscribe(self.send_queue)

    def _send_welcome(self, role: Role, robots: Sequence[RobotName], robot: str | None) -> None:
        self._send(
            SessionInfo(
                operator=self._operator,
                name=self._stops.name,
                role=role,
                user=self.principal.user,
                may_stop=self.principal.may_stop,
                robots=robots,
                robot=robot,
            )
        )

    def _send(self, message: Any) -> None:
        self.send_queue.put(encode_message(message))
