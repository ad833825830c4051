"""Print how a shadow twin names faults on the independent plants.

`python -m tests.independent.names` prints a row per kind of fault, then the sound robots.
The bound next to each row is a test that knows the part, its size and the time of the fault, with
the same threshold, noise and learned robot.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.independent.faulty import LOSS, SLIP_RAD, Fault, Recorded, record
from tsd_twin import robots
from tsd_twin.kinematics import JointKind
from tsd_twin.shadow import ShadowTwin
from tsd_twin.shadow.fault_filter import EVIDENCE, START_EVIDENCE

WITHIN_S = 10.0
VISIBLE_LOSS = 0.6 * LOSS
"""Speed loss of a `tsd` wheel in motion, where the floor and other wheels drag it along."""
_BEGIN_S = 15.0
"""Start of a fault during a drive, when the twin has already learned the robot."""
KINDS: dict[str, Fault] = {
    "tsd: wheel 5 % slow": Fault("tsd", "wheel", _BEGIN_S),
    "the same, from the start": Fault("tsd", "wheel"),
    "the same, drives of 4 s": Fault("tsd", "wheel", _BEGIN_S, "stops"),
    "the same, 1.5 s in 4": Fault("tsd", "wheel", _BEGIN_S, intermittent=True),
    "tsd: two wheels 5 % slow": Fault("tsd", "wheel+wheel", _BEGIN_S),
    "tsd: horn slips by 0.5°": Fault("tsd", "zero", _BEGIN_S),
    "the same, from the start ": Fault("tsd", "zero"),
    "tsd: servo 30 % slow, full stick": Fault("tsd", "servo", _BEGIN_S, "stick"),
    "tsd: module turned by 8° (not in the bank)": Fault("tsd", "mount", _BEGIN_S),
    "kiwi: wheel 5 % slow": Fault("kiwi", "wheel", _BEGIN_S),
    "kiwi: wheel worn by 5 %": Fault("kiwi", "radius", _BEGIN_S),
    "the same, from the start, no integral part": Fault("kiwi", "radius", integral=False),
    "mecanum: wheel worn by 5 %, no integral part": Fault(
        "mecanum", "radius", _BEGIN_S, integral=False
    ),
    "omni4: wheel 5 % slow, no integral part": Fault("omni4", "wheel", _BEGIN_S, integral=False),
    "omni4: wheel turned by 8° (not in the bank)": Fault("omni4", "mount", _BEGIN_S),
}
SOUND = [
    Fault(robot, drive=drive, integral=integral)
    for robot in ("tsd", "kiwi", "omni4", "mecanum", "atlas")
    for drive in ("wander", "stops", "stick")
    for integral in ((True,) if robot == "tsd" else (True, False))
    if not (robot == "atlas" and drive != "wander")
]


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of a run."""

    right_s: float
    """Time from the fault until all its parts, and no other, are named; infinite if never."""
    wrong: tuple[str, ...]
    """Sentences with a name that is not faulty."""
    unknown: bool
    """Whether an unknown part was reported."""
    bound_s: float
    """Time until the best test would know; infinite if it cannot."""
    seconds: float
    processor_share: float


def watch(drive: Recorded) -> Outcome:
    """Let a twin follow a recorded drive."""
    robot = robots.load_robot(drive.robot)
    twin: Any = ShadowTwin(robot)
    status: Any = SimpleNamespace(pose_sensor=SimpleNamespace(hz=30.0), hardware={})
    begin_s = drive.fault.begin_s
    right_s, wrong, unknown, bound = math.inf, dict[str, None](), False, _Bound(drive, twin)
    began = time.process_time()
    for i, (stamp_ns, joints, setpoint, odom) in enumerate(drive.messages()):
        t_s = float(drive.stamps_s[i]) - begin_s
        bound.follow(t_s)
        twin.advance(stamp_ns, joints, setpoint, odom, status)
        if i % 5:
            continue
        drifts = twin.drifts()
        named = {each.part for each in drifts if each.part}
        unknown = unknown or any(not each.part for each in drifts)
        if named and named == set(drive.parts) and t_s >= 0.0:
            right_s = min(right_s, t_s)
        false = named - set(drive.parts) if t_s >= 0.0 else named
        wrong.update({each.text: None for each in drifts if each.part in false})
    seconds = float(drive.stamps_s[-1] - drive.stamps_s[0])
    share = (time.process_time() - began) / seconds
    return Outcome(right_s, tuple(wrong), unknown, bound.time_s, seconds, share)


