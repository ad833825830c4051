"""Colours of what is drawn beside the robot; told apart also by people who see fewer colours."""

from __future__ import annotations

from typing import TypeAlias

Rgb: TypeAlias = tuple[int, int, int]

BRAND: Rgb = (36, 132, 227)
"""Of controls."""
ESTIMATE: Rgb = (36, 132, 227)
"""What the robot believes: trail and covariance."""
SETPOINT: Rgb = (0, 200, 215)
"""What the robot is told."""
TRUTH: Rgb = (60, 190, 90)
"""What a simulator knows."""
OTHER: Rgb = (232, 86, 120)
"""What a robot that has two estimates believes less."""
THRUST: Rgb = (240, 150, 10)
"""What the wheels do over the ground."""
PREVIEW: Rgb = (190, 70, 230)
"""What the robot would do."""
ROUTE: Rgb = (150, 110, 255)
"""Where it is planned to go."""
PREDICTED: Rgb = (235, 80, 160)
"""Where the robot will be."""
ENVELOPE: Rgb = (232, 90, 60)
"""Where the robot can still get to."""
SUSPECT: Rgb = (225, 40, 40)
"""What contradicts all the rest."""
STALE: Rgb = (128, 132, 138)
"""What is not known any more."""
GRID_FINE: Rgb = (128, 134, 142)
GRID_METRE: Rgb = (118, 124, 132)
GRID_LABEL: Rgb = (140, 146, 155)
