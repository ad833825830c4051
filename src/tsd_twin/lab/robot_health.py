"""Health of a robot by its shadow twin: named parts, and the lines to print."""

from __future__ import annotations

from dataclasses import dataclass, field

from tsd_twin.cli import experiment
from tsd_twin.client.state import RobotState
from tsd_twin.messages.sentences import full_sentence
from tsd_twin.shadow import Drift, ShadowReport, ShadowTwin

_REPORT_S = 0.1


@dataclass(slots=True)
class Health:
    """Shadow twin with the named parts and its latest report."""

    twin: ShadowTwin
    report: ShadowReport = field(default_factory=lambda: ShadowReport(0.0))
    named: list[tuple[float, Drift]] = field(default_factory=list[tuple[float, Drift]])
    """Each part once, with the time at which it was first named."""
    compared_s: float = 0.0
    _next_s: float = 0.0

    def feed(self, state: RobotState) -> None:
        """Pass the state of a robot to the twin."""
        at_ns, odom = state.joints.stamp_ns, state.odom.message
        self.twin.advance(at_ns, state.joints, state.setpoint, odom, state.status)

    def look(self, t_s: float, *, last: bool = False) -> None:
        """Create a report every `_REPORT_S`, and if this is the `last`."""
        if t_s < self._next_s and not last:
            return
        self._next_s = t_s + _REPORT_S
        report = self.twin.report()
        known = {drift.part for _, drift in self.named}
        self.named += [(t_s, drift) for drift in report.drifts if drift.part not in known]
        self.compared_s += max(0.0, report.compared_s - self.report.compared_s)
        self.report = report


def lines(health: Health, what: str) -> list[str]:
    """Return the lines to print for a robot."""
    report = health.report
    lines = [f"{what}, compared for {health.compared_s:.1f} s"]
    if not report.joints:
        return [*lines, "no joints: nothing can be compared"]
    lines += experiment.markdown_table(
        ["joint", "measured", "simulated", "difference", "band", ""],
        [
            [
                joint.name,
                "-" if joint.measured is None else f"{joint.measured:.2f} {joint.unit}",
                f"{joint.simulated:.2f} {joint.unit}",
                "-" if joint.measured is None else f"{joint.measured - joint.simulated:.2f}",
                f"±{joint.band:.2f}",
                "not measured" if joint.measured is None else _inside(joint.inside),
            ]
            for joint in report.joints
        ],
    )
    if report.pose is not None:
        pose = report.pose
        rows = zip(pose.names, pose.units, pose.difference, pose.band, strict=True)
        lines += [
            f"motion of the last second, {name}: {value:.1f} {unit} off, ±{band:.1f} allowed"
            for name, unit, value, band in rows
        ]
    lines += [f"{t_s:.1f} s: {drift.text}" for t_s, drift in health.named]
    if not health.named:
        lines.append("no part drifts")
    return [*lines, full_sentence(report.note)] if report.note else lines


def _inside(inside: bool) -> str:
    return "inside" if inside else "OUTSIDE"
