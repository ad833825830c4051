#include "safety.h"

#include <string.h>

#include "approach.h"
#include "esc.h"
#include "following.h"
#include "hal.h"
#include "host.h"
#include "light.h"
#include "manual.h"
#include "nonce.h"
#include "power.h"
#include "receiver.h"
#include "servos.h"
#include "setup.h"
#include "table.h"
#include "trip_history.h"
#include "watchdog.h"
#include "wheel_following.h"

#define ALL_SERVOS ((1 << CT_SERVOS) - 1)
#define STOP 2  // Value of `arm`.
#define TAKE_OVER_MS 500
#define RISE_MS 10

// Last value written to `arm`. Initially 1, so that a PC that keeps sending 1 does not arm a board
// that was just reset.
static bool arm_was_written = true;
// Time since the last heartbeat. Counting up instead of comparing with a clock cannot wrap.
static uint16_t beat_age_ms;
// Duration of zero throttle since the speed controllers got power and the last source lost control.
static uint16_t zero_throttle_ms;
static uint16_t rest_ms;  // Time since the last throttle or the start.
static bool manual_before;
static bool stopped;  // By the PC; also applies to the radio control.
static uint16_t asking_ms;  // Time left for the radio control to wait for upright gimbals.
static bool asks_to_take_over;
static uint16_t most_throttle[CT_ESCS] = {CT_ZERO_THROTTLE, CT_ZERO_THROTTLE, CT_ZERO_THROTTLE};
static uint8_t rise_ms;

void safety_start(void) {
  table.reset_cause = watchdog_reset_cause();
  if (table.reset_cause & HAL_CAUSE_WATCHDOG) {
    table.trip = TRIP_WATCHDOG;
    watchdog_memory.trips++;
    trip_history_add(TRIP_WATCHDOG);
  }
  hal_light_start();
}

static void disarm(void) {
  table.mode = BOARD_DISARMED;
  table.arm = 0;
  zero_throttle_ms = 0;
  nonce_draw();
}

static void trip(trip_code_t reason) {
  disarm();
  table.trip = reason;
  table.servo_stuck = reason == TRIP_FOLLOWING ? following_stuck() : 0;
  wheel_following_report(reason == TRIP_WHEEL);
  watchdog_memory.trips++;
  trip_history_add(reason);
}

static bool servos_well(void) {
  uint8_t expected = table.servos_expected;
  return (table.servo_alive & expected) == expected && !(table.servo_fault & expected);
}

static bool servos_hold(void) {
  uint8_t expected = table.servos_expected;
  return (table.servo_torque & expected) == expected;
}

static bool servos_set(void) {
  uint8_t expected = table.servos_expected;
  return (table.servo_checked & expected) == expected;
}

static bool servos_hot(void) {
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    bool expected = table.servos_expected & 1 << i;
    if (expected && table.temperature[i] >= CT_DEFAULT(servo_hot_c)) return true;
  }
  return false;
}

static bool neutral(void) {
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    int16_t off = table.position[i], band = CT_DEFAULT(neutral_band);
    bool expected = table.servos_expected & 1 << i;
    if (expected && (off > band || off < -band)) return false;
  }
  return true;
}

static bool throttles_zero(void) {
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    if (table.throttle[i] != CT_ZERO_THROTTLE) return false;
  }
  return true;
}

static bool goals_zero(void) {
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    if (table.goal[i] != 0) return false;
  }
  return true;
}

static bool held(void) { return zero_throttle_ms >= CT_DEFAULT(esc_hold_ms); }

// Reason to refuse any source of joint commands. All conditions of the robot are here, so that they
// apply to every source; a source may have further conditions on its commands.
static refusal_code_t refusal_to_anybody(void) {
  if (stopped) return REFUSAL_STOPPED;
  if (!setup_known()) return REFUSAL_SETUP;
  if (!power_drive()) return REFUSAL_DRIVE;
  if (!watchdog_memory.stop_proven) return REFUSAL_STOP_NOT_PROVEN;
  if (power_low()) return REFUSAL_BATTERY;
  if (receiver_lost()) return REFUSAL_RECEIVER;
  if (receiver_kills()) return REFUSAL_KILL;
  if (!servos_well()) return REFUSAL_SERVO;
  if (!servos_set()) return REFUSAL_SETTING;
  if (servos_hot()) return REFUSAL_HOT;
  if (table.servos_expected & table.servo_far) return REFUSAL_NEUTRAL;
  if (!servos_hold()) return REFUSAL_TORQUE;
  if (!neutral()) return REFUSAL_NOT_NEUTRAL;
  if (!held()) return REFUSAL_ESC_HOLD;
  return REFUSAL_NONE;
}

