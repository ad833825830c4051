"""A robot file is valid, or its error names the value, its place and a valid replacement."""

from __future__ import annotations

import time
import tomllib
from pathlib import Path

import msgspec
import pytest

from tsd_twin.errors import RobotFileError
from tsd_twin.kinematics import Kinematics
from tsd_twin.robots import load_robot, parse_description, read_description, robot_names
from tsd_twin.robots.loader import MAX_FILE_CHARS

TSD = read_description("tsd")


def edited(old: str, new: str) -> str:
    """The `tsd` file with one line changed."""
    assert TSD.count(old) == 1, f"{old!r} is not one place of the file"
    return TSD.replace(old, new)


def refusal(toml: str) -> str:
    with pytest.raises(RobotFileError) as caught:
        parse_description(toml, "my.toml")
    message = str(caught.value)
    assert message.startswith("my.toml: ")
    return message


_, _, _rest = read_description("tsd").partition("[battery]")
BATTERY = f"[battery]{_rest.partition('[')[0]}"


@pytest.mark.parametrize("name", robot_names())
def test_every_shipped_robot_loads(name: str) -> None:
    robot = load_robot(name)
    assert robot.name == name
    drive: Kinematics = robot.kinematics()
    assert len(drive.joints) > 0


def test_the_robot_of_the_thesis_is_shipped() -> None:
    assert "tsd" in robot_names()


@pytest.mark.parametrize("name", robot_names())
def test_the_text_of_a_robot_is_all_there_is_to_it(name: str, tmp_path: Path) -> None:
    """The text is sufficient: sent over the bus or read from a file, it is the same robot."""
    path = tmp_path / "copy.toml"
    path.write_text(read_description(name), encoding="utf-8")
    assert (
        load_robot(str(path))
        == parse_description(read_description(name), "peer")
        == load_robot(name)
    )
    assert read_description(str(path)) == read_description(name)


@pytest.mark.parametrize("name", robot_names())
def test_every_key_of_a_shipped_file_is_read_as_it_stands(name: str) -> None:
    """Against the standard library's reader; defaults may only add to it."""

    def assert_within(file: object, robot: object) -> None:
        if isinstance(file, dict):
            assert isinstance(robot, dict)
            for key, value in file.items():
                assert_within(value, robot[key])
        elif isinstance(file, list):
            assert isinstance(robot, list)
            for mine, theirs in zip(file, robot, strict=True):
                assert_within(mine, theirs)
        else:
            assert file == robot

    assert_within(
        tomllib.loads(read_description(name)),
        msgspec.json.decode(msgspec.json.encode(load_robot(name))),
    )


@pytest.mark.parametrize("name", robot_names())
def test_values_survive_being_taken_apart_and_put_together(name: str) -> None:
    robot = load_robot(name)
    assert msgspec.convert(msgspec.to_builtins(robot), type(robot)) == robot


@pytest.mark.parametrize(
    ("old", "new", "key", "valid"),
    [
        ("pivot_radius_m", "pivot_radius", "'pivot_radius' in [drive]", "mean 'pivot_radius_m'?"),
        ('kind = "singularity"', 'knd = "singularity"', "'knd' in [drive]", "mean 'kind'?"),
        ("[motor]", "[motr]", "'motr' in the top level", "did you mean 'motor'?"),
        ('title = "', 'titel = "', "'titel' in the top level", "did you mean 'title'?"),
        (
            "speed_scale_sigma",
            "share",
            "'share' in [noise]",
            "valid here: gimbal_angle_deg, speed_scale_sigma",
        ),
    ],
)
def test_a_misspelt_key_is_named_with_the_key_that_was_meant(
    old: str, new: str, key: str, valid: str
) -> None:
    message = refusal(edited(old, new))
    assert f"unknown key {key}" in message
    assert valid in message


@pytest.mark.parametrize(
    ("old", "key", "valid"),
    [
        ("wheel_radius_m = 0.04\n", "'wheel_radius_m' is missing in [drive]", "azimuths_deg, "),
        ('kind = "singularity"\n', "'kind' is missing in [drive]", "kinds are singularity"),
        ('name = "tsd"\n', "'name' is missing in the top level", "valid here: name, title"),
        (BATTERY, "'battery' is missing in the top level", "battery"),
    ],
)
def test_a_missing_key_is_named(old: str, key: str, valid: str) -> None:
    message = refusal(edited(old, ""))
    assert f"key {key}" in message
    assert valid in message


