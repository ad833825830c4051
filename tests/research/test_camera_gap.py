"""After a camera gap while driving, right poses are accepted again and wrong ones never.

A few robots of `python -m research camera-gap`, with other seeds than the table in the docs.
"""

from __future__ import annotations

import numpy as np
import pytest

from research.camera_gap import Picture, run_case
from research.open_loop import Case


@pytest.mark.parametrize("manoeuvre", ["straight 0.5 m/s", "wander"])
def test_after_20_s_right_poses_are_believed_within_a_second_and_wrong_ones_not(
    manoeuvre: str,
) -> None:
    """With these seeds, a single outlier was accepted before, and no right pose afterwards."""
    case = Case("tsd", manoeuvre, 1.0, seeds=3, first=102)
    pictures = (Picture.GOOD, Picture.OUTLIERS, Picture.MIRRORED, Picture.FROZEN)
    for result in run_case(case, pictures=pictures):
        assert not result.misled.any()
        assert (result.believed_s < 1.0).all() == result.picture.is_right


def test_a_picture_that_is_shifted_mirrored_or_frozen_does_not_move_a_known_pose() -> None:
    case = Case("tsd", "circle", 1.0, seeds=2, first=100)
    for result in run_case(case, gap_s=0.0):
        assert not result.misled.any()
        if result.picture.is_right:
            np.testing.assert_array_equal(result.believed_s, 0.0)
