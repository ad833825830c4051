"""Tables and numbers of docs/ros2.md match the code."""

from __future__ import annotations

from tests.support.markdown_pages import page, quoted, section, tables
from tsd_twin.adapters import cmd_vel
from tsd_twin.adapters.ros.port import NODE, types_of
from tsd_twin.adapters.ros_topics import PUBLISHED, READ, SERVICES
from tsd_twin.messages.ros_types import TRIGGER

PAGE = page("ros2.md")


def test_the_tables_of_topics_are_those_of_the_code() -> None:
    for table, topics in zip(tables(section(PAGE, "## Topics")), (PUBLISHED, READ), strict=True):
        assert [quoted(row[0])[0] for row in table] == [topic.name for topic in topics]
        for row, topic in zip(table, topics, strict=True):
            assert tuple(quoted(row[1])) == types_of(topic)
            assert ", ".join(quoted(row[2])) == topic.source
            assert row[3] == topic.qos
            assert row[4].replace("`", "") == (topic.frame or "–")


def test_names_and_figures_are_those_of_the_code() -> None:
    said = section(PAGE, "## Topics")
    assert f"The services {', '.join(f'`{name}`' for name in SERVICES[:-1])}" in said
    assert f"`{TRIGGER}`" in said
    assert f"`/{NODE}`" in said
    driving = section(PAGE, "## Driving by cmd_vel")
    assert f"After {cmd_vel.IDLE_S:g} s it disarms" in driving
    assert f"pauses for {cmd_vel.PAUSE_S:g} s" in driving
