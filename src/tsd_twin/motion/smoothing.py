"""Timings whose acceleration does not jump."""

from __future__ import annotations

import itertools

import numpy as np

from tsd_twin.motion.timing import SpeedProfile

_CELL_S = 0.002


def smoothed(profile: SpeedProfile, over_s: float) -> SpeedProfile:
    """Return a profile whose speed at each time is the mean of another's over the last `over_s`.

    So what was a jump of acceleration is a ramp over `over_s`, and nothing accelerates harder than
    before. Each way from one rest to the next takes `over_s` longer. On straight ways all limits
    still hold; on a curve a place is passed a little faster or slower than before.
    """
    if not over_s > 0.0:
        return profile
    at_s, s_m, speed = [np.zeros(1)], [profile.s_m[:1]], [np.zeros(1)]
    rests = np.flatnonzero(profile.speed_mps == 0.0)
    for first, last in itertools.pairwise(rests):
        begin_s, end_s = float(profile.at_s[first]), float(profile.at_s[last])
        cells = int(np.ceil((end_s - begin_s + over_s) / _CELL_S))
        t_s = np.linspace(begin_s, end_s + over_s, cells + 1)
        now_m, before_m = (profile.place_m(np.clip(t, begin_s, end_s)) for t in (t_s, t_s - over_s))
        mean = (now_m - before_m) / over_s
        mean[-1] = 0.0
        # Evenly from one speed to the next: the sum is the way but for a ten-thousandth part.
        way_m = np.cumsum(0.5 * (mean[1:] + mean[:-1]) * np.diff(t_s))
        length_m = float(profile.s_m[last] - profile.s_m[first])
        s_m.append(profile.s_m[first] + way_m * (length_m / way_m[-1]))
        at_s.append(at_s[-1][-1] + t_s[1:] - begin_s)
        speed.append(mean[1:])
    speeds, times = np.concatenate(speed), np.concatenate(at_s)
    return SpeedProfile(np.concatenate(s_m), speeds, np.diff(speeds) / np.diff(times), times)
