"""The per-layer tables of kinds are complete and consistent; kinds of other packages."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import metadata

import numpy as np
import pytest

from tsd_twin import registry, robots
from tsd_twin.dashboard.sessions.kinds import view_of
from tsd_twin.errors import RobotFileError
from tsd_twin.estimation import sensor_odometry_of
from tsd_twin.kinematics import Kinematics
from tsd_twin.models import draw_parts, kinematic_tree, masses_kg
from tsd_twin.registry import KindTable, RobotKind
from tsd_twin.robots import DESCRIPTIONS, OmniDescription, kind_of, load_robot, robot_names
from tsd_twin.simulation import plants_of, simulate

SHIPPED = [load_robot(name) for name in robot_names()]


class OtherDescription(OmniDescription, frozen=True, kw_only=True):
    """A description that no table lists."""


OTHER = RobotKind(OtherDescription)
NO_KIND = "not a kind"
WRONG_CLASS = RobotKind(dict)
WRONG_TAG = RobotKind(OmniDescription)


def test_every_description_has_the_tag_of_its_kind() -> None:
    assert {kind_of(cls) for cls in DESCRIPTIONS.values()} == set(DESCRIPTIONS)
    assert all(kind_of(cls) == name for name, cls in DESCRIPTIONS.items())


def test_every_kind_but_imported_is_shipped_and_simulated() -> None:
    assert {kind_of(robot) for robot in SHIPPED} == set(DESCRIPTIONS) - {"imported"}
    assert all(plants_of(robot) for robot in SHIPPED)


@pytest.mark.parametrize("robot", SHIPPED, ids=lambda robot: robot.name)
def test_implementations_of_a_kind_fit_together(robot: robots.RobotDescription) -> None:
    kinematics: Kinematics[object] = robot.kinematics()  # pyright: ignore[reportInvalidTypeArguments]
    simulation = simulate(robot)
    joints = len(kinematics.joints)
    assert simulation.kinematics.joints == kinematics.joints
    assert simulation.measure().shape == (joints + len(robot.sensors),)
    tree = kinematic_tree(robot)
    assert set(masses_kg(robot)) == set(tree.kinds)
    assert np.all(np.isfinite(kinematics.inverse(np.zeros(3))))
    view = view_of(robot)
    assert view.telemetry(robot).info()["panel"] != "joints"
    assert view.study is not None
    at_rest = kinematics.inverse(np.zeros(3))
    assert view.study.wheels(robot, at_rest, kinematics.forward(at_rest))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[metadata.EntryPoint]]:
    """List of entry points that the registry sees as installed."""
    points: list[metadata.EntryPoint] = []
    monkeypatch.setattr(metadata, "entry_points", lambda **_: points)
    monkeypatch.setattr(registry, "_LOADED", {})
    registry.entry_points.cache_clear()
    registry.load_kind.cache_clear()
    yield points
    registry.entry_points.cache_clear()
    registry.load_kind.cache_clear()


def _point(name: str, value: str) -> metadata.EntryPoint:
    return metadata.EntryPoint(name, f"{__name__}:{value}", registry.GROUP)


def _load(kind: str, package: str = "") -> type[robots.RobotDescription]:
    from tsd_twin.robots.kinds import description_class

    return description_class(kind, "my.toml", package)


def test_a_table_uses_the_part_of_an_installed_kind_or_its_default() -> None:
    robot = SHIPPED[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_LOADED", {type(robot): OTHER})
        assert KindTable({type(robot): "mine"}, lambda _: "theirs", "default").of(robot) == "mine"
        assert KindTable({}, lambda _: "theirs", "default").of(robot) == "theirs"
        assert KindTable[str]({}, lambda _: None, "default").of(robot) == "default"
    assert KindTable({}, lambda _: "theirs", "default").of(robot) == "default"


def test_a_description_that_no_table_lists_gets_the_defaults() -> None:
    omni = load_robot("kiwi")
    robot = OtherDescription(**{name: getattr(omni, name) for name in omni.__struct_fields__})
    assert sensor_odometry_of(robot) == (None, False)
    assert plants_of(robot) == ()
    with pytest.raises(RobotFileError, match="the plant `kinematic` cannot move it"):
        simulate(robot)
    assert kinematic_tree(robot).kinds == ("chassis",)
    assert set(draw_parts(robot)) == {"chassis"}
    telemetry = view_of(robot).telemetry(robot)
    assert [row.name for row in telemetry.info()["joints"]] == ["wheel1", "wheel2", "wheel3"]
    joints = np.array([np.pi, -2.0 * np.pi, 0.0])
    rows = telemetry.state(joints, 2.0 * joints, None)["joints"]
    assert [(row.value, row.setpoint) for row in rows] == [
        (30.0, 60.0),
        (-60.0, -120.0),
        (0.0, 0.0),
    ]


def test_an_unknown_kind_names_the_known_kinds_and_its_package(
    installed: list[metadata.EntryPoint],
) -> None:
    installed.append(_point("legs", "OTHER"))
    with pytest.raises(RobotFileError, match="no installed package provides it") as found:
        _load("snake")
    assert "kinds are singularity, omni, sphere, imported, legs" in str(found.value)
    with pytest.raises(RobotFileError, match="the package my-snake, which provides it, is not"):
        _load("snake", "my-snake")
    with pytest.raises(RobotFileError, match="did you mean 'legs'"):
        _load("leg")


def test_a_file_names_the_missing_package_of_its_kind() -> None:
    text = 'package = "my-snake"\n[drive]\nkind = "snake"\n'
    with pytest.raises(RobotFileError, match="the package my-snake, which provides it, is not"):
        robots.parse_description(text, "my.toml")
    with pytest.raises(RobotFileError, match="no installed package provides it"):
        robots.parse_description(text.replace("my-snake", "a b; rm -rf"), "my.toml")


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ("NO_KIND", "is not a RobotKind"),
        ("MISSING", "cannot be loaded: AttributeError"),
        ("WRONG_CLASS", "is not a RobotDescription"),
        ("WRONG_TAG", "has the tag 'omni'"),
    ],
)
def test_a_broken_kind_of_a_package_is_an_error_of_the_file(
    installed: list[metadata.EntryPoint], value: str, problem: str
) -> None:
    installed.append(_point("legs", value))
    with pytest.raises(RobotFileError, match=problem):
        _load("legs")


def test_two_packages_with_one_kind_are_an_error_that_names_them(
    installed: list[metadata.EntryPoint],
) -> None:
    installed += [_point("legs", "OTHER"), _point("legs", "WRONG_TAG")]
    with pytest.raises(RobotFileError, match="two packages offer the kind of robot 'legs'"):
        _load("legs")
    assert _load("omni") is OmniDescription


def test_an_installed_kind_does_not_replace_a_shipped_one(
    installed: list[metadata.EntryPoint],
) -> None:
    installed.append(_point("omni", "OTHER"))
    assert _load("omni") is OmniDescription
