"""Poses of nodes are set as viser sets them, message by message."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from tsd_twin.dashboard.scene import viser_compat

pytestmark = pytest.mark.computes

NUMBERS = st.floats(-100.0, 100.0) | st.sampled_from([0.0, 1e-8, 1e-7, 1.0, 1.00001, 1.0001])
STEPS = st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=12)


def sent(setter: Any, steps: list[tuple[float, float, float]]) -> tuple[list[Any], list[float]]:
    """Return what is queued, and where the node is in the end."""
    current, queued = np.zeros(3), []
    for step in steps:
        setter(current, step, 3, queued.append, lambda said: said)
    return queued, current.tolist()


@given(STEPS)
def test_the_same_messages_are_sent(steps: list[tuple[float, float, float]]) -> None:
    assert sent(viser_compat.set_pose_vector, steps) == sent(viser_compat.ORIGINAL_SETTER, steps)


def test_an_array_is_as_good_and_another_length_is_a_mistake() -> None:
    assert sent(viser_compat.set_pose_vector, [np.array([1.0, 2.0, 3.0])]) == (  # type: ignore[list-item]
        [(1.0, 2.0, 3.0)],
        [1.0, 2.0, 3.0],
    )
    with pytest.raises(ValueError, match="2 numbers are given, 3 are needed"):
        sent(viser_compat.set_pose_vector, [(1.0, 2.0)])  # type: ignore[list-item]


def test_nodes_are_set_so() -> None:
    viser_compat.install_fast_pose_setter()
    scene = vars(sys.modules[viser.SceneNodeHandle.__module__])
    assert viser_compat.set_pose_vector in scene.values()
