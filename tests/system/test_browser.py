"""Faults of a real browser at 1 m/s lead to standstill, and to a new command only on request."""

from __future__ import annotations

import signal
import time
from collections.abc import Generator

import pytest

from tests.system.fault_stage import Table, fault_stage, stands_still
from tests.system.page_operator import FINGER, KEY, PageOperator, Pointer
from tests.system.real_page import RealPage

pytestmark = [pytest.mark.system, pytest.mark.busy, pytest.mark.timeout(300)]

ASLEEP_S = 5.0
"""Like a suspended laptop, whose socket stays open and silent, then resumes."""


@pytest.fixture(scope="module")
def lasting(tmp_path_factory: pytest.TempPathFactory) -> Generator[PageOperator]:
    with fault_stage(tmp_path_factory.mktemp("robot")) as scene:
        it = PageOperator(scene, lambda: tmp_path_factory.mktemp("profile"))
        yield it
        it.close()


@pytest.fixture
def desk(lasting: PageOperator) -> Generator[PageOperator]:
    yield lasting
    lasting.tidy_up()


def test_the_focus_goes_elsewhere_and_the_key_up_with_it(desk: PageOperator, table: Table) -> None:
    page = desk.drive(KEY)
    page.tab.value(
        "document.body.append(Object.assign(document.createElement('iframe'), {id: 'elsewhere'})),"
        "elsewhere.contentWindow.focus()"
    )
    fault_s = page.tab.when("blur")
    page.tab.key("w", down=False)
    stands_still(table.add("browser: focus lost, key-up too", desk.watch(fault_s)))
    page.tab.value("elsewhere.remove(), focus()")
    # On some systems, a key held since before arrives as if new.
    page.tab.key("w", down=True)
    page.tab.key("w", down=True, again=True)
    desk.stays_still()
    desk.drives_anew(KEY)


@pytest.mark.parametrize("where", ["Control is held", "a text field has the focus"])
def test_a_key_that_comes_up_counts(desk: PageOperator, table: Table, where: str) -> None:
    page = desk.drive(KEY)
    page.tab.value(
        "document.body.append(Object.assign(document.createElement('textarea'), {id: 'field'}))"
    )
    if where == "a text field has the focus":
        page.tab.value("field.focus()")
    fault_s = time.monotonic()
    page.tab.key("w", down=False, control=where == "Control is held")
    stands_still(table.add(f"browser: key comes up, {where}", desk.watch(fault_s)))
    page.tab.value("field.remove()")
    desk.drives_anew(KEY)


def test_a_hidden_tab(desk: PageOperator, table: Table) -> None:
    page = desk.drive(KEY)
    other = desk.browser.open("about:blank")
    fault_s = page.tab.when("visibilitychange")
    stands_still(table.add("browser: tab hidden", desk.watch(fault_s)))
    other.close()
    page.tab.to_front()
    page.tab.until("document.visibilityState === 'visible' && document.hasFocus()")
    page.tab.key("w", down=True, again=True)
    desk.stays_still()
    desk.drives_anew(KEY)


def test_a_finger_that_the_system_takes_away(desk: PageOperator, table: Table) -> None:
    page = desk.drive(FINGER)
    page.tab.touch("touchCancel")
    fault_s = page.tab.when("pointercancel")
    stands_still(table.add("browser: touch cancelled", desk.watch(fault_s)))
    desk.drives_anew(FINGER)


def test_a_pointer_whose_capture_is_lost(desk: PageOperator, table: Table) -> None:
    pad = desk.page.element(".stick")
    desk.page.tab.value(
        f"{pad}.addEventListener('gotpointercapture', (e) => (window.finger = e.pointerId)), 1"
    )
    page = desk.drive(FINGER)
    nearly = page.place(".stick", 0.9)
    page.tab.value(f"{pad}.releasePointerCapture(finger)")
    page.tab.touch("touchMove", (*nearly, 1))  # The page notices at this event.
    fault_s = page.tab.when("lostpointercapture")
    run = desk.watch(fault_s)
    page.tab.touch("touchMove", (*page.place(".stick", 0.5), 1))
    desk.stays_still()
    stands_still(table.add("browser: pointer capture lost", run))
    desk.drives_anew(FINGER)


def test_a_second_finger_on_stop_while_the_first_holds_the_stick(
    desk: PageOperator, table: Table
) -> None:
    page = desk.drive(FINGER)
    held = (*page.place(".stick", 1.0), 1)
    stop = (*page.place(".stop"), 2)
    page.tab.touch("touchStart", held, stop)
    run = desk.watch(page.tab.when("pointerdown"))
    page.until_mode("stopped")
    page.tab.touch("touchEnd", held)
    page.tab.touch("touchMove", (*page.place(".stick", 0.5), 1))
    desk.stays_still()
    stands_still(table.add("browser: STOP by a second finger", run, "latched"))
    desk.drives_anew(FINGER)


def gamepad(page: RealPage, **what: object) -> None:
    """Plug in a gamepad or move its stick, by replacing Chromium's gamepad interface."""
    axes, connected, event = what["axes"], what["connected"], what.get("event", "")
    connected = str(connected).lower()
    page.tab.value(
        f"window.pad = {{index: 0, connected: {connected}, buttons: [], axes: {axes}}};"
        "navigator.getGamepads = () => [pad.connected ? pad : null];"
        f"if ('{event}') dispatchEvent(Object.assign(new Event('{event}'), {{gamepad: pad}}))"
    )


PAD = Pointer(
    lambda page: gamepad(page, axes=[0, -1, 0, 0], connected=True),
    lambda page: gamepad(page, axes=[0, 0, 0, 0], connected=True),
)


