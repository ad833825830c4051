"""Pictures use at most four fifths of a link, and as much of that as their sizes permit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.pictures.link_budget import (
    FORMAT_SHARE,
    FORMATS,
    GOOD_HZ,
    LEAST_HZ,
    SHARE,
    VIDEO_FORMATS,
    LinkBudget,
    PictureFormat,
)

OWN_BYTES, OWN_WIDTH = 60_000, 1280


@dataclass
class Sent:
    at_s: float
    size: int
    chosen: PictureFormat
    arrived_s: float


def watched(
    bytes_per_s: float,
    delay_s: float,
    sockets: int,
    *,
    width: int = 1280,
    video: Callable[[float], float] | None = None,
    jitter_s: float = 0.0,
) -> list[Sent]:
    """Return the pictures of 11 s over a link of constant bandwidth.

    The page has already loaded, and its measured round trip includes the link's queue. H.264 takes
    a fraction `video` of its largest size, which depends on the time.
    """
    budget, sent, random = LinkBudget(), list[Sent](), np.random.default_rng(1)
    free_s = [0.0] * sockets
    link_s, now_s = 1.0, 0.0
    flying: list[tuple[float, int, float]] = []
    while now_s < 11.0:
        now_s += 1.0 / 30.0  # A camera picture.
        for asked_s, size, began_s in [each for each in flying if each[0] <= now_s]:
            queue_s = max(0.0, link_s - now_s)
            budget.add(size, asked_s - began_s, 2.0 * delay_s + queue_s, now_s)
            flying.remove((asked_s, size, began_s))
        socket = min(range(sockets), key=free_s.__getitem__)
        if free_s[socket] > now_s or budget.waits_s(now_s) > 0.0:
            continue
        chosen = budget.format_for(OWN_BYTES, OWN_WIDTH, width, video=video is not None)
        size = round(chosen.bytes_share * OWN_BYTES)
        if video is not None and chosen.is_video:
            size = round(video(now_s) * size)
        budget.sent(size, now_s)
        link_s = max(link_s, now_s) + size / bytes_per_s
        free_s[socket] = link_s + 2.0 * delay_s + jitter_s * random.exponential()
        flying.append((free_s[socket], size, now_s))
        sent.append(Sent(now_s, size, chosen, link_s + delay_s))
    return sent


LINKS = {
    "bytes_per_s": st.floats(6e4, 2e7),
    "delay_s": st.floats(0.001, 0.3),
    "sockets": st.integers(1, 8),
}
VIDEO = st.sampled_from([None, 0.1, 0.5, 1.0])


@given(**LINKS, video=VIDEO)
def test_pictures_leave_a_fifth_of_the_link_to_others(
    bytes_per_s: float, delay_s: float, sockets: int, video: float | None
) -> None:
    sent = watched(bytes_per_s, delay_s, sockets, video=(lambda _: video) if video else None)
    late = [each for each in sent if each.at_s > 5.0]
    used = sum(each.size for each in late) / 6.0
    assert used <= (SHARE + 0.05) * bytes_per_s


@given(**LINKS, video=VIDEO)
def test_a_link_that_carries_a_better_format_at_a_good_rate_gets_it(
    bytes_per_s: float, delay_s: float, sockets: int, video: float | None
) -> None:
    formats = (FORMATS[0], *VIDEO_FORMATS) if video else FORMATS
    fits = [
        each
        for each in formats
        if each.bytes_share * OWN_BYTES * GOOD_HZ <= (FORMAT_SHARE - 0.15) * bytes_per_s
    ]
    newest = watched(bytes_per_s, delay_s, sockets, video=(lambda _: video) if video else None)[-1]
    assert formats.index(newest.chosen) <= formats.index(fits[0] if fits else formats[-1])


@pytest.mark.parametrize(("bytes_per_s", "eighths"), [(125e3, 4), (250e3, 6), (1e6, 8)])
@pytest.mark.parametrize("jitter_s", [0.001, 0.004])
@pytest.mark.parametrize("still", [0.1, 0.3])
def test_a_still_scene_keeps_its_size_and_one_that_moves_again_is_not_late(
    bytes_per_s: float, eighths: int, jitter_s: float, still: float
) -> None:
    sent = watched(
        bytes_per_s, 0.045, 8, video=lambda at_s: still if at_s < 8.0 else 1.0, jitter_s=jitter_s
    )
    seen = [each for each in sent if each.at_s > 5.0]
    assert all(each.chosen.eighths >= eighths for each in seen if each.at_s < 8.0)
    assert all(each.arrived_s - each.at_s < 0.1 for each in seen)


def test_h264_is_for_links_that_do_not_carry_the_jpeg_of_a_pane() -> None:
    for width in (200, 320, 640, 960, 1280, 4000):
        jpeg = watched(1e8, 0.0, 1, width=width)[-1]
        with_h264 = watched(1e8, 0.0, 1, width=width, video=lambda _: 1.0)[-1]
        assert with_h264.chosen == jpeg.chosen
        assert not with_h264.chosen.is_video
        thin = watched(60e3, 0.0, 1, width=width, video=lambda _: 1.0)[-1]
        assert thin.chosen.is_video
        assert thin.chosen.eighths <= jpeg.chosen.eighths


def test_two_megabits_carry_480_pixels_fifteen_times_a_second() -> None:
    late = [each for each in watched(250e3, 0.09, 8) if each.at_s > 5.0]
    assert all(each.chosen.eighths * OWN_WIDTH / 8 >= 480 for each in late)
    assert len(late) / 6.0 >= LEAST_HZ


@pytest.mark.parametrize("width", [200, 320, 640, 960, 1280, 4000])
def test_a_picture_is_no_larger_than_its_pane_needs(width: int) -> None:
    newest = watched(1e8, 0.0, 1, width=width)[-1]
    enough = [each.eighths for each in FORMATS if each.eighths * OWN_WIDTH >= 8 * width]
    assert newest.chosen.eighths == (min(enough) if enough else 8)


def test_before_the_first_answer_a_small_picture_probes_the_link() -> None:
    chosen = LinkBudget().format_for(OWN_BYTES, OWN_WIDTH, 1280)
    assert chosen.bytes_share * OWN_BYTES < 10_000
