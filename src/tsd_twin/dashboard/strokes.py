"""Words on the floor, drawn in lines: what a scale needs, and no more."""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array

_ADVANCE = 0.75
"""Width of a letter with its gap, in heights."""
_LOW, _MID, _HIGH, _LEFT, _RIGHT = 0.0, 0.5, 1.0, 0.0, 0.5
_BARS = {
    "a": (_LEFT, _HIGH, _RIGHT, _HIGH),
    "b": (_RIGHT, _HIGH, _RIGHT, _MID),
    "c": (_RIGHT, _MID, _RIGHT, _LOW),
    "d": (_LEFT, _LOW, _RIGHT, _LOW),
    "e": (_LEFT, _LOW, _LEFT, _MID),
    "f": (_LEFT, _MID, _LEFT, _HIGH),
    "g": (_LEFT, _MID, _RIGHT, _MID),
    "h": (0.25, _LOW, 0.25, _MID),
    "i": (_LEFT, _LOW, _RIGHT, _MID),
    "j": (_LEFT, _MID, _RIGHT, _LOW),
    "k": (_LEFT, _MID, 0.25, 0.2),
    "l": (_LEFT, -0.2, _RIGHT, _MID),
}
"""The seven bars of a clock's digit, a to g, and a few for letters: x and y from, x and y to."""
_LETTERS = {
    "0": "abcdef",
    "1": "bc",
    "2": "abged",
    "3": "abgcd",
    "4": "fgbc",
    "5": "afgcd",
    "6": "afgedc",
    "7": "abc",
    "8": "abcdefg",
    "9": "abcdfg",
    "-": "g",
    "m": "eghc",
    "x": "ij",
    "y": "kl",
    " ": "",
}


def strokes(text: str, at_m: tuple[float, float], height_m: float) -> Array:
    """Return the lines (n, 2, 2) of a word on the floor, upright for who looks along +X.

    It starts to the right of `at_m` and stands on it. Letters are digits, minus, m, x and y.
    """
    lines = [
        (np.reshape(_BARS[bar], (2, 2)) + np.array([i * _ADVANCE, 0.0])) * height_m
        for i, letter in enumerate(text)
        for bar in _LETTERS[letter]
    ]
    right_up = np.array(lines)
    # Right is -Y, up is +X.
    return np.stack([right_up[..., 1], -right_up[..., 0]], axis=-1) + np.array(at_m)