def test_a_gamepad_that_is_unplugged_and_plugged_in_with_its_stick_held(
    desk: PageOperator, table: Table
) -> None:
    push, centre = [0, -1, 0, 0], [0, 0, 0, 0]
    gamepad(desk.page, axes=centre, connected=True, event="gamepadconnected")
    desk.page.tab.until("new Promise((done) => setTimeout(() => done(true), 100))")
    page = desk.drive(PAD)
    fault_s = time.monotonic()
    gamepad(page, axes=push, connected=False, event="gamepaddisconnected")
    stands_still(table.add("browser: gamepad unplugged", desk.watch(fault_s)))
    gamepad(page, axes=push, connected=True, event="gamepadconnected")
    desk.stays_still()
    desk.drives_anew(PAD)
    # Unplugged and plugged in between two polls, or replaced by another one, and pushed.
    desk.drive(PAD)
    fault_s = time.monotonic()
    page.tab.value("dispatchEvent(Object.assign(new Event('gamepaddisconnected'), {gamepad: pad}))")
    gamepad(page, axes=push, connected=True, event="gamepadconnected")
    stands_still(table.add("browser: gamepad out and in again", desk.watch(fault_s)))
    PAD.up(page)
    gamepad(page, axes=centre, connected=False, event="gamepaddisconnected")


def test_a_page_that_does_nothing_for_a_while(desk: PageOperator, table: Table) -> None:
    page = desk.drive(KEY)
    fault_s = time.monotonic()
    page.tab.value("{ const end = performance.now() + 700; while (performance.now() < end); }")
    run = desk.watch(fault_s, time.monotonic())
    page.tab.key("w", down=True, again=True)
    desk.stays_still()
    stands_still(table.add("browser: page busy for 0.7 s", run, "no word for 0.2 s"))
    desk.drives_anew(KEY)


def test_two_pages_of_one_operator(desk: PageOperator, table: Table) -> None:
    """The second page is read-only until it takes over; then the first is."""
    second = RealPage(desk.browser, desk.scene.url, window=True)
    first = desk.drive(KEY)
    holder = desk.observer.status.lease.holder
    since_s = time.monotonic()
    KEY.down(second)
    assert not second.drives()
    KEY.up(second)
    desk.observer.until_time(since_s + 0.5)
    assert desk.observer.status.lease.holder == holder
    KEY.up(first)
    desk.observer.until_rest()
    desk.drive(KEY, first)
    while not second.can_take_over():  # The first page may have stalled and lost control.
        KEY.up(first)
        desk.drive(KEY, first)
    fault_s = second.take_over()
    stands_still(table.add("browser: second tab takes over", desk.watch(fault_s)))
    assert desk.observer.status.lease.holder != holder
    first.tab.key("w", down=True, again=True)
    desk.stays_still()
    assert not first.drives()
    second.tab.close()
    first.tab.to_front()
    desk.drives_anew(KEY, first)


def test_a_page_that_is_loaded_again(desk: PageOperator, table: Table) -> None:
    page = desk.drive(KEY)
    fault_s = time.monotonic()
    page.tab.call("Page.reload")
    run = desk.watch(fault_s)
    page.until_loaded()
    page.tab.key("w", down=True, again=True)
    desk.stays_still()
    assert not page.drives()
    stands_still(table.add("browser: page loaded again", run))
    desk.drives_anew(KEY)


def test_a_browser_that_is_stopped_and_goes_on(desk: PageOperator, table: Table) -> None:
    page = desk.drive(KEY)
    fault_s = desk.browser.send_signal(signal.SIGSTOP)
    desk.observer.until_time(fault_s + ASLEEP_S)
    goes_on_s = desk.browser.send_signal(signal.SIGCONT)
    run = desk.watch(fault_s, goes_on_s)
    page.tab.key("w", down=True, again=True)
    desk.stays_still()
    stands_still(table.add(f"browser SIGSTOP {ASLEEP_S:g} s, SIGCONT", run))
    desk.drives_anew(KEY)


def test_a_tab_that_is_frozen_and_thawed(desk: PageOperator, table: Table) -> None:
    """As browsers do to background tabs: scripts stop, and the socket stays open."""
    page = desk.drive(KEY)
    other = desk.browser.open("about:blank")
    fault_s = time.monotonic()
    page.tab.call("Page.setWebLifecycleState", state="frozen")
    run = desk.watch(fault_s)
    desk.observer.until(lambda: desk.observer.status.lease.holder is None, "control given back")
    page.tab.call("Page.setWebLifecycleState", state="active")
    other.close()
    page.tab.to_front()
    page.tab.until("document.visibilityState === 'visible' && document.hasFocus()")
    page.tab.key("w", down=True, again=True)
    desk.stays_still()
    assert not page.drives()
    stands_still(table.add("browser: tab frozen, thawed", run))
    desk.drives_anew(KEY)


def test_a_page_that_is_closed(desk: PageOperator, table: Table) -> None:
    page = desk.drive(KEY)
    desk.browser.open("about:blank", window=True)  # Or the browser would end with its last page.
    fault_s = time.monotonic()
    page.tab.close()
    desk.page_is_gone()
    stands_still(table.add("browser: page closed", desk.watch(fault_s)))


def test_a_browser_that_is_killed(desk: PageOperator, table: Table) -> None:
    desk.drive(KEY)
    fault_s = desk.browser.send_signal(signal.SIGKILL)
    stands_still(table.add("browser SIGKILL", desk.watch(fault_s)))