@pytest.mark.parametrize(
    ("old", "new", "key", "valid"),
    [
        ("pivot_radius_m = 0.15", 'pivot_radius_m = "wide"', "drive.pivot_radius_m", "float"),
        ("pivot_radius_m = 0.15", "pivot_radius_m = true", "drive.pivot_radius_m", "float"),
        ("pivot_radius_m = 0.15", "pivot_radius_m = -0.15", "drive.pivot_radius_m", "float > 0.0"),
        ("pivot_radius_m = 0.15", "pivot_radius_m = 0.0", "drive.pivot_radius_m", "float > 0.0"),
        ("pivot_radius_m = 0.15", "pivot_radius_m = nan", "drive.pivot_radius_m", "float > 0.0"),
        ("pivot_radius_m = 0.15", "pivot_radius_m = inf", "drive.pivot_radius_m", "finite number"),
        ("90.0, 210.0", "90.0, nan", "drive.azimuths_deg[1]", "finite number"),
        ("90.0, 210.0", "90.0, -inf", "drive.azimuths_deg[1]", "finite number"),
        ("0.0402, 0.0611", "0.0402, inf", "servo.size_m[1]", "finite number"),
        ("90.0, 210.0, 330.0", "90.0", "drive.azimuths_deg", "length >= 2"),
        ("max_tilt_deg = 30.0", "max_tilt_deg = 90.0", "drive.max_tilt_deg", "float < 80.0"),
        ("steps_per_turn = 4096", "steps_per_turn = 0.5", "servo.steps_per_turn", "int"),
        ("steps_per_turn = 4096", "steps_per_turn = 0", "servo.steps_per_turn", "int >= 1"),
        ("[0, 0, 2938", '[0, "a", 2938', "motor.speed_rpm[1][1]", "float"),
        ("[0, 0, 2938", "[0, -1, 2938", "motor.speed_rpm[1][1]", "float >= 0.0"),
        ("total_kg = 3.0", "total_kg = [3.0]", "mass.total_kg", "float"),
        ("[battery]", "[[battery]]", "battery", "expected object"),
        ('name = "tsd"', 'name = "My Robot"', "name", "[a-z0-9_-]{1,32}"),
        ('name = "tsd"', 'name = "tsd\\n"', "name", "[a-z0-9_-]{1,32}"),
        ('name = "tsd"', 'name = "twin/tsd"', "name", "[a-z0-9_-]{1,32}"),
        ('kind = "singularity"', 'kind = "tricycle"', "drive.kind", "kinds are singularity"),
        ('kind = "singularity"', "kind = 3", "drive.kind", "kinds are singularity"),
    ],
)
def test_an_impossible_value_is_named_with_what_is_possible(
    old: str, new: str, key: str, valid: str
) -> None:
    message = refusal(edited(old, new))
    assert message.startswith(f"my.toml: {key}: ")
    assert valid in message


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("90.0, 210.0, 330.0", "90.0, 210.0", "speed_rpm has 3 lists, the drive has 2 wheels"),
        ("[noise]", "[calibration]\nspin_scale = [1, 1]\n[noise]",
         "calibration.spin_scale has 2 entries for 3 modules"),
        ("[noise]", "[calibration]\ntilt_offset_deg = [[0, 0], [0, -30], [0, 0]]\n[noise]",
         "calibration.tilt_offset_deg[1] is [0.0, -30.0]"),
        ("[noise]", "[calibration]\ntilt_offset_deg = [[0, 0], [0, 0], [11, 0]]\n[noise]",
         "calibration.tilt_offset_deg[2] is [11.0, 0.0] (less than 10 either way: put the servo"),
        ("[noise]", "[calibration]\nspin_scale = [1, 1, 5]\n[noise]",
         "calibration.spin_scale[2]: expected float <= 2.0"),
        ("[noise]", "[calibration]\nspin_scale = [1, 0.2, 1]\n[noise]",
         "calibration.spin_scale[1]: expected float >= 0.5"),
        ("[noise]", "[calibration]\nspin_scale = [1, 1.5, 1]\n[noise]",
         "2500 over calibration.spin_scale[1] = 1.5, motor 2 turns from 2000"),
        ("cruise_speed_rpm = 2500.0", "cruise_speed_rpm = 2500.0\nspin_ratio = [1, 0.5, 1]",
         "2500 times drive.spin_ratio[1] = 0.5, motor 2 turns from 2000"),
        ("signal = [0, 20,", "signal = [0,", "speed_rpm[0] has 10 speeds for 9 signals"),
        ("[0, 0, 2938,", "[0, 2938,", "speed_rpm[1] has 9 speeds for 10 signals"),
        ("signal = [0, 20,", "signal = [20, 20,", "motor.signal must rise"),
        ("[0, 0, 2938, 4762", "[0, 0, 4762, 2938", "motor.speed_rpm[1] must not fall"),
        ("[0, 0, 2938", "[5, 5, 2938", "motor.speed_rpm[1] starts at 5 (0:"),
        ("90.0, 210.0", "90.0, 90.0", "drive.azimuths_deg has the same direction twice"),
        ("90.0, 210.0", "90.0, 450.0", "drive.azimuths_deg has the same direction twice"),
        ("cruise_speed_rpm = 2500.0", "cruise_speed_rpm = 1999.0", "from 2000 to 13603 (between"),
        ("cruise_speed_rpm = 2500.0", "cruise_speed_rpm = 13410.0", "motor 3 turns from 2000 to"),
        ("max_command_age_s = 0.21", "max_command_age_s = 1.5", "limits.max_command_age_s"),
    ],
)  # fmt: skip
def test_values_that_contradict_each_other_are_named(old: str, new: str, says: str) -> None:
    assert says in refusal(edited(old, new))


