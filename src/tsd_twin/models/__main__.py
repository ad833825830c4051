"""`python -m tsd_twin.models tsd`: generate meshes and URDF of a robot."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tsd_twin.errors import TwinError
from tsd_twin.models.files import write_model
from tsd_twin.robots import load_robot


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the files, print where, and return the exit status; `arguments` as in a shell."""
    parser = argparse.ArgumentParser(prog="python -m tsd_twin.models", description=__doc__)
    parser.add_argument("robot", help="a shipped robot, or the path of a TOML file")
    parser.add_argument("--to", type=Path, help="folder to write to; meshes/<name> unless given")
    flags = parser.parse_args(arguments)
    try:
        robot = load_robot(flags.robot)
        folder: Path = flags.to or Path("meshes", robot.name)
        write_model(robot, folder)
    except (TwinError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    size = sum(file.stat().st_size for file in folder.iterdir())
    sys.stdout.write(f"{folder}: {size / 1000:.0f} kB\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
