"""Words on the floor."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.scene.scene import text_lines

words = st.text("0123456789-m xy", min_size=1).filter(str.strip)
lengths = st.floats(0.01, 10.0)


@given(word=words, x=st.floats(-9.0, 9.0), y=st.floats(-9.0, 9.0), height=lengths)
def test_a_word_moves_and_grows_as_a_whole(word: str, x: float, y: float, height: float) -> None:
    plain = text_lines(word, (0.0, 0.0), 1.0)
    np.testing.assert_allclose(text_lines(word, (x, y), height), height * plain + (x, y), atol=1e-9)


def test_no_digit_looks_like_another() -> None:
    drawn = {digit: text_lines(digit, (0.0, 0.0), 1.0) for digit in "0123456789-"}
    shapes = [{frozenset(map(tuple, line)) for line in lines} for lines in drawn.values()]
    assert all(one != other for one, other in itertools.combinations(shapes, 2))


@pytest.mark.parametrize("letter", "0123456789")
def test_who_looks_along_x_reads_it_upright(letter: str) -> None:
    """Height goes along +X, and the next letter is at the right hand: towards -Y."""
    one = text_lines(letter, (0.0, 0.0), 1.0)
    assert one[..., 0].min() == 0.0
    assert one[..., 0].max() == 1.0
    two = text_lines(letter * 2, (0.0, 0.0), 1.0)
    np.testing.assert_array_equal(two[: len(one)], one)
    assert two[len(one) :, :, 1].max() < one[..., 1].min()
