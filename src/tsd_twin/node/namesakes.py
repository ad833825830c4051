"""Other robots with the id of this one, which the check at the start cannot have seen."""

from __future__ import annotations

import secrets

from tsd_twin import topics
from tsd_twin.bus import Bus
from tsd_twin.messages.service import Event, namesake_words


class Namesakes:
    """Announces this node under a number of its own, and watches for others with the same id.

    The check at the start sees only who is on the bus by then. Two networks that are joined later
    would have two robots obey the same commands.
    """

    def __init__(self, bus: Bus, robot_id: str) -> None:
        self._id = robot_id
        instance = secrets.token_hex(8)
        self._own = topics.instance_key(robot_id, instance)
        self._others: set[str] = set()
        self.fault = ""
        """What is wrong, as a part of a sentence; "" while no other robot has this id."""
        self._event: Event | None = None
        self._token = bus.announce(self._own)
        bus.watch_alive(topics.instance_key(robot_id, "*"), self._note)

    def step(self, now_s: float) -> str:
        """Look who is there now, and return the `fault` that follows."""
        fault = namesake_words(self._id) if self._others else ""
        if fault != self.fault:
            self.fault = fault
            text = (
                f"{fault.capitalize()}."
                if fault
                else f"No other robot has the id '{self._id}' any more."
            )
            self._event = Event("id", text, rule="one robot for each id", robot_s=now_s)
        return fault

    def take_event(self) -> Event | None:
        """Return what happened: once when another robot is met, once when all are gone."""
        event, self._event = self._event, None
        return event

    def close(self) -> None:
        """Announce this node no longer."""
        self._token.close()

    def _note(self, key: str, lives: bool) -> None:
        # On the thread of the bus; the loop looks only whether the set is empty.
        if key == self._own:
            return
        if lives:
            self._others.add(key)
        else:
            self._others.discard(key)
