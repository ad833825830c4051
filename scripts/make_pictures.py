"""Generate the pictures of README and docs from the current programs: `make pictures`.

Pages are captured in Chromium, which renders on the CPU, so nothing else should run. Parts: `drive`
(the animation), `page`, `robots`, `ros`, `lab` and `drawings`; by default all. Three pictures
of docs/lab.md are not generated: `lab_zero`, `lab_calibrate_drive` and `lab_square_drive` require
guided drives.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import io
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests.support.browser import (  # noqa: E402
    FLAGS,
    PATIENCE_MS,
    centre,
    click_through,
    executable,
    press,
    take_control_and_arm,
)
from tests.support.programs import starting  # noqa: E402  Found by the line above.
from tests.support.ros_nodes import ForeignRobot, ros_router  # noqa: E402

ROBOTS = ("tsd", "omni4", "kiwi", "mecanum", "atlas")
LAB = {
    "lab_motors": "motors",
    "lab_square_open": "square --seed 3",
    "lab_square_camera": "square --loop camera --plant mujoco --seed 3",
    "lab_squares": "square --loop camera --plant mujoco --seed 1 --seeds 20",
    "lab_follow": "follow --path eight --heading tangent --loop camera --seed 3",
    "lab_budget": "budget --runs 2000",
    "lab_calibrate": "calibrate --seed 1",
    "lab_omni_step": "omni-step",
    "lab_omni_paths": "omni-paths",
    "lab_remote": "remote",
    "lab_atlas": "atlas",
}
"""Experiment for each picture, as listed in docs/lab.md."""

WIDTH_PX, FRAMES_PER_S, MOST_BYTES = 800, 10, 3_000_000
DRIVE_S = 7.0
_TRIES = 8
MESSAGES_MS = 8000
"""Time until the page's messages have disappeared."""
SPEED = ".hero .n"
MOVING = re.compile("[1-9]")
"""Matches a non-zero speed."""
SHARPNESS = """if (location.pathname.endsWith("/viewport/")) {
  const address = new URL(location.href);
  address.searchParams.set("fixedDpr", "$");
  history.replaceState(null, "", address);
}"""
"""Script of the scene's frame; without a GPU, viser would reduce the resolution."""
FONTS = """<?xml version="1.0"?><!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig><include>/etc/fonts/fonts.conf</include>
<match target="pattern"><edit name="family" mode="prepend" binding="strong">
<string>DejaVu Sans Condensed</string></edit></match></fontconfig>"""
"""Same width as the fonts of most desktops; a bare system has only a wider one."""


@contextlib.contextmanager
def demo(*flags: str) -> Generator[str]:
    """Run a demo and yield the address of its page."""
    command = [sys.executable, "-m", "tsd_demo", "--no-browser", "--until-eof", "--port", "0"]
    with subprocess.Popen(
        [*command, "--bus-port", "0", *flags],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            line = next(line for line in process.stdout if line.startswith("ready:"))
            yield re.findall(r"http://\S+", line)[0]
        finally:
            process.stdin.close()


@contextlib.contextmanager
def opened(
    browser: Browser, address: str, sharpness: float = 1.0, **settings: Any
) -> Generator[Page]:
    """Open the page; `sharpness` is the number of scene pixels per page pixel."""
    context = browser.new_context(
        **{"viewport": {"width": 1280, "height": 720}, "color_scheme": "dark"} | settings
    )
    page = context.new_page()
    page.add_init_script(SHARPNESS.replace("$", f"{sharpness:g}"))
    page.add_init_script("localStorage.setItem('tsd-was-driven', 'true')")  # No first steps.
    page.goto(address)
    expect(page.get_by_role("group", name="Start")).to_be_hidden(timeout=PATIENCE_MS)
    yield page
    context.close()


def show_tab(page: Page, name: str) -> None:
    """Open a tab of the panel."""
    page.get_by_role("tab", name=name).click(timeout=PATIENCE_MS)


def push_stick(page: Page, right: float, up: float) -> None:
    """Hold the stick at fractions of its reach until the robot moves.

    A slow page may release the stick; then push it again, as the page requests.
    """
    x, y, half = centre(page, "application", "Stick")
    speed = page.locator(SPEED)
    for _ in range(_TRIES):
        click_through(page, "Take control", "Hold to reset", "Arm")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + right * half, y - up * half)
        try:
            expect(speed).to_contain_text(MOVING, timeout=4000)
        except AssertionError:
            page.mouse.up()
            page.wait_for_timeout(MESSAGES_MS)
            continue
        return
    raise SystemExit("the robot was not moved: is this machine busy?")


