"""Safety-relevant lines of the firmware, each broken on purpose, and the rule that detects it."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from firmware.simulator.board import FIRMWARE


@dataclass(frozen=True)
class Mutant:
    """One mistake: `old` occurs once in `file` and is replaced by `new`."""

    what: str
    file: str
    old: str
    new: str
    law: str
    """Name of the law in `laws.py` that it breaks."""

    @property
    def native(self) -> bool:
        """Whether its law also notices it on this machine, where the program takes no time."""
        return self.file not in _OF_THE_CHIP and not self._rp2040

    @property
    def _rp2040(self) -> bool:
        return self.file.startswith("rp2040/")

    def build(self, folder: Path) -> Path:
        """Build the firmware with this mistake in it; return where it is."""
        sources = [*FIRMWARE.glob("*.c"), *FIRMWARE.glob("*.h"), FIRMWARE / "Makefile"]
        for source in sources:
            shutil.copy2(source, folder)
        made = "build/native/libfirmware.so" if self.native else "build/firmware.elf"
        if self._rp2040:
            made = "build/rp2040/firmware.uf2"
            shutil.copytree(FIRMWARE / "rp2040", folder / "rp2040")
        shutil.copytree(FIRMWARE / "native", folder / "native")
        objects = folder / Path(made).parent
        kept = (FIRMWARE / made).parent
        shutil.copytree(kept, objects, dirs_exist_ok=True)
        path = folder / self.file
        text = path.read_text(encoding="utf-8")
        assert text.count(self.old) == 1, f"{self.file} has not one {self.old!r}"
        path.write_text(text.replace(self.old, self.new), encoding="utf-8")
        run = ["make", "-s", "-C", str(folder), made]
        subprocess.run(run, check=True)
        return (folder / made).with_suffix(".bin") if self._rp2040 else folder / made


_OF_THE_CHIP = ("hal_avr.h", "main.c")


MUTANTS = (
    Mutant(
        "the heartbeat never times out",
        "safety.c",
        "pc && beat_age_ms >= CT_DEFAULT(heartbeat_timeout_ms)",
        "pc && beat_age_ms >= 60000",
        "silence_stops",
    ),
    Mutant(
        "it times out a little late",
        "safety.c",
        "beat_age_ms >= CT_DEFAULT(heartbeat_timeout_ms)",
        "beat_age_ms >= CT_DEFAULT(heartbeat_timeout_ms) + 100",
        "silence_stops",
    ),
    Mutant(
        "the age of the beat is not counted",
        "safety.c",
        "if (beat_age_ms < UINT16_MAX) beat_age_ms++;",
        "",
        "silence_stops",
    ),
    Mutant(
        "any write is a beat",
        "safety.c",
        "  if (ahead) beat_age_ms = 0;",
        "  beat_age_ms = 0;",
        "reading_and_old_beats_do_not_keep_it_going",
    ),
    Mutant(
        "a part of a command counts",
        "table.c",
        "if (command && length != CT_COMMAND_SIZE) return ANSWER_LENGTH;",
        "",
        "a_heartbeat_without_its_command_is_none",
    ),
    Mutant(
        "reading feeds the heartbeat",
        "host.c",
        "      read(packet);\n",
        "      read(packet);\n      { extern bool safety_command(const control_table_t *);\n"
        "        table.heartbeat++; control_table_t again = table;\n"
        "        memcpy(again.session, table.nonce, sizeof again.session);\n"
        "        again.heartbeat++; safety_command(&again); }\n",
        "reading_and_old_beats_do_not_keep_it_going",
    ),
    Mutant(
        "a trip does not disarm",
        "safety.c",
        "  disarm();\n  table.trip = reason;",
        "  table.trip = reason;",
        "silence_stops",
    ),
    Mutant(
        "a trip is not latched: 1 arms again",
        "safety.c",
        "edge = wanted->arm && !arm_was_written;",
        "edge = wanted->arm;",
        "after_a_trip_only_a_new_arming_arms",
    ),
    Mutant(
        "a reset takes the arm switch for 0",
        "safety.c",
        "static bool arm_was_written = true;",
        "static bool arm_was_written = false;",
        "after_a_reset_only_a_new_arming_arms",
    ),
    Mutant(
        "arming wants no beat",
        "safety.c",
        "  if (edge && beat) {",
        "  if (edge || beat) {",
        "arming_wants_a_fresh_command",
    ),
    Mutant(
        "disarming wants a beat",
        "safety.c",
        "  if (!wanted->arm && armed) disarm();",
        "  if (!wanted->arm && armed && ahead) disarm();",
        "a_disarming_counts_without_a_beat",
    ),
    Mutant(
        "the watchdog is not started",
        "watchdog.c",
        "  hal_watchdog_start();\n",
        "",
        "a_hang_ends_in_a_reset_and_standstill",
    ),
    Mutant(
        "the watchdog takes two seconds",
        "hal_avr.h",
        "wdt_enable(WDTO_250MS)",
        "wdt_enable(WDTO_2S)",
        "a_hang_ends_in_a_reset_and_standstill",
    ),
    Mutant(
        "the watchdog is kicked by the main loop",
        "main.c",
        "  servos_poll();\n",
        "  servos_poll();\n  watchdog_kick();\n",
        "a_lost_tick_ends_in_a_reset",
    ),
    Mutant(
        "the watchdog is not kicked",
        "safety.c",
        "  watchdog_kick();\n",
        "",
        "zero_throttle_from_the_first_millisecond",
    ),
    Mutant(
        "a watchdog reset is not reported",
        "safety.c",
        "    table.trip = TRIP_WATCHDOG;\n",
        "",
        "a_hang_ends_in_a_reset_and_standstill",
    ),
    Mutant(
        "the cause of a reset is lost",
        "watchdog.c",
        "  cause = hal_reset_cause();\n",
        "  cause = 0;\n",
        "after_a_reset_only_a_new_arming_arms",
    ),
    Mutant(
        "the speed controllers get no signal",
        "hal_avr.h",
        "  TCCR4B = _BV(WGM43) | _BV(WGM42) | _BV(CS41);",
        "",
        "zero_throttle_from_the_first_millisecond",
    ),
    Mutant(
        "the first pulse is not zero throttle",
        "esc.c",
        "hal_esc_start(CT_ZERO_THROTTLE);",
        "hal_esc_start(CT_FULL_THROTTLE);",
        "zero_throttle_from_the_first_millisecond",
    ),
    Mutant(
        "throttles pass while disarmed",
        "safety.c",
        "pc ? table.throttle[i] : rc ? manual_throttle[i] : CT_ZERO_THROTTLE;",
        "rc ? manual_throttle[i] : table.throttle[i];",
        "who_is_disarmed_moves_nothing",
    ),
    Mutant(
        "goals pass while disarmed",
        "safety.c",
        "pc ? table.goal[i] : rc ? manual_goal[i] : 0;",
        "rc ? manual_goal[i] : table.goal[i];",
        "who_is_disarmed_moves_nothing",
    ),
    Mutant(
        "the limit of the goals is not kept",
        "safety.c",
        "wanted > limit ? limit : wanted < -limit ? -limit : wanted;",
        "wanted > limit ? wanted : wanted < -limit ? wanted : wanted;",
        "goals_end_at_their_limit",
    ),
    Mutant(
        "values beyond their limits are taken",
        "table.c",
        "  if (!within_limits((const uint8_t *)&wanted)) return ANSWER_RANGE;\n",
        "  (void)within_limits;\n",
        "writes_that_are_wrong_change_nothing",
    ),
    Mutant(
        "the setup can be written while armed",
        "table.c",
        "  if (setup && !safety_at_rest()) return ANSWER_ACCESS;\n",
        "",
        "writes_that_are_wrong_change_nothing",
    ),
    Mutant(
        "a part of the setup can be written",
        "table.c",
        "  if (setup && length != CT_SETUP_SIZE) return ANSWER_LENGTH;\n",
        "",
        "writes_that_are_wrong_change_nothing",
    ),
    Mutant(
        "the setup can be written while the wheels run down",
        "safety.c",
        "table.mode == BOARD_DISARMED && rest_ms >= CT_DEFAULT(esc_hold_ms);",
        "table.mode == BOARD_DISARMED;",
        "a_setup_waits_until_the_wheels_have_run_down",
    ),
    Mutant(
        "the session is not looked at",
        "nonce.c",
        "return wanted->session[0] == table.nonce[0] && wanted->session[1] == table.nonce[1];",
        "return wanted->session[0] == table.nonce[0] || true;",
        "a_recorded_session_arms_nothing",
    ),
    Mutant(
        "a disarming does not end the session",
        "safety.c",
        "  zero_throttle_ms = 0;\n  nonce_draw();\n}",
        "  zero_throttle_ms = 0;\n}",
        "a_recorded_session_arms_nothing",
    ),
    Mutant(
        "a refused arming does not end the session",
        "safety.c",
        "  nonce_draw();  // Repeating",
        "  // Repeating",
        "a_recorded_session_arms_nothing",
    ),
    Mutant(
        "an older command is a beat",
        "safety.c",
        "nonce_is(wanted) && !(armed && ahead < 0);",
        "nonce_is(wanted);",
        "commands_that_come_again_are_no_beats",
    ),
    Mutant(
        "telemetry can be written",
        "table.c",
        "  if (!setup && !command) return ANSWER_ACCESS;\n",
        "",
        "writes_that_are_wrong_change_nothing",
    ),
    Mutant(
        "the hold of the speed controllers is not kept",
        "safety.c",
        "  if (!held()) return REFUSAL_ESC_HOLD;\n",
        "",
        "the_hold_of_the_speed_controllers_is_kept",
    ),
    Mutant(
        "a disarming does not begin it again",
        "safety.c",
        "  table.arm = 0;\n  zero_throttle_ms = 0;\n",
        "  table.arm = 0;\n",
        "after_every_disarming_the_hold_begins_again",
    ),
    Mutant(
        "power does not begin it again",
        "safety.c",
        "  if (!power_drive()) {\n    zero_throttle_ms = 0;\n  } else if",
        "  if",
        "power_at_the_drive_moves_nothing",
    ),
    Mutant(
        "the stop circuit is not looked at",
        "safety.c",
        "  if (!power_drive()) return TRIP_DRIVE;\n",
        "",
        "the_stop_circuit_stops",
    ),
    Mutant(
        "arming without power at the drive",
        "safety.c",
        "  if (!power_drive()) return REFUSAL_DRIVE;\n",
        "",
        "the_stop_circuit_stops",
    ),
    Mutant(
        "a part of the battery's voltage is enough",
        "power.c",
        " && table.drive_mv / 3 >= table.battery_mv / 4;",
        ";",
        "a_drive_that_is_not_measured_does_not_arm",
    ),
    Mutant(
        "arming with a low battery",
        "safety.c",
        "  if (power_low()) return REFUSAL_BATTERY;\n",
        "",
        "a_low_battery_does_not_arm",
    ),
    Mutant(
        "an empty battery is no reason to stop",
        "safety.c",
        "  if (power_empty()) return TRIP_BATTERY;\n",
        "",
        "an_empty_battery_stops",
    ),
    Mutant(
        "a short dip is an empty battery",
        "power.c",
        "    empty_ms = 0;\n  } else if",
        "  } else if",
        "an_empty_battery_stops",
    ),
    Mutant(
        "the supply is taken for 5 V",
        "power.c",
        "(uint32_t)table.supply_mv * HAL_DIVIDER",
        "5000UL * HAL_DIVIDER",
        "the_supply_is_no_measure_of_the_battery",
    ),
    Mutant(
        "arming with throttle",
        "safety.c",
        "  if (!throttles_zero()) return REFUSAL_THROTTLE;\n",
        "  (void)throttles_zero;\n",
        "arming_wants_zero_throttle_and_zero_goals",
    ),
    Mutant(
        "arming with tilted goals",
        "safety.c",
        "  if (!goals_zero()) return REFUSAL_GOAL;\n",
        "  (void)goals_zero;\n",
        "arming_wants_zero_throttle_and_zero_goals",
    ),
    Mutant(
        "arming with tilted gimbals",
        "safety.c",
        "  if (!neutral()) return REFUSAL_NOT_NEUTRAL;\n",
        "  (void)neutral;\n",
        "arming_wants_neutral_gimbals",
    ),
    Mutant(
        "arming without a setup",
        "safety.c",
        "  if (!setup_known()) return REFUSAL_SETUP;\n",
        "",
        "without_a_setup_nothing_moves",
    ),
    Mutant(
        "servos hold without a setup",
        "safety.c",
        "bool holds = setup_known() && (",
        "bool holds = (",
        "without_a_setup_nothing_moves",
    ),
    Mutant(
        "the setup is not stored",
        "setup.c",
        "  stored = 0;\n",
        "",
        "a_setup_is_kept_over_resets",
    ),
    Mutant(
        "the sum of the setup is not looked at",
        "setup.c",
        " || image.sum != sum) return;",
        ") return;\n  (void)sum;",
        "a_setup_that_was_spoilt_is_none",
    ),
    Mutant(
        "the rules wait until the line pauses",
        "main.c",
        "if (stage == DONE && clock_tick())",
        "if (!more && stage == DONE && clock_tick())",
        "a_flood_does_not_keep_the_rules_waiting",
    ),
    Mutant(
        "a servo that dies is not noticed",
        "servos.c",
        "if (age_ms[i] > ALIVE_MS) table.servo_alive &= ~bit(i);",
        "",
        "a_servo_that_dies_stops_and_is_named",
    ),
    Mutant(
        "a servo that dies is no reason to stop",
        "safety.c",
        "  if (!servos_well()) return host_disturbed() ? TRIP_LINE : TRIP_SERVO;\n",
        "",
        "a_servo_that_dies_stops_and_is_named",
    ),
    Mutant(
        "a servo with an error is well",
        "safety.c",
        " && !(table.servo_fault & expected);",
        ";",
        "a_servo_in_trouble_stops",
    ),
    Mutant(
        "lost torque is no reason to stop",
        "safety.c",
        "  if (!servos_hold()) return host_disturbed() ? TRIP_LINE : TRIP_TORQUE;\n",
        "",
        "torque_that_is_lost_stops",
    ),
    Mutant(
        "torque is not asked for while armed",
        "servos.c",
        "#define TORQUE_CYCLES 7",
        "#define TORQUE_CYCLES 1",
        "torque_that_is_lost_stops",
    ),
    Mutant(
        "a shutdown is not noticed",
        "protocol1.c",
        "report->shut_down = !u16(data);",
        "report->shut_down = false;",
        "torque_that_is_lost_stops",
    ),
    Mutant(
        "torque is not given back",
        "servos.c",
        "  if (on != told) {\n",
        "  if (on != told && !told) {\n",
        "torque_that_is_lost_stops",
    ),
    Mutant(
        "servos with Protocol 1.0 get no goals",
        "servos.c",
        "return send_goals(&PROTOCOL_1, ~table.servo_protocol);",
        "return false;",
        "a_goal_gives_torque_back_with_protocol_1",
    ),
    Mutant(
        "arming without torque",
        "safety.c",
        "  if (!servos_hold()) return REFUSAL_TORQUE;\n",
        "",
        "arming_wants_torque",
    ),
    Mutant(
        "arming with any setting of a servo",
        "safety.c",
        "  if (!servos_set()) return REFUSAL_SETTING;\n",
        "  (void)servos_set;\n",
        "settings_of_servos_are_checked",
    ),
    Mutant(
        "a wrong setting is not named",
        "servos.c",
        "  table.wrong_servo = i + 1;\n",
        "",
        "settings_of_servos_are_checked",
    ),
    Mutant(
        "one setting is enough",
        "servos.c",
        "if (right[i] == model[i]->count) table",
        "if (right[i] > 0) table",
        "settings_of_servos_are_checked",
    ),
    Mutant(
        "servos let go while armed",
        "safety.c",
        "(table.torque || pc || rc)",
        "table.torque",
        "servos_hold_while_armed",
    ),
    Mutant(
        "the kill switch is not looked at",
        "safety.c",
        "  if (receiver_kills()) return TRIP_KILL;\n",
        "",
        "the_kill_switch_stops",
    ),
    Mutant(
        "arming with the kill switch on",
        "safety.c",
        "  if (receiver_kills()) return REFUSAL_KILL;\n",
        "",
        "the_kill_switch_stops",
    ),
    Mutant(
        "a lost radio control is not noticed",
        "receiver.c",
        "expires(&age[i])",
        "false",
        "a_lost_radio_control_stops",
    ),
    Mutant(
        "a lost radio control is no reason to stop",
        "safety.c",
        "  if (receiver_lost()) return TRIP_RC_LOST;\n",
        "",
        "a_lost_radio_control_stops",
    ),
    Mutant(
        "a switch has one threshold",
        "receiver.c",
        "return us > SWITCH_ON_US || (before && us > SWITCH_OFF_US);",
        "return us > SWITCH_OFF_US || (before && us > SWITCH_OFF_US);",
        "a_switch_between_its_ends_does_not_chatter",
    ),
    Mutant(
        "a receiver counts only when it is whole",
        "receiver.c",
        "if (table.rc[i]) watchdog_memory.receiver_seen = true;",
        "if (receiver_present()) watchdog_memory.receiver_seen = true;",
        "a_wire_of_the_receiver_that_is_off_stops",
    ),
    Mutant(
        "a reset forgets what was there",
        "watchdog.c",
        "watchdog_memory.magic != MAGIC || (cause & HAL_CAUSE_POWER)",
        "true",
        "a_lost_radio_control_is_missed_after_a_reset_too",
    ),
    Mutant(
        "power does not make a new start",
        "watchdog.c",
        "watchdog_memory.magic != MAGIC || (cause & HAL_CAUSE_POWER)",
        "watchdog_memory.magic != MAGIC && (cause & HAL_CAUSE_POWER)",
        "power_makes_a_new_start",
    ),
    Mutant(
        "bytes wait for the next millisecond",
        "host_line.c",
        "  in_head = head + 1;\n  hal_wake();\n",
        "  in_head = head + 1;\n",
        "questions_are_answered_at_once",
    ),
    Mutant(
        "a line with SBUS that went silent is not noticed",
        "receiver.c",
        "expires(&frame_age)",
        "false",
        "frames_that_are_not_heard_well_are_none",
    ),
    Mutant(
        "the fail-safe of SBUS is not looked at",
        "sbus.c",
        "  if (flags & FAILSAFE) return SBUS_FAILSAFE;\n",
        "",
        "a_receiver_without_signal_stops",
    ),
    Mutant(
        "frames that the receiver made up count",
        "sbus.c",
        "  if (flags & MISSED) return SBUS_NONE;\n",
        "",
        "frames_that_are_not_heard_well_are_none",
    ),
    Mutant(
        "frames with a wrong parity count",
        "sbus.c",
        "broken || (decoder->count == 0",
        "(broken && false) || (decoder->count == 0",
        "frames_that_are_not_heard_well_are_none",
    ),
    Mutant(
        "frames with a wrong end count",
        "sbus.c",
        "last != 0 && (last & 0xcf) != 0x04",
        "last == 255",
        "frames_that_are_not_heard_well_are_none",
    ),
    Mutant(
        "channels are in the order of the wires",
        "receiver.c",
        "uint8_t channel = map & 0xf;",
        "uint8_t channel = i;",
        "the_channels_of_the_receiver_are_those_of_the_setup",
    ),
    Mutant(
        "zero throttle is 1 ms for all speed controllers",
        "esc.c",
        "half_us[i] = table.pulse_low[i];",
        "half_us[i] = throttle;",
        "pulses_end_where_the_setup_says",
    ),
    Mutant(
        "zero throttle changes under power",
        "table.c",
        "changes_pulses(&wanted) && power_drive()",
        "changes_pulses(&wanted) && false",
        "zero_throttle_changes_without_power_only",
    ),
    Mutant(
        "an expected receiver is not missed",
        "receiver.c",
        "(table.receiver_expected || watchdog_memory.receiver_seen)",
        "watchdog_memory.receiver_seen",
        "an_expected_receiver_is_missed_when_power_comes",
    ),
    Mutant(
        "all sticks end alike",
        "manual.c",
        "int16_t low = table.stick_low[RC_SPEED];",
        "int16_t low = 1100;",
        "the_radio_control_begins_at_the_low_end_of_its_stick",
    ),
    Mutant(
        "the radio control cannot take over",
        "safety.c",
        "  if (pc && receiver_manual()) return TRIP_RC_TOOK_OVER;\n",
        "",
        "the_radio_control_takes_over_and_gives_back",
    ),
    Mutant(
        "the radio control does not give back",
        "safety.c",
        "  if (table.mode == BOARD_RC && !manual) disarm();\n",
        "",
        "the_radio_control_takes_over_and_gives_back",
    ),
    Mutant(
        "the radio control begins by itself",
        "safety.c",
        "manual_before = manual || !receiver_present();",
        "manual_before = manual;",
        "the_radio_control_begins_with_its_switch_and_no_speed",
    ),
    Mutant(
        "the radio control begins at speed",
        "safety.c",
        "  if (!manual_speed_is_zero()) return REFUSAL_THROTTLE;\n",
        "",
        "the_radio_control_begins_with_its_switch_and_no_speed",
    ),
    Mutant(
        "trips hold for the PC only",
        "safety.c",
        "table.mode == BOARD_DISARMED ? TRIP_NONE",
        "table.mode != BOARD_ARMED ? TRIP_NONE",
        "the_radio_control_is_stopped_like_the_pc",
    ),
    Mutant(
        "the servo bus is not let go of",
        "servo_line.c",
        "  hal_bus_drive(false);",
        "",
        "silence_stops",
    ),
    Mutant(
        "servos have the ids 1 to 6",
        "servos.c",
        "id = table.servo_id[i];",
        "id = i + 1;",
        "servos_have_the_ids_of_the_setup",
    ),
    Mutant(
        "any id is pinged",
        "servos.c",
        "protocol->ping(servo_line_request(), id)",
        "protocol->ping(servo_line_request(), 0xfe)",
        "a_servo_that_is_not_there_is_missed_by_its_id",
    ),
    Mutant(
        "two servos may have one id",
        "table.c",
        "  if (!all_differ(wanted.servo_id)) return ANSWER_RANGE;\n",
        "  (void)all_differ(wanted.servo_id);\n",
        "ids_of_servos_are_checked",
    ),
    Mutant(
        "servos with new ids are taken for the old",
        "table.c",
        "servos_renumber();",
        "{}",
        "new_ids_make_the_servos_unknown",
    ),
    Mutant(
        "a neutral position may be anywhere",
        "gimbals.c",
        "position[i] > NEAR_STEPS || table.position[i] < -NEAR_STEPS",
        "position[i] > 9999 || table.position[i] < -9999",
        "a_neutral_far_from_where_a_servo_stands_turns_nothing",
    ),
    Mutant(
        "a source may arm far from neutral",
        "safety.c",
        "  if (table.servos_expected & table.servo_far) return REFUSAL_NEUTRAL;\n",
        "",
        "what_is_wrong_with_the_robot_is_refused_to_every_source",
    ),
    Mutant(
        "neutral is asked of the PC only",
        "safety.c",
        "  if (!neutral()) return REFUSAL_NOT_NEUTRAL;\n",
        "  if (!neutral() && !receiver_manual()) return REFUSAL_NOT_NEUTRAL;\n",
        "what_is_wrong_with_the_robot_is_refused_to_every_source",
    ),
    Mutant(
        "a low voltage at the drive is a reason for the PC only",
        "safety.c",
        "  if (!power_drive()) return TRIP_DRIVE;\n",
        "  if (pc && !power_drive()) return TRIP_DRIVE;\n",
        "what_happens_to_the_robot_stops_every_source",
    ),
    Mutant(
        "gimbals need not follow",
        "safety.c",
        "  if (following_stuck()) return TRIP_FOLLOWING;\n",
        "",
        "a_gimbal_that_does_not_follow_stops_every_source",
    ),
    Mutant(
        "gimbals need not follow the radio control",
        "safety.c",
        "following_tick(table.mode != BOARD_DISARMED);",
        "following_tick(table.mode == BOARD_ARMED);",
        "a_gimbal_that_does_not_follow_stops_every_source",
    ),
    Mutant(
        "a gimbal under way is a stuck one",
        "following.c",
        "(toward > 0 ? 3 * toward / 10 : 0)",
        "0 * toward",
        "a_gimbal_that_is_under_way_follows",
    ),
    Mutant(
        "the radio control drives without its gimbals",
        "safety.c",
        "  if (table.servos_expected != ALL_SERVOS) return REFUSAL_RC_WITHOUT_SERVOS;\n",
        "",
        "the_radio_control_has_all_gimbals_or_nothing",
    ),
    Mutant(
        "a take-over does not wait",
        "safety.c",
        "asking_ms = takes_over ? TAKE_OVER_MS : 1;",
        "asking_ms = 1;",
        "a_take_over_waits_until_gimbals_are_upright",
    ),
    Mutant(
        "STOP ends what the PC drives only",
        "safety.c",
        "if (table.mode != BOARD_DISARMED) trip(TRIP_STOPPED);",
        "if (table.mode == BOARD_ARMED) trip(TRIP_STOPPED);",
        "what_happens_to_the_robot_stops_every_source",
    ),
    Mutant(
        "STOP is not latched",
        "safety.c",
        "  if (stopped) return REFUSAL_STOPPED;\n",
        "",
        "a_stop_of_the_pc_holds_for_every_source",
    ),
    Mutant(
        "who stops the radio control leaves the session",
        "safety.c",
        "if (table.mode == BOARD_RC && !manual) disarm();",
        "if (table.mode == BOARD_RC && !manual) table.mode = BOARD_DISARMED;",
        "who_leaves_begins_the_hold_and_a_new_session",
    ),
    Mutant(
        "only the PC's throttle counts for rest",
        "safety.c",
        "    if (table.throttle_out[i] != CT_ZERO_THROTTLE) {",
        "    if (pc && table.throttle_out[i] != CT_ZERO_THROTTLE) {",
        "who_leaves_begins_the_hold_and_a_new_session",
    ),
    Mutant(
        "throttles have no limit",
        "safety.c",
        "risen < table.throttle_limit[i] ? risen : table.throttle_limit[i]",
        "risen",
        "the_throttles_of_every_source_have_a_limit_and_a_rise",
    ),
    Mutant(
        "throttles rise at once",
        "safety.c",
        "table.throttle_out[i] + table.throttle_rise",
        "table.throttle_limit[i]",
        "the_throttles_of_every_source_have_a_limit_and_a_rise",
    ),
    Mutant(
        "joints snap to neutral",
        "safety.c",
        "approach_tick(goals, !pc && !rc && !watchdog_memory.wheels_may_spin);",
        "approach_tick(goals, false);",
        "joints_without_an_operator_approach_slowly",
    ),
    Mutant(
        "gimbals take their time while wheels spin",
        "safety.c",
        "      watchdog_memory.wheels_may_spin = true;\n",
        "",
        "joints_get_upright_at_once_while_wheels_run_down",
    ),
    Mutant(
        "a stick may rest beside its ends",
        "table.c",
        "  if (!sticks_end_where_they_can(&wanted)) return ANSWER_RANGE;\n",
        "  (void)sticks_end_where_they_can(&wanted);\n",
        "a_stick_rests_between_its_ends",
    ),
    Mutant(
        "the stop circuit need not have opened",
        "safety.c",
        "  if (!watchdog_memory.stop_proven) return REFUSAL_STOP_NOT_PROVEN;\n",
        "",
        "the_stop_circuit_is_seen_open_before_the_first_arming",
    ),
    Mutant(
        "a drive without a battery proves the stop",
        "power.c",
        " && table.battery_mv >= DRIVE_LEAST_MV",
        "",
        "the_stop_circuit_is_seen_open_before_the_first_arming",
    ),
    Mutant(
        "a setting may be wrong by one",
        "servos.c",
        "value > of->most) {",
        "value > of->most + 1) {",
        "one_wrong_setting_is_enough",
    ),
    Mutant(
        "servos of an unknown model are not named",
        "servos.c",
        "  if (!model[i]) name_wrong(i, MODEL_NUMBER.address, number);\n",
        "",
        "servos_of_other_models_are_refused",
    ),
    Mutant(
        "all servos have the settings of the first model",
        "servo_models.c",
        "return &MODELS[i];",
        "return &MODELS[0];",
        "each_model_has_its_own_settings",
    ),
    Mutant(
        "a hot servo does not stop the wheels",
        "safety.c",
        "  if (servos_hot()) return TRIP_HOT;\n",
        "",
        "a_hot_servo_stops",
    ),
    Mutant(
        "the radio control may start with a hot servo",
        "safety.c",
        "  if (servos_hot()) return REFUSAL_HOT;\n",
        "",
        "a_hot_servo_stops_the_radio_control",
    ),
    Mutant(
        "a hot servo does not slow the radio control",
        "manual.c",
        "    if (hottest() >= ROBOT_HOT_C) slow = true;\n",
        "",
        "a_hot_servo_slows_the_radio_control",
    ),
    Mutant(
        "a silent servo is blamed for a disturbed line",
        "safety.c",
        "return host_disturbed() ? TRIP_LINE : TRIP_SERVO;",
        "return TRIP_SERVO;",
        "servos_are_not_blamed_for_a_disturbed_line",
    ),
    Mutant(
        "a disturbance of the line lasts for ever",
        "host.c",
        "return since_error_ms < DISTURBED_MS;",
        "return true;",
        "a_disturbance_of_the_line_is_over_after_50_ms",
    ),
    Mutant(
        "the bus is released at a time half a range of the timer away",
        "rp2040/hal.c",
        "look_at_bus(REGISTER(TIMER_RAW));",
        "look_at_bus(0);",
        "silence_stops",
    ),
    Mutant(
        "edges of the receiver wait until a buffer is filled",
        "rp2040/hal.c",
        "  REGISTER(NVIC_PRIORITY(IRQ_UART0)) = 0x4040u;\n",
        "",
        "a_switch_between_its_ends_does_not_chatter",
    ),
    Mutant(
        "the watchdog of the RP2040 is not started",
        "rp2040/hal.c",
        "  REGISTER(WATCHDOG) = BIT(30);\n",
        "",
        "a_hang_ends_in_a_reset_and_standstill",
    ),
    Mutant(
        "the first pulse of the RP2040 comes after one period",
        "rp2040/hal.c",
        "+ PWM_CTR) = ESC_PERIOD - 1u;",
        "+ PWM_CTR) = 1u;",
        "zero_throttle_from_the_first_millisecond",
    ),
    Mutant(
        "changes are not stored in the flash",
        "rp2040/flash.c",
        "  begin(PROGRAM, SECTORS + next * PAGE);\n",
        "",
        "a_setup_is_kept_over_resets",
    ),
    Mutant(
        "the flash of the RP2040 is not read",
        "rp2040/flash.c",
        "    page = found;\n",
        "",
        "a_setup_is_kept_over_resets",
    ),
)
