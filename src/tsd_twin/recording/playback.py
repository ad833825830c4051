"""Playback: the time of a recording that is shown, which plays, pauses and jumps."""

from __future__ import annotations

LEAST_SPEED, MOST_SPEED = 0.1, 16.0


class Playback:
    """Cursor of a recording, with the time as an argument; it pauses at the end."""

    def __init__(self, duration_s: float, now_s: float) -> None:
        self.duration_s = duration_s
        """Duration; it grows while the recording is written."""
        self.speed = 1.0
        """Factor of the speed at which it plays."""
        self.playing = False
        self._t_s = 0.0
        self._since_s = now_s

    def t_s(self, now_s: float) -> float:
        """Return the time that is shown, in seconds since the start of the recording."""
        if self.playing:
            self._t_s += max(0.0, now_s - self._since_s) * self.speed
            if self._t_s >= self.duration_s:
                self.playing = False
        self._since_s = now_s
        self._t_s = min(self._t_s, self.duration_s)
        return self._t_s

    def play(self, speed: float, now_s: float) -> None:
        """Play from the time that is shown, or from the start when that is the end."""
        t_s = self.t_s(now_s)
        self._t_s = 0.0 if t_s >= self.duration_s else t_s
        self.speed = min(max(speed, LEAST_SPEED), MOST_SPEED)
        self.playing = True

    def pause(self, now_s: float) -> None:
        """Stand still."""
        self.t_s(now_s)
        self.playing = False

    def seek(self, t_s: float, now_s: float) -> None:
        """Show a time; playing goes on from there."""
        self._t_s = min(max(t_s, 0.0), self.duration_s)
        self._since_s = now_s
