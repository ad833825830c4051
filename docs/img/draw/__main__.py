"""Draw all drawings: `python docs/img/draw [FOLDER]`; by default next to this folder."""

from __future__ import annotations

import sys
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
}


def main(folder: Path) -> None:
    """Write every drawing into `folder`."""
    for name, draw in DRAWINGS.items():
        (folder / f"{name}.svg").write_text(draw(), encoding="utf-8")


main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent.parent)
