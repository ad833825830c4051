"""Draw all drawings: `python docs/img/draw [FOLDER]`; by default next to this folder."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import adapters
import modes
import omni_wheel
import processes
import router
import side_view
import sphere
import top_view
import wiring
import wiring_plan

DRAWINGS = {
    "adapters": adapters.draw,
    "modes": modes.draw,
    "omni_wheel": omni_wheel.draw,
    "processes": processes.draw,
    "router": router.draw,
    "side_view": side_view.draw,
    "sphere": sphere.draw,
    "top_view": top_view.draw,
    "wiring": wiring.draw,
    "wiring_bus_wheels": partial(wiring_plan.draw, "bus_wheels"),
    "wiring_can_wheels": partial(wiring_plan.draw, "can_wheels"),
    "wiring_mega": partial(wiring_plan.draw, "mega"),
    "wiring_u2d2_can": partial(wiring_plan.draw, "u2d2_can"),
}


def main(folder: Path) -> None:
    """Write every drawing into `folder`."""
    for name, draw in DRAWINGS.items():
        (folder / f"{name}.svg").write_text(draw(), encoding="utf-8")


main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent.parent)
