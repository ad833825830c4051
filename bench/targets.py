"""Targets of all benchmarks: one row each, in the order of the report."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """Limit of the ratio of a subject to its peer."""

    limit: float
    subject: str
    peer: str
    unit: str
    physics: str = ""
    """Reason for a peer that is a constant, independent of the machine's speed."""
    at_least: bool = False
    provisional: bool = True
    """Whether the limit still needs measurements on a quiet machine."""


_CPU = "ms CPU/s"

TARGETS: dict[str, Target] = {
    "kinematics.batch": Target(0.5, "a twist of a million", "wpimath", "us"),
    "kinematics.single": Target(8, "single call", "wpimath", "us"),
    "simulation.step": Target(2, "controller and plant", "plant alone", "us"),
    "simulation.drive": Target(3, "SimulatedRobot driving", "plant alone", "ms CPU/s"),
    "simulation.idle": Target(3, "SimulatedRobot idle", "plant alone", "ms CPU/s"),
    "simulation.batch": Target(4, "limits, plant and odometry", "plant alone", "us/robot"),
    "simulation.squares": Target(4, "open-loop square", "plant alone", "us/robot"),
    "simulation.growth": Target(1.01, "objects after a drive", "after its start", ""),
}