def is_held(page: Page) -> bool:
    """Return whether the robot still follows the stick; a slow page may release it."""
    speed = page.locator(SPEED).all_inner_texts()
    return bool(MOVING.search("".join(speed))) and page.get_by_text("push again").count() == 0


def photograph_after_drive(page: Page, file: Path, *pushes: tuple[float, float]) -> None:
    """Drive briefly with the stick, and capture the page after its messages have disappeared.

    A page rendered on the CPU is too slow to be captured while driving.
    """
    for right, up in pushes:
        push_stick(page, right, up)
        page.wait_for_timeout(1000)
        page.mouse.up()
        page.wait_for_timeout(500)
    page.wait_for_timeout(MESSAGES_MS)
    page.screenshot(path=file)


def photograph_drive(browser: Browser, to: Path) -> None:
    """Capture the page while the robot drives a circle, and write an animation."""
    with (
        demo() as address,
        opened(browser, address, 0.6) as page,
    ):
        take_control_and_arm(page)
        show_tab(page, "Drive")
        page.wait_for_timeout(2000)
        for _ in range(_TRIES):
            push_stick(page, 0.0, 0.9)
            frames = record(page, lambda: drive_circle(page))
            held = is_held(page)
            page.mouse.up()
            if held:
                break
            page.wait_for_timeout(MESSAGES_MS)
        else:
            raise SystemExit("the drive was interrupted each time: is this machine busy?")
    write_animation(frames, to / "drive.webp")


def drive_circle(page: Page) -> None:
    """Move the held stick from forward to the left."""
    x, y, half = centre(page, "application", "Stick")
    start_s = time.monotonic()
    while (passed_s := time.monotonic() - start_s) < DRIVE_S:
        angle = max(0.0, passed_s - 1.0) / (DRIVE_S - 1.0) * 1.6 * math.pi
        page.mouse.move(x + 0.9 * half * math.sin(angle), y - 0.9 * half * math.cos(angle))
        page.wait_for_timeout(60)


def record(page: Page, act: Callable[[], None]) -> list[tuple[float, bytes]]:
    """Return the frames drawn while `act` runs, with their times in seconds."""
    frames: list[tuple[float, bytes]] = []
    session = page.context.new_cdp_session(page)

    def keep(frame: dict[str, Any]) -> None:
        frames.append((frame["metadata"]["timestamp"], base64.b64decode(frame["data"])))
        session.send("Page.screencastFrameAck", {"sessionId": frame["sessionId"]})

    session.on("Page.screencastFrame", keep)
    session.send("Page.startScreencast", {"format": "jpeg", "quality": 92})
    act()
    session.send("Page.stopScreencast")
    session.detach()
    return frames


def write_animation(frames: list[tuple[float, bytes]], file: Path) -> None:
    """Write the last seconds of a recording, at a constant rate and in real time."""
    end_s = frames[-1][0]
    count = round(DRIVE_S * FRAMES_PER_S)
    shown: list[Image.Image] = []
    for i in range(count):
        at_s = end_s - (count - 1 - i) / FRAMES_PER_S
        data = next((data for t_s, data in reversed(frames) if t_s <= at_s), frames[0][1])
        picture = Image.open(io.BytesIO(data)).convert("RGB")
        height = round(picture.height * WIDTH_PX / picture.width)
        shown.append(picture.resize((WIDTH_PX, height), Image.Resampling.LANCZOS))
    for quality in (80, 65, 50, 35, 20):
        shown[0].save(
            file,
            save_all=True,
            append_images=shown[1:],
            duration=round(1000 / FRAMES_PER_S),
            loop=0,
            quality=quality,
            method=4,
        )
        if file.stat().st_size <= MOST_BYTES:
            break
    recorded = sum(end_s - t_s <= DRIVE_S for t_s, _ in frames)
    print(f"  {recorded} frames drawn in {DRIVE_S:g} s, {file.stat().st_size / 1e6:.1f} MB")


def photograph_page(browser: Browser, to: Path) -> None:
    """Capture a drawn path, the plots of a drive, and the page on a phone."""
    with demo() as address:
        with opened(browser, address) as page:
            show_tab(page, "Drive")
            press(page, "Take control")
            page.get_by_role("radio", name="Draw").click(timeout=PATIENCE_MS)
            draw_line(page)
            page.screenshot(path=to / "path.png")
        with opened(browser, address) as page:
            take_control_and_arm(page)
            show_tab(page, "Plots")
            photograph_after_drive(page, to / "plots.png", (0.0, 0.9), (-0.8, 0.3), (0.3, 0.9))
            press(page, "Disarm")
            press(page, "Release control")
        phone = {"viewport": {"width": 390, "height": 844}, "color_scheme": "light"}
        with opened(browser, address, **phone) as page:
            press(page, "Take control")  # The rest of what a desktop shows is in a sheet.
            press(page, "Arm")
            mode = page.get_by_role("status", name="Mode")
            expect(mode).to_have_text("Ready", timeout=PATIENCE_MS)
            photograph_after_drive(page, to / "phone.png", (0.3, 0.8))


