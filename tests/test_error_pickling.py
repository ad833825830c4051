"""Each error of the package can be raised in a worker and read by the waiting process."""

from __future__ import annotations

import importlib
import inspect
import pickle
import re
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from hypothesis import given
from hypothesis import strategies as st

import tsd_twin
from tsd_twin.client.errors import RequestRefused
from tsd_twin.errors import CodedReason, TwinError
from tsd_twin.messages.codes import Reason

ARGUMENTS: dict[Any, st.SearchStrategy[Any]] = {
    CodedReason | None: st.none()
    | st.builds(Reason, st.text(), st.dictionaries(st.text(), st.floats(0, 1))),
    Sequence[str]: st.lists(st.text(), min_size=1),
    str | Reason: st.text() | st.just(Reason("no_control")),
}
"""Strategies of types that need a specific one."""


def error_types() -> list[type[TwinError]]:
    """Return all errors defined in the package source."""
    package = Path(tsd_twin.__file__).parent
    found: list[type[Exception]] = []
    for path in sorted(package.rglob("*.py")):
        names = re.findall(
            r"^class (\w+)\(\w*(?:Error|Exception)\b", path.read_text(), re.MULTILINE
        )
        if names:
            parts = path.relative_to(package.parent).with_suffix("").parts
            module = importlib.import_module(".".join(parts))
            found += [getattr(module, name) for name in names]
    return [each for each in found if issubclass(each, TwinError)]


@pytest.mark.parametrize("kind", error_types(), ids=lambda kind: kind.__name__)
@given(st.data())
def test_an_error_keeps_its_text_its_attributes_and_its_notes(
    kind: type[TwinError], data: st.DataObject
) -> None:
    own = inspect.isfunction(kind.__init__)  # Otherwise that of the built-in class.
    hints = get_type_hints(kind.__init__) if own else {"text": str}
    names = inspect.signature(kind).parameters if own else hints
    values = [data.draw(ARGUMENTS.get(hints[name], st.from_type(hints[name]))) for name in names]
    error = kind(*values)
    error.add_note("said by the worker")
    copy = pickle.loads(pickle.dumps(error))  # noqa: S301  Our own bytes.
    assert type(copy) is kind
    assert (copy.args, vars(copy)) == (error.args, vars(error))


def refuse() -> None:
    """Raise an error whose arguments differ from its base class."""
    raise RequestRefused("lab1", "arm", "no control", Reason("no_control"))


def test_a_pool_of_processes_survives_an_error_of_a_worker() -> None:
    with ProcessPoolExecutor(1) as pool:
        with pytest.raises(RequestRefused, match="lab1 refuses to arm"):
            pool.submit(refuse).result()
        assert pool.submit(abs, -1).result() == 1
