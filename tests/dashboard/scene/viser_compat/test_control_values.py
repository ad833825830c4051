"""A control takes what a hand can choose there, and nothing else, without a word on stderr."""

from __future__ import annotations

import asyncio
from collections.abc import Generator
from typing import Any

import pytest
import viser

from tests.support.viser_client import ViserClient, viser_client
from tsd_twin.dashboard.scene.viser_compat import value_fits


@pytest.fixture(scope="module")
def viewer(server: viser.ViserServer) -> Generator[ViserClient]:
    with viser_client(server.get_port()) as made:
        yield made


@pytest.mark.parametrize(
    "wrong", ["fast", "1", True, None, [0.5], {}, b"x", [["x"]], "\x00" * 200, [1.0] * 500]
)
def test_what_does_not_fit_a_slider_changes_nothing(
    server: viser.ViserServer, viewer: ViserClient, wrong: Any, caplog: pytest.LogCaptureFixture
) -> None:
    slider = server.gui.add_slider("speed", -1.0, 1.0, 0.1, 0.0)
    try:
        viewer.until(lambda: viewer.control("speed"))
        uuid = viewer.control("speed").uuid
        for value in (wrong, 0.5):
            message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
            viewer.send(message)
        end = asyncio.run(_until(lambda: slider.value == 0.5))
        assert end
        assert caplog.text == ""
    finally:
        slider.remove()
        viewer.controls.clear()


async def _until(condition: Any) -> bool:
    for _ in range(500):
        if condition():
            return True
        await asyncio.sleep(0.01)
    return False


def test_a_hand_can_choose_what_is_on_a_menu_and_press_what_is_enabled(
    server: viser.ViserServer,
) -> None:
    menu = server.gui.add_dropdown("menu", ["a", "b"])
    box = server.gui.add_checkbox("box", initial_value=False)
    button = server.gui.add_button("button")
    try:
        assert value_fits(menu, "b")
        assert not any(value_fits(menu, value) for value in ("c", "", 0, True, None))
        assert value_fits(box, True)
        assert not any(value_fits(box, value) for value in ("yes", 1, 0.0, None))
        assert value_fits(button, True)
        button.disabled = True
        assert not value_fits(button, True)
        menu.visible = False
        assert not value_fits(menu, "b")
    finally:
        for control in (menu, box, button):
            control.remove()