def draw_line(page: Page) -> None:
    """Draw a line on the floor with the mouse, and wait until it is planned."""
    points = [(520, 230), (580, 180), (650, 160), (720, 190), (760, 250), (740, 310), (690, 340)]
    page.mouse.move(*points[0])
    page.mouse.down()
    for point in points[1:]:
        page.mouse.move(*point, steps=6)
        page.wait_for_timeout(60)
    page.mouse.up()
    path = page.get_by_role("status", name="Path")
    expect(path).to_contain_text(re.compile(r"\d m"), timeout=PATIENCE_MS)
    page.wait_for_timeout(4000)  # Wait until the scene has drawn it.


def photograph_robots(browser: Browser, to: Path) -> None:
    """Capture each shipped robot after a drive, with its modules or wheels."""
    for name in ROBOTS:
        with demo("--robot", name) as address, opened(browser, address) as page:
            take_control_and_arm(page)
            show_tab(page, "Modules")
            photograph_after_drive(page, to / f"{name}.png", (0.3, 0.8))
        print(f"  {name}")


def photograph_ros(browser: Browser, to: Path) -> None:
    """Capture a robot with only ROS topics, simulated by test nodes."""
    with contextlib.ExitStack() as ending:
        router, port = ending.enter_context(ros_router())
        robot = ForeignRobot(router, port)
        ending.callback(robot.close)
        start = ending.enter_context(starting())
        flags = ["--import", "cart", "--listen", "tcp/127.0.0.1:0", "--domain", "0"]
        node = start("tsd_ros", *flags, "--ros-connect", f"tcp/127.0.0.1:{port}")
        endpoint = node.ready().split()[-1]
        page_at = start("tsd_dashboard", "--connect", endpoint, "--port", "0", "--until-eof")
        address = re.findall(r"http://\S+", page_at.ready())[0]
        page = ending.enter_context(opened(browser, address))
        take_control_and_arm(page)
        show_tab(page, "Modules")
        file = to / "ros_import.png"
        photograph_after_drive(page, file, (0.3, 0.8))
    # A reduced palette looks the same for flat shapes, at a third of the size.
    with Image.open(file) as picture:
        few = picture.convert("RGB").quantize(256)
    few.save(file, optimize=True)


def draw_lab(to: Path) -> None:
    """Run the experiments of docs/lab.md in virtual time, and copy their pictures."""
    for name, command in LAB.items():
        with tempfile.TemporaryDirectory() as folder:
            experiment = [sys.executable, "-m", "tsd_lab", *command.split()]
            subprocess.run(
                [*experiment, "--quiet", "--out", folder], check=True, stdout=subprocess.DEVNULL
            )
            (picture,) = Path(folder).glob("*.png")
            shutil.copy(picture, to / f"{name}.png")
        print(f"  {name}")


def draw_drawings(to: Path) -> None:
    """Generate the SVG drawings."""
    subprocess.run([sys.executable, str(ROOT / "docs/img/draw"), str(to)], check=True)


PAGES: dict[str, Callable[[Browser, Path], None]] = {
    "drive": photograph_drive,
    "page": photograph_page,
    "robots": photograph_robots,
    "ros": photograph_ros,
}
OTHERS: dict[str, Callable[[Path], None]] = {"lab": draw_lab, "drawings": draw_drawings}


def main() -> None:
    """Generate the named parts, or all."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else "")
    parts = [*PAGES, *OTHERS]
    parser.add_argument("part", nargs="*", metavar="PART", help=f"of {', '.join(parts)}; all")
    parser.add_argument("--to", type=Path, default=ROOT / "docs/img", help="default docs/img")
    args = parser.parse_args()
    if unknown := set(args.part) - set(parts):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(parts)}")
    args.to.mkdir(parents=True, exist_ok=True)
    chosen = args.part or parts
    with sync_playwright() as playwright, tempfile.NamedTemporaryFile("w", suffix=".conf") as fonts:
        fonts.write(FONTS)
        fonts.flush()
        environment: dict[str, Any] = {**os.environ, "FONTCONFIG_FILE": fonts.name}
        for part in (part for part in PAGES if part in chosen):
            print(part, flush=True)
            browser = playwright.chromium.launch(
                executable_path=executable(), args=list(FLAGS), env=environment
            )
            PAGES[part](browser, args.to)
            browser.close()
    for part in (part for part in OTHERS if part in chosen):
        print(part, flush=True)
        OTHERS[part](args.to)


if __name__ == "__main__":
    main()