class _Bound:
    """Test that knows time, part and size of a fault of wheels or gimbal zeros.

    It has the log-likelihood ratio that is expected of the innovations of the twin's own filter.
    """

    def __init__(self, drive: Recorded, twin: Any) -> None:
        fault = drive.fault
        self.time_s = math.inf
        self.is_known = bool(fault.kind) and fault.kind not in ("servo", "mount")
        if not self.is_known:
            return
        self._t_s, self._wanted = -math.inf, EVIDENCE if fault.begin_s else START_EVIDENCE
        speeds, motion = twin.fault_filters
        self._filter: Any = speeds if speeds and fault.kind == "wheel" else motion
        joints = robots.load_robot(drive.robot).kinematics().joints
        is_angle = [joint.kind is JointKind.POSITION for joint in joints]
        columns = sorted(range(len(joints)), key=lambda i: is_angle[i])  # The wheels first.
        self._truth = np.zeros(len(self._filter.scale))
        for part in drive.parts:
            loss = VISIBLE_LOSS if fault.robot == "tsd" and fault.kind != "radius" else LOSS
            size = SLIP_RAD if fault.kind == "zero" else loss
            self._truth[columns.index(drive.names.index(part))] = size
        self._learned = np.zeros((len(self._filter.sigma), len(self._truth)))
        self._ratio = 0.0
        self._add, self._predict = self._filter.add, self._filter.predict
        self._filter.add, self._filter.predict = self.add, self.predict

    def follow(self, t_s: float) -> None:
        self._t_s = t_s

    def predict(self, kept: np.ndarray, walk: np.ndarray, source: Any = None) -> None:
        self._predict(kept, walk, source)
        if source is not None:
            self._learned = self._learned[source]
        self._learned = kept[:, None] * self._learned

    def add(
        self, error: np.ndarray, rows: np.ndarray, columns: np.ndarray, noise: np.ndarray
    ) -> None:
        if self._t_s >= 0.0 and not math.isfinite(self.time_s):
            crossed = rows @ self._filter.covariance
            solve = np.linalg.inv(crossed @ rows.T + noise)
            shown = columns - rows @ self._learned
            self._learned += crossed.T @ solve @ shown
            self._ratio += 0.5 * float((shown @ self._truth) @ solve @ (shown @ self._truth))
            if self._ratio >= self._wanted:
                self.time_s = self._t_s
        self._add(error, rows, columns, noise)


def run(work: tuple[Fault, int, int, float]) -> list[Outcome]:
    """Drive some robots of a kind, and watch them."""
    return [watch(drive) for drive in record(*work)]


def summary(fault: Fault, outcomes: Sequence[Outcome]) -> list[str]:
    """Return the cells of a row."""
    found = sorted(each.right_s for each in outcomes)
    able = [each for each in outcomes if each.bound_s <= WITHIN_S]
    has_bound = fault.kind not in ("servo", "mount")
    within = sum(each.right_s <= WITHIN_S for each in outcomes)
    both = sum(each.right_s <= WITHIN_S for each in able)
    middle = found[len(found) // 2]
    return [
        f"{len(outcomes)}",
        f"{within}",
        f"{both} of {len(able)}" if has_bound else "-",
        "never" if math.isinf(middle) else f"{middle:.1f} s",
        f"{sum(bool(each.wrong) for each in outcomes)}",
        f"{sum(each.unknown for each in outcomes)}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="runs of each kind of fault")
    parser.add_argument("--minutes", type=float, default=120.0, help="of sound robots, in all")
    parser.add_argument("--seed", type=int, default=40_000, help="100 to 400 are for tuning")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    began, shares, said = time.monotonic(), [0.0], list[str]()
    with ProcessPoolExecutor(args.jobs) as pool:
        if args.runs:
            print("| fault | runs | named within 10 s | named, if the bound detects it | median |"
                  " wrong names | unknown part |\n" + "| --- " * 7 + "|")  # fmt: skip
        for i, (name, fault) in enumerate(KINDS.items()) if args.runs else ():
            seconds = fault.begin_s + 1.5 * WITHIN_S
            work = [
                (fault, min(4, args.runs - k), args.seed + 1000 * i + k, seconds)
                for k in range(0, args.runs, 4)
            ]
            outcomes = [each for group in pool.map(run, work) for each in group]
            print("|", " | ".join([name.strip(), *summary(fault, outcomes)]), "|", flush=True)
            said += [f"{name}: {text}" for each in outcomes for text in each.wrong]
            shares += [each.processor_share for each in outcomes]
        each_s = 60.0 * args.minutes / (3 * len(SOUND))
        work = [
            (fault, 3, args.seed + 100_000 + 10 * i, each_s)
            for i, fault in enumerate(SOUND)
            if args.minutes
        ]
        minutes, unknown = 0.0, 0
        for (fault, *_), outcomes in zip(work, pool.map(run, work), strict=True):
            minutes += sum(each.seconds for each in outcomes) / 60.0
            unknown += sum(each.unknown for each in outcomes)
            said += [f"sound {fault}: {text}" for each in outcomes for text in each.wrong]
            shares += [each.processor_share for each in outcomes]
            if any(each.unknown for each in outcomes):
                said.append(f"sound {fault}: unknown part")
    print(f"sound robots: {minutes:.0f} min, {unknown} with an unknown part")
    print(*said, sep="\n")
    print(f"twin: up to {100.0 * max(shares):.1f} % of a core; {time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
