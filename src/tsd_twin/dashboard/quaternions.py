"""Products of unit quaternions in three calls of numpy: for few of them at a time, and often.

`SO3` does the same one number after another, which is quick for thousands and slow for six.
"""

from __future__ import annotations

import numpy as np

from tsd_twin.lie import Array

_UNITS = np.eye(4)
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def _hamilton() -> Array:
    """Return T (4, 4, 4) so that the product of a and b is the sum of a_i b_j T_ij."""
    w, x, y, z = _UNITS
    return np.array([[w, x, y, z], [x, -w, z, -y], [y, -z, -w, x], [z, y, -x, -w]])


_T = _hamilton()
_PRODUCT = _T.reshape(16, 4)


def product(a: Array, b: Array) -> Array:
    """Return the turns a b (..., 4): b first, then a."""
    return pairs(a, b) @ _PRODUCT


def pairs(a: Array, b: Array) -> Array:
    """Return all products of a number of a and one of b (..., 16)."""
    both = a[..., :, None] * b[..., None, :]
    return both.reshape(*both.shape[:-2], 16)


def turner(vectors: Array) -> Array:
    """Return M (..., 16, 3) so that `pairs(q, q) @ M` are `vectors` (..., 3) turned by q."""
    pure = np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)
    made = np.einsum("ijk,...j,klm->...ilm", _T, pure, _T * _CONJUGATE[:, None])
    return made.reshape(*vectors.shape[:-1], 16, 4)[..., 1:]