static refusal_code_t refusal_to_pc(void) {
  refusal_code_t refusal = refusal_to_anybody();
  if (refusal) return refusal;
  if (table.mode == BOARD_RC || receiver_manual()) return REFUSAL_RC;
  if (!throttles_zero()) return REFUSAL_THROTTLE;
  if (!goals_zero()) return REFUSAL_GOAL;
  return REFUSAL_NONE;
}

static refusal_code_t refusal_to_radio(bool takes_over) {
  refusal_code_t refusal = refusal_to_anybody();
  // The speed controllers had power all the time, and the speed stick is at zero throttle.
  if (takes_over && refusal == REFUSAL_ESC_HOLD) refusal = REFUSAL_NONE;
  if (refusal) return refusal;
  if (table.servos_expected != ALL_SERVOS) return REFUSAL_RC_WITHOUT_SERVOS;
  if (!manual_speed_is_zero()) return REFUSAL_THROTTLE;
  return REFUSAL_NONE;
}

static void give_to(board_code_t mode) {
  table.mode = mode;
  table.trip = TRIP_NONE;
  trip_history_begin();
}

// Stores the command block; only then it applies.
static void take(const control_table_t *wanted) {
  table.heartbeat = wanted->heartbeat;
  table.torque = wanted->torque;
  memcpy(table.throttle, wanted->throttle, sizeof table.throttle);
  memcpy(table.goal, wanted->goal, sizeof table.goal);
  memcpy(table.session, wanted->session, sizeof table.session);
}

static void ask_to_arm(bool edge, bool beat) {
  if (edge && beat) {
    table.refusal = refusal_to_pc();
    if (!table.refusal) {
      table.arm = 1;
      give_to(BOARD_ARMED);
      return;
    }
  }
  nonce_draw();  // Repeating this request must not arm the board later.
}

static void stop(void) {
  if (table.mode != BOARD_DISARMED) trip(TRIP_STOPPED);
  stopped = true;
}

bool safety_command(const control_table_t *wanted) {
  bool armed = table.mode == BOARD_ARMED;
  int16_t ahead = wanted->heartbeat - table.heartbeat;
  bool ours = nonce_is(wanted) && !(armed && ahead < 0);
  table.beat = wanted->heartbeat;
  if (wanted->arm == STOP) stop();
  if (!wanted->arm && armed) disarm();
  if (!ours) return wanted->arm != 1;
  if (!wanted->arm) stopped = false;
  bool edge = wanted->arm && !arm_was_written;
  arm_was_written = wanted->arm;
  take(wanted);
  if (ahead) beat_age_ms = 0;
  if (wanted->arm == 1 && !armed) ask_to_arm(edge, ahead);
  return true;
}

bool safety_at_rest(void) {
  return table.mode == BOARD_DISARMED && rest_ms >= CT_DEFAULT(esc_hold_ms);
}

static trip_code_t reason_to_trip(void) {
  bool pc = table.mode == BOARD_ARMED;
  if (receiver_lost()) return TRIP_RC_LOST;
  if (receiver_kills()) return TRIP_KILL;
  if (!power_drive()) return TRIP_DRIVE;
  if (power_empty()) return TRIP_BATTERY;
  // A line that keeps the board busy also blocks servo communication, so do not blame the servos.
  if (!servos_well()) return host_disturbed() ? TRIP_LINE : TRIP_SERVO;
  if (!servos_hold()) return host_disturbed() ? TRIP_LINE : TRIP_TORQUE;
  if (servos_hot()) return TRIP_HOT;
  if (following_stuck()) return TRIP_FOLLOWING;
  if (wheel_following_stuck()) return TRIP_WHEEL;
  if (pc && receiver_manual()) return TRIP_RC_TOOK_OVER;
  if (pc && beat_age_ms >= CT_DEFAULT(heartbeat_timeout_ms)) return TRIP_HEARTBEAT;
  return TRIP_NONE;
}

