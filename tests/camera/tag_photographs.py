"""Tags that are found in photographs: `python -m tests.camera.tag_photographs FOLDER`.

The folder is `test/data` of https://github.com/AprilRobotics/apriltag: three photographs of NASA
(CC BY-SA 2.0), each with a list of tags, one a line: number and corners.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import cv2
import numpy as np

from tsd_twin.camera.detect import Gray, find_tags
from tsd_twin.camera.lens import Lens
from tsd_twin.lie import Array

_NEAR_PX = 4.0
_NUMBER = re.compile(r"[\d.]+")
_ACROSS_DEG = 60.0
"""Any angle: without distortion, edges are straight lines."""
_HALF_PX = 0.5
"""AprilTag counts pixels from their corner, OpenCV from their centre."""


def listed(file: Path) -> list[tuple[int, Array]]:
    """Return number and corners (4, 2) of each tag in a list."""
    rows = [[float(each) for each in _NUMBER.findall(line)] for line in file.open()]
    return [(int(row[0]), np.array(row[1:9]).reshape(4, 2) - _HALF_PX) for row in rows if row]


def distance_px(corners: Array, others: Array) -> float:
    """Return the largest distance of two corners, whichever comes first."""
    orders = [np.roll(others, first, axis=0)[::way] for first in range(4) for way in (1, -1)]
    return float(min(np.linalg.norm(corners - each, axis=1).max() for each in orders))


def compare(picture: Gray, tags: list[tuple[int, Array]]) -> tuple[int, int, list[int]]:
    """Return how many tags of a list are found, how many others, and the numbers of those."""
    left, others = list(tags), list[int]()
    lens = Lens.ideal(picture.shape[1], picture.shape[0], _ACROSS_DEG)
    for seen in find_tags(picture, ["36h11"], lens):
        near = [i for i, (_, each) in enumerate(left) if distance_px(seen.corners, each) < _NEAR_PX]
        if near and left[near[0]][0] == seen.number:
            del left[near[0]]
        else:
            others.append(seen.number)
    return len(tags) - len(left), len(tags), others


def main() -> None:
    """Print the counts of each photograph; the number of all tags in them is 0."""
    for file in sorted(Path(sys.argv[1]).glob("*.jpg")):
        picture = np.asarray(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), np.uint8)
        found, count, others = compare(picture, listed(file.with_suffix(".txt")))
        sys.stdout.write(f"{file.name}: {found} of {count}, others with numbers {others}\n")


if __name__ == "__main__":
    main()