def test_what_is_not_toml_is_said_to_be_so_with_the_line() -> None:
    message = refusal(edited("[motor]", "[motor"))
    assert "not valid TOML" in message
    assert "line " in message


def test_an_unknown_name_lists_the_shipped_robots_and_suggests_one() -> None:
    with pytest.raises(RobotFileError) as caught:
        load_robot("tds")
    message = str(caught.value)
    assert message.startswith("tds: no such robot, did you mean 'tsd'?")
    assert ", ".join(robot_names()) in message
    assert "my_robot.toml" in message


@pytest.mark.parametrize("name", ["no_such.toml", "./no_such", "no_such/robot.toml"])
def test_a_missing_file_is_named_with_what_is_shipped(name: str) -> None:
    with pytest.raises(RobotFileError) as caught:
        load_robot(name)
    message = str(caught.value)
    assert message.startswith(f"{name}: cannot be read: No such file")
    assert ", ".join(robot_names()) in message


def test_a_folder_and_a_binary_file_are_no_robots(tmp_path: Path) -> None:
    with pytest.raises(RobotFileError, match="cannot be read: Is a directory"):
        load_robot(str(tmp_path))
    binary = tmp_path / "robot.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RobotFileError, match="not UTF-8 text"):
        load_robot(str(binary))


def test_a_description_cannot_be_changed() -> None:
    robot = load_robot("tsd")
    with pytest.raises(AttributeError, match="immutable"):
        robot.drive.wheel_radius_m = 1.0


def test_a_gyro_is_there_when_its_table_is() -> None:
    assert load_robot("tsd").sensors == load_robot("kiwi").sensors == ()
    kiwi = parse_description(read_description("kiwi") + "\n[gyro]\n", "my.toml")
    assert [sensor.name for sensor in kiwi.sensors] == ["gyro"]
    plain = parse_description(TSD + "\n[gyro]\n", "my.toml")
    assert [sensor.name for sensor in plain.sensors] == ["gyro"]
    exact = parse_description(
        TSD + "\n[gyro]\nnoise_rad_per_s = 0.001\nbias_rad_per_s = 0.0\n", "my.toml"
    )
    assert msgspec.to_builtins(exact)["gyro"] == {
        "noise_rad_per_s": 0.001,
        "bias_rad_per_s": 0.0,
        "scale_share": 0.004,
    }


def test_dead_wheels_have_a_gyro_of_their_own() -> None:
    assert "gyro: the dead wheels have one" in refusal(read_description("omni4") + "\n[gyro]\n")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("noise_rad_per_s = -0.001", "gyro.noise_rad_per_s: expected float > 0.0"),
        ("noise_rad_per_s = 0.0", "gyro.noise_rad_per_s: expected float > 0.0"),
        ("noise_rad_per_s = nan", "gyro.noise_rad_per_s: "),
        ("bias_rad_per_s = -1.0", "gyro.bias_rad_per_s: expected float >= 0.0"),
        ("bias_rad_s = 1.0", "unknown key 'bias_rad_s' in [gyro], did you mean 'bias_rad_per_s'?"),
    ],
)
def test_what_no_gyro_can_be_is_refused(line: str, said: str) -> None:
    assert said in refusal(f"{TSD}\n[gyro]\n{line}\n")


@pytest.mark.parametrize(
    ("toml", "says"),
    [
        ("a=" + "[" * 10_000, "nested too deeply"),
        ("a=" + "{a=" * 5000, "nested too deeply"),
        ("a=" + "9" * 5000, "not valid TOML"),
        (TSD + "#" * MAX_FILE_CHARS, "characters are too many"),
        ("a." * 20_000 + "a=1", "characters are too many"),
    ],
)
def test_what_would_take_a_reader_for_ever_is_refused_in_one_sentence(toml: str, says: str) -> None:
    start_s = time.process_time()
    message = refusal(toml)
    assert says in message
    assert len(message) < 200
    assert time.process_time() - start_s < 3.0


def test_thresholds_of_the_battery_that_do_not_rise_are_refused() -> None:
    message = refusal(edited("stop_v = 10.0", "stop_v = 11.1"))
    assert "stop_v, arm_v and warn_v must rise in this order" in message


def test_a_renamed_key_is_still_read() -> None:
    text = read_description("tsd").replace("speed_scale_sigma", "spin_share")
    assert parse_description(text, "my.toml") == load_robot("tsd")


def test_a_key_with_its_old_name_beside_the_new_one_is_unknown() -> None:
    text = read_description("tsd").replace("[noise]\n", "[noise]\nspin_share = 0.02\n")
    with pytest.raises(RobotFileError, match="unknown key 'spin_share' in \\[noise\\]"):
        parse_description(text, "my.toml")