// The radio control takes over when its switch is moved to manual, and loses control when it is
// moved back. If the switch is at manual when the receiver is first received, it must be moved
// there again.
static void look_at_switch(bool takes_over) {
  bool manual = receiver_manual(), edge = manual && !manual_before;
  manual_before = manual || !receiver_present();
  if (table.mode == BOARD_RC && !manual) disarm();
  if (edge) {
    asks_to_take_over = takes_over;
    asking_ms = takes_over ? TAKE_OVER_MS : 1;
  }
  if (!manual || table.mode != BOARD_DISARMED) asking_ms = 0;
  if (!asking_ms) return;
  asking_ms--;
  table.refusal = refusal_to_radio(asks_to_take_over);
  if (table.refusal == REFUSAL_NONE) {
    manual_begin();
    give_to(BOARD_RC);
  }
  // Wait for gimbals tilted by the PC to become upright.
  if (table.refusal != REFUSAL_NOT_NEUTRAL) asking_ms = 0;
}

// Current upper bound for all sources: the limit, and the allowed increase.
static void limit_throttles(void) {
  if (++rise_ms < RISE_MS) return;
  rise_ms = 0;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    uint16_t risen = table.throttle_out[i] + table.throttle_rise;
    most_throttle[i] = risen < table.throttle_limit[i] ? risen : table.throttle_limit[i];
  }
}

// Applies permitted commands; without a source, zero throttle and neutral gimbals.
static void put_out(void) {
  bool pc = table.mode == BOARD_ARMED, rc = table.mode == BOARD_RC;
  int16_t limit = table.goal_limit;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    uint16_t wanted = pc ? table.throttle[i] : rc ? manual_throttle[i] : CT_ZERO_THROTTLE;
    table.throttle_out[i] = wanted < most_throttle[i] ? wanted : most_throttle[i];
    if (table.throttle_out[i] != CT_ZERO_THROTTLE) {
      rest_ms = 0;
      watchdog_memory.wheels_may_spin = true;
    }
  }
  if (rest_ms == CT_DEFAULT(esc_hold_ms)) watchdog_memory.wheels_may_spin = false;
  int16_t goals[CT_SERVOS];
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    int16_t wanted = pc ? table.goal[i] : rc ? manual_goal[i] : 0;
    goals[i] = wanted > limit ? limit : wanted < -limit ? -limit : wanted;
  }
  approach_tick(goals, !pc && !rc && !watchdog_memory.wheels_may_spin);
  bool holds = setup_known() && (table.torque || pc || rc);
  servo_command.torque = holds ? ALL_SERVOS & ~table.servo_far : 0;
  esc_put();
}

// Speed controllers that just got power may interpret any throttle as a speed or as the start of
// their calibration, so they first get 2 s of zero throttle.
static void hold_zero_throttle(void) {
  if (!power_drive()) {
    zero_throttle_ms = 0;
  } else if (table.mode == BOARD_DISARMED && !held()) {
    zero_throttle_ms++;
  }
}

void safety_tick(void) {
  if (beat_age_ms < UINT16_MAX) beat_age_ms++;
  if (rest_ms < CT_DEFAULT(esc_hold_ms)) rest_ms++;
  hold_zero_throttle();
  trip_code_t reason = table.mode == BOARD_DISARMED ? TRIP_NONE : reason_to_trip();
  if (reason) trip(reason);
  look_at_switch(reason == TRIP_RC_TOOK_OVER);
}

void safety_follow(void) {
  following_tick(table.mode != BOARD_DISARMED);
  wheel_following_tick(table.mode != BOARD_DISARMED);
  if (table.mode == BOARD_RC) manual_tick();
  limit_throttles();
}

void safety_put_out(void) {
  put_out();
  table.setup_known = setup_known();
  table.drive_on = power_drive();
  table.stop_proven = watchdog_memory.stop_proven;
  table.esc_ready = held();
  table.trips = watchdog_memory.trips;
  table.resets = watchdog_memory.resets;
  light_tick();
  watchdog_kick();
}
