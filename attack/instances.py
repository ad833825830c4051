"""A robot and its replay on two buses, with one dashboard: Arm, driving and STOP.

`python -m attack.instances --runs 10 --robots tsd,kiwi`
"""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from attack.distances import ATTEMPTS, HASTE, quick_description
from attack.live import program
from attack.scenes import ANY_PORT
from attack.table import Row
from attack.track import TruthRecorder
from tests.support.page_client import Page
from tests.support.recorded_drives import RecordedDrive
from tsd_twin import robots
from tsd_twin.bus import Bus, client_config
from tsd_twin.errors import TwinError
from tsd_twin.recording.mcap_file import RecordingFile
from tsd_twin.robots import RobotDescription

DRIVER, VIEWER = "00000000000000aa", "00000000000000bb"
PATIENCE_S = 20.0
HELD_S = 1.0
"""Time for which the stick is held while the id is shared."""
UNMOVED_M = 0.001


@dataclass
class Stage:
    """Live robot, dashboard on its bus and a second one, and a page that drives."""

    robot: RobotDescription
    live: TruthRecorder
    driver: Page
    dashboard_port: int
    recording: Path
    replay_endpoint: str

    def replay(self, replay_id: str) -> contextlib.AbstractContextManager[object]:
        """Replay the recording on the second bus."""
        flags = ("--listen", self.replay_endpoint, "--id", replay_id, "--loop")
        return _ready("tsd_replay", str(self.recording), *flags)

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for the driver's page or the live robot.

        Raises:
            TimeoutError: If the condition remains false.
        """
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end_s:
                raise TimeoutError(f"never {what}")
            time.sleep(0.01)


@contextlib.contextmanager
def _ready(*arguments: str) -> Generator[str]:
    with program(*arguments) as started:
        yield started.ready()


@contextlib.contextmanager
def staged(name: str, folder: Path) -> Generator[Stage]:
    """Start a robot and a dashboard; its page has control."""
    robot, text = quick_description(name)
    toml, recording = folder / f"{name}.toml", folder / f"{name}.mcap"
    toml.write_text(text, encoding="utf-8")
    file = RecordingFile(recording)
    RecordedDrive(file, name, name).circle(2)
    file.close()
    with contextlib.ExitStack() as stack:
        enter = stack.enter_context
        # A finished replay determines a free port that the dashboard knows.
        with _ready("tsd_replay", str(recording), "--listen", ANY_PORT) as line:
            (replay_endpoint,) = re.findall(r"tcp/[\d.:]+", line)
        line = enter(_ready("tsd_mock", "--listen", ANY_PORT, "--robot", str(toml), "--id", name))
        (endpoint,) = re.findall(r"tcp/[\d.:]+", line)
        bus = enter(Bus(client_config([endpoint])))
        live = TruthRecorder(bus, name, robot.kinematics())
        joined = ("--connect", endpoint, "--connect", replay_endpoint)
        line = enter(_ready("tsd_dashboard", "--port", "0", *joined))
        (port,) = (int(found) for found in re.findall(r"http://\S+:(\d+)", line))
        driver = Page(port, DRIVER)
        stack.callback(driver.close)
        yield Stage(robot, live, driver, port, recording, replay_endpoint)


def stop_with_replay_in_view(stage: Stage) -> float:
    """Press STOP on a page that shows a replay, at full speed; return the travel, m.

    Raises:
        AssertionError, TimeoutError: If the live robot is not stopped, or not confirmed.
    """
    name, driver = stage.robot.name, stage.driver
    viewer = Page(stage.dashboard_port, VIEWER)
    with contextlib.closing(viewer), stage.replay("yesterday"):
        viewer.until(lambda: any(r["id"] == "yesterday" for r in viewer.last("welcome")["robots"]))
        viewer.send(t="robot", id="yesterday")
        viewer.until(lambda: viewer.state["source"] == "recording")
        driver.send(t="robot", id=name)
        driver.until(lambda: driver.last("robot")["id"] == name)
        _get_fast(stage)
        pressed_s = time.monotonic()
        answer = viewer.answer("stop", t="stop")
        assert answer["ok"], answer["reason"]
        assert viewer.state["source"] == "recording"
        stage.until(lambda: stage.live.status.mode == "stopped", "stopped")
        driver.let_go()
        stage.live.track.until_rest_after(pressed_s + 0.5)
        return stage.live.track.distance_since(pressed_s)


def _get_fast(stage: Stage) -> None:
    """Drive at the speed limit; retry if a busy machine stops the robot.

    Raises:
        TimeoutError: If it is stopped each time.
    """
    driver = stage.driver
    for _ in range(ATTEMPTS):
        driver.make_ready()
        limit_mps = driver.state["status"]["limits"]["speed_mps"]
        driver.drive(HASTE * limit_mps / stage.robot.kinematics().twist_scale_m)
        try:
            stage.live.track.until_fast(limit_mps)
        except TimeoutError:
            driver.let_go()
            stage.until(lambda: stage.live.status.mode not in ("driving", "stopping"), "at rest")
        else:
            return
    raise TimeoutError(f"never at full speed, {ATTEMPTS} times in a row")


def arm_with_shared_id(stage: Stage) -> float:
    """Arm, hold the stick and press STOP while a replay has the robot's id; return the travel, m.

    Raises:
        AssertionError, TimeoutError: If the robot arms, or the live robot is not stopped.
    """
    driver, live = stage.driver, stage.live
    driver.until(lambda: driver.take(take_over=True)["ok"])
    if live.status.mode in ("stopped", "fault"):
        driver.until(lambda: driver.answer("reset", t="reset")["ok"])
    stage.until(lambda: live.status.mode == "disarmed", "disarmed")
    with stage.replay(stage.robot.name):
        driver.until(lambda: driver.state["source"] == "several")
        began_s = time.monotonic()
        answer = driver.answer("arm", t="arm")
        assert not answer["ok"], "Arm was accepted"
        driver.holds = {"vx": 0.2, "vy": 0.0, "omega": 0.0}
        time.sleep(HELD_S)
        driver.let_go()
        assert live.status.mode == "disarmed", f"the live robot is {live.status.mode}"
        answer = driver.answer("stop", t="stop")
        assert answer["ok"], answer["reason"]
        stage.until(lambda: live.status.mode == "stopped", "stopped")
        travel_m = live.track.distance_since(began_s)
    driver.until(lambda: driver.state["source"] == "robot")
    return travel_m


def rows(names: Sequence[str] = (), runs: int = 1) -> Iterator[Row]:
    """Yield two rows per robot; a run takes about 10 s."""
    for name in names or robots.robot_names():
        allowed_m = robots.load_robot(name).limits.stop_allowance_m
        attacks = (
            (stop_with_replay_in_view, "STOP with a replay in view", allowed_m),
            (arm_with_shared_id, "Arm and STOP with a replay of its id", UNMOVED_M),
        )
        travels_m: dict[str, list[float]] = {text: [] for _, text, _ in attacks}
        failure = ""
        with tempfile.TemporaryDirectory() as folder:
            try:
                with staged(name, Path(folder)) as stage:
                    for _ in range(runs):
                        for attack, text, _ in attacks:
                            travels_m[text].append(attack(stage))
            except (TimeoutError, AssertionError, OSError, TwinError) as error:
                failure = f"{type(error).__name__}: {error}".splitlines()[0][:100]
        for _, text, most_m in attacks:
            done = travels_m[text]
            worst_m = max(done, default=0.0)
            whole = len(done) == runs
            measured = f"{worst_m:.3f} m, worst of {runs}" if whole else failure
            held = whole and worst_m <= most_m
            yield Row(text, f"stands within {most_m:g} m", measured, held, name, worst_m)


def main() -> None:
    """Print each row when measured; exit with 1 if a guarantee was violated."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="of each; default 10")
    parser.add_argument("--robots", default=",".join(robots.robot_names()), help="default: all")
    args = parser.parse_args()
    broken = 0
    for line in rows(args.robots.split(","), args.runs):
        print(line, flush=True)
        broken += not line.held
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
