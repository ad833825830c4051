"""Tables, numbers and layout of docs/foxglove.md match the code."""

from __future__ import annotations

import json
from typing import Any

from tests.support.markdown_pages import ROOT, page, quoted, section, tables
from tsd_twin.adapters import cmd_vel, fleet
from tsd_twin.adapters.foxglove import gateway, sdk
from tsd_twin.adapters.ros_topics import CMD_VEL, PUBLISHED, SERVICES

PAGE = page("foxglove.md")


def test_the_table_of_topics_is_that_of_the_code() -> None:
    rows = tables(section(PAGE, "## Topics"))[0]
    assert [quoted(row[0])[0] for row in rows] == [topic.name for topic in PUBLISHED]
    for row, topic in zip(rows, PUBLISHED, strict=True):
        assert quoted(row[1]) == [topic.type]
        assert ", ".join(quoted(row[2])) == topic.source
        assert row[3] == topic.qos
        assert row[4] == (topic.frame or "–")


def test_what_is_read_and_called_is_on_the_page() -> None:
    reads, calls = tables(section(PAGE, "## Topics"))[1]
    assert quoted(reads[1]) == [CMD_VEL.name]
    assert quoted(reads[2]) == [cmd_vel.TWIST, cmd_vel.TWIST_STAMPED]
    assert tuple(quoted(calls[1])) == SERVICES


def test_times_and_limits_are_those_of_the_code() -> None:
    driving = section(PAGE, "## Driving by cmd_vel")
    assert f"a pause of {cmd_vel.PAUSE_S:g} s" in driving
    assert f"no service for {cmd_vel.IDLE_S:g} s" in driving
    assert f"more than {cmd_vel.LARGEST:g} m/s" in driving
    assert f"no ping for {gateway.SILENT_S:g} s" in driving
    assert f"a ping {1 / gateway.PING_S:.0f} times a second" in driving
    rows = {row[0]: row[1] for row in tables(section(PAGE, "## Who may connect"))[0]}
    assert rows["clients"] == str(gateway.MOST_CLIENTS)
    assert rows["robots"] == str(fleet.MOST_ROBOTS)
    assert rows["message length"] == f"{gateway.LARGEST_BYTES // 1024} KiB"
    flood = f"{gateway.MOST_MESSAGES:,} messages, {gateway.MOST_BYTES // 1024} KiB per second"
    assert rows["rate per client"] == flood
    assert rows["messages that wait for a slow client"] == str(sdk.BACKLOG)


def panels(tree: Any) -> set[str]:
    if isinstance(tree, str):
        return {tree}
    return panels(tree["first"]) | panels(tree["second"])


def test_the_layout_shows_topics_and_calls_services_that_there_are() -> None:
    layout = json.loads((ROOT / "docs/foxglove/layout.json").read_text("utf-8"))
    config: dict[str, Any] = layout["configById"]
    assert panels(layout["layout"]) == set(config)
    shown = {row.name if row.name[0] == "/" else f"/{row.name}" for row in PUBLISHED}
    for panel in config.values():
        assert panel.get("topic", f"/{CMD_VEL.name}") == f"/{CMD_VEL.name}"
        assert set(panel.get("topics", ())) <= shown
        assert panel.get("topicToRender", "/events") in shown
        assert all(path["value"].split(".")[0] in shown for path in panel.get("paths", ()))
    called = {panel["serviceName"] for panel in config.values() if "serviceName" in panel}
    assert called == {f"/{name}" for name in SERVICES}
    # Twists must arrive faster than they expire.
    assert all(each.get("publishRate", 20) >= 10 for each in config.values())
