"""The playback cursor advances at its speed, stays in range, and pauses at the end."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.recording.player import PlaybackCursor

ACTS = st.one_of(
    st.tuples(st.just("play"), st.floats(-1.0, 100.0)),
    st.tuples(st.just("pause"), st.just(0.0)),
    st.tuples(st.just("seek"), st.floats(-10.0, 30.0)),
    st.tuples(st.just("wait"), st.floats(0.0, 5.0)),
)


@given(st.lists(ACTS, max_size=30))
def test_the_cursor_is_where_speed_and_jumps_lead_it(acts: list[tuple[str, float]]) -> None:
    now_s, expected_s, speed = 100.0, 0.0, 0.0
    playback = PlaybackCursor(20.0, now_s)
    for what, value in acts:
        if what == "play":
            playback.play(value, now_s)
            speed = min(max(value, 0.1), 16.0)
            expected_s = 0.0 if expected_s >= 20.0 else expected_s
        elif what == "pause":
            playback.pause(now_s)
            speed = 0.0
        elif what == "seek":
            playback.seek(value, now_s)
            expected_s = min(max(value, 0.0), 20.0)
        else:
            now_s += value
            expected_s = min(20.0, expected_s + speed * value)
        t_s = playback.t_s(now_s)
        assert abs(t_s - expected_s) < 1e-9
        if expected_s >= 20.0:
            speed = 0.0
        assert playback.playing == (speed > 0.0)


def test_a_recording_that_grows_plays_on() -> None:
    playback = PlaybackCursor(10.0, 0.0)
    playback.play(1.0, 0.0)
    playback.duration_s = 30.0
    assert playback.t_s(15.0) == 15.0
    assert playback.playing
