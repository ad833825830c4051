"""Pictures over 2 Mbit/s with 90 ms of round trip and 2 % loss, ten minutes in virtual time."""

from __future__ import annotations

import pytest

from tests.dashboard.pictures.thin_link import THIN, Page, added_ms

TEN_MINUTES_S = 600.0


@pytest.mark.parametrize(("seed", "lag_s"), [(100, 0.0), (101, 0.003), (102, 0.008)])
def test_pictures_of_480_pixels_are_rarely_older_than_300_ms(seed: int, lag_s: float) -> None:
    seen = Page(THIN, seed, TEN_MINUTES_S, lag_s=lag_s).run()
    assert seen.narrow < 0.01
    assert seen.rate_hz > 16.0
    assert seen.old < 0.005


def test_h264_is_wider_and_not_later_unless_one_encoder_serves_all_sockets() -> None:
    """A lost segment must not stall pictures on other WebSockets."""
    seen, chained = (
        Page(THIN, 100, 120.0, lag_s=0.003, video=True, in_order=in_order).run()
        for in_order in (False, True)
    )
    assert seen.rate_hz > 20.0
    assert min(seen.widths) == 960
    assert seen.old < 0.005
    assert chained.old > 0.05


def test_pictures_delay_commands_by_less_than_their_own_time() -> None:
    """Without loss, whose time-outs of 200 ms hide all else."""
    lossless = THIN.replace("loss=2%,", "")
    assert added_ms(lossless, 100, 120.0) < 30.0
