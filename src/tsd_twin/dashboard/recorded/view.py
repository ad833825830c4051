"""View of a recording for one page: a separate scene, drawn at the playback time.

Its viser server has the recorded robots and no others, so that neither can be taken for the other,
and no live robot can be reached through it.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path

from tsd_twin.dashboard.scene import viser_compat
from tsd_twin.dashboard.scene.appearance import RobotRoster
from tsd_twin.dashboard.scene.client_views import (
    BackgroundWorker,
    ClientViews,
    PageView,
    SceneExecutor,
)
from tsd_twin.dashboard.scene.framing import Rectangle
from tsd_twin.dashboard.scene.scene import STALE_S, Scene
from tsd_twin.dashboard.wire.to_page import TimelineEvent
from tsd_twin.errors import RecordingError
from tsd_twin.recording.player import PlaybackCursor, Player
from tsd_twin.recording.remote import RemoteReader

RATE_HZ = 30.0
_REFRESH_S = 1.0
_LOG = logging.getLogger(__name__)


def timeline_events(player: Player) -> list[TimelineEvent]:
    """Return the events and marks of a recording; reads the file."""
    return [
        TimelineEvent(each.t_s, each.robot, each.kind, each.text, each.count, each.why)
        for each in player.reader.events()
    ] + [
        TimelineEvent(1e-9 * (mark.log_ns - player.start_ns), "", "mark", mark.note, 1)
        for mark in player.reader.marks()
    ]


def draw_recorded(scene: Scene, player: Player) -> None:
    """Draw the robots of a recording at the time of its player."""
    for robot in player.robots.values():
        age_s = player.t_s - robot.snapshot.received_s
        scene.set_stale(robot.id, age_s > STALE_S or not robot.alive)
    scene.draw()


class RecordedView:
    """View of a recording, drawn on a separate thread."""

    def __init__(self, path: Path, reader: RemoteReader) -> None:
        """Start to show the start of a recording; takes a second. `reader` is closed with it.

        Raises:
            RecordingError: If the file is not a recording.
        """
        self.player = Player(path, reader=reader)
        self.robot_id = next(iter(self.player.robots))
        """Robot that is selected."""
        self.frame = Rectangle()
        self.roster = RobotRoster()
        self.playback = PlaybackCursor(self.player.duration_s, time.monotonic())
        self.on_shown: Callable[[bool], None] = _ignore
        """Called on the thread of the view after each frame, with whether its time has jumped."""
        self._requests: queue.SimpleQueue[Callable[[float], None]] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._refreshed_s = 0.0
        self._jumped = False
        self._server = viser_compat.start_server(path.name)
        try:
            self._scene = Scene(self._server, self.roster)
            views = ClientViews(
                self._server,
                self._scene,
                view_of=lambda _page: PageView(None, self.frame, self.robot_id),
            )
            for robot in self.player.robots.values():
                self._scene.add(robot)
        except BaseException:
            self._server.stop()
            self.player.close()
            raise
        self._worker = BackgroundWorker("views")
        self.scene = SceneExecutor(self._worker, self._scene, lambda: views)
        """Its scene, for sessions."""
        self._thread = threading.Thread(target=self._run, name="recording")
        self._thread.start()

    @property
    def viser_port(self) -> int:
        """Port of its viser server on the loopback."""
        return self._server.get_port()

    def close(self) -> None:
        """End; blocks for a moment."""
        self._stop.set()
        self._requests.put(_ignore)
        self._thread.join()
        self._worker.close()
        self._server.stop()
        self.player.close()

    def disconnect(self) -> None:
        """Stop reporting."""
        self.on_shown = _ignore

    def request(self, work: Callable[[float], None]) -> None:
        """Call `work` with the monotonic time on the thread of the view; from any thread."""
        self._requests.put(work)

    # On the thread of the view.

    def seek(self, t_s: float, now_s: float) -> None:
        """Show a time."""
        self.playback.seek(t_s, now_s)
        self._jumped = True

    def step(self, now_s: float, *, back: bool) -> None:
        """Show the next status of the selected robot, or the one before; pauses."""
        self.playback.pause(now_s)
        self.player.step(self.robot_id, back=back)
        self.seek(self.player.t_s, now_s)

    def _run(self) -> None:
        problem = ""
        while not self._stop.is_set():
            try:
                with contextlib.suppress(queue.Empty):  # The requested time is shown immediately.
                    self._requests.get(timeout=1.0 / RATE_HZ)(time.monotonic())
                self._frame(time.monotonic())
            except RecordingError as error:  # Damaged at this place: others can be shown.
                self.playback.pause(time.monotonic())
                if str(error) != problem:
                    problem = str(error)
                    _LOG.warning("%s", problem)
            except Exception:  # A frame that fails must not end the view.
                _LOG.exception("a frame was lost")

    def _frame(self, now_s: float) -> None:
        while not self._requests.empty():
            self._requests.get()(now_s)
        if now_s - self._refreshed_s > _REFRESH_S:
            self._refreshed_s = now_s
            self.player.refresh()
            self.playback.duration_s = self.player.duration_s
        self.player.seek(self.playback.t_s(now_s))
        jumped, self._jumped = self._jumped, False
        if jumped:
            self._scene.clear_trails()
        draw_recorded(self._scene, self.player)
        self.on_shown(jumped)


def _ignore(*_: object) -> None:
    """Do nothing: no control of this scene moves anything."""
