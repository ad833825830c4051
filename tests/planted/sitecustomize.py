"""Plant a fault in programs of the package; `python -m tests.planted_faults` sets its name."""

from __future__ import annotations

import asyncio
import os
import sys
import time
from collections.abc import Callable, Coroutine
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

_FAULT = os.environ.get("TEST_PLANTED_FAULT", "")
_EVERY_S = float(os.environ.get("TEST_PLANTED_EVERY_S", "60"))
_TWICE_EVERY = 20


def _loop_sleeps(module: Any) -> None:
    """Let the control loop sleep 120 ms in each interval."""
    step = module.RobotNode.step
    due_s: dict[int, float] = {}

    def sleepy(node: Any, now_s: float, *args: Any) -> None:
        if now_s >= due_s.setdefault(id(node), now_s + _EVERY_S):
            due_s[id(node)] = now_s + _EVERY_S
            time.sleep(0.12)
        step(node, now_s, *args)

    module.RobotNode.step = sleepy


def _dashboard_blocks(module: Any) -> None:
    """Block the event loop of the dashboard for 300 ms in each interval."""
    run: Callable[..., Coroutine[Any, Any, None]] = module.run

    async def blocked(*args: Any, **kwargs: Any) -> None:
        loop = asyncio.get_running_loop()

        def block() -> None:
            time.sleep(0.3)
            loop.call_later(_EVERY_S, block)

        loop.call_later(_EVERY_S, block)
        await run(*args, **kwargs)

    module.run = blocked


def _declared(bus: Any, name: str, part: str) -> set[int]:
    """Record new publishers or queryables whose key contains `part`; return the set of ids."""
    declare, found = getattr(bus, name), set[int]()

    def record(it: Any, key: str, *args: Any, **kwargs: Any) -> Any:
        made = declare(it, key, *args, **kwargs)
        if part in key:
            found.add(id(made))
        return made

    setattr(bus, name, record)
    return found


def _first_command_lost(module: Any) -> None:
    """The first command that a program publishes does not arrive."""
    commands, put = _declared(module.Bus, "publisher", "/cmd/"), module.Publisher.put

    def lose(it: Any, *args: Any, **kwargs: Any) -> None:
        if id(it) in commands:
            commands.discard(id(it))
            return
        put(it, *args, **kwargs)

    module.Publisher.put = lose


def _state_twice(module: Any) -> None:
    """One state in twenty is published twice."""
    states, put = _declared(module.Bus, "publisher", "/state/"), module.Publisher.put

    def twice(it: Any, payload: bytes, attachment: bytes = b"") -> None:
        put(it, payload, attachment)
        # A stamp begins with the number of the state.
        if id(it) in states and int.from_bytes(attachment[:8], "little") % _TWICE_EVERY == 0:
            put(it, payload, attachment)

    module.Publisher.put = twice


def _lease_late(module: Any) -> None:
    """Requests for the lease are served one period later."""
    leases, take = _declared(module.Bus, "queryable", "/srv/lease"), module.Queryable.take_requests
    waiting: dict[int, Any] = {}

    def late(it: Any) -> Any:
        taken = take(it)
        if id(it) not in leases:
            return taken
        before, waiting[id(it)] = waiting.get(id(it), []), taken
        return before

    module.Queryable.take_requests = late


_PLANTS: dict[str, tuple[str, Callable[[ModuleType], None]]] = {
    "loop-sleeps": ("tsd_twin.node.robot_node", _loop_sleeps),
    "dashboard-blocks": ("tsd_twin.dashboard.app", _dashboard_blocks),
    "first-command-lost": ("tsd_twin.bus.session", _first_command_lost),
    "state-twice": ("tsd_twin.bus.session", _state_twice),
    "lease-late": ("tsd_twin.bus.session", _lease_late),
}


class _Planter:
    """Finder that changes one module after it is executed."""

    def __init__(self, module: str, plant: Callable[[ModuleType], None]) -> None:
        self._module, self._plant = module, plant

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target) if name == self._module else None
        if spec is None or spec.loader is None:
            return None
        execute = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            execute(module)
            self._plant(module)

        spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


if _FAULT:
    sys.meta_path.insert(0, _Planter(*_PLANTS[_FAULT]))  # type: ignore[arg-type]
