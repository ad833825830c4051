#include "servos.h"

#include <stddef.h>

#include "clock.h"
#include "control_table.h"
#include "gimbals.h"
#include "servo.h"
#include "servo_line.h"
#include "table.h"

#define ALIVE_MS 50   // As documented in control_table.h.
#define GONE_MS 200   // A servo silent for this time is pinged with both protocols.
#define TORQUE_CYCLES 7  // While armed, one of them is used for another request.
#define LATE_MS 8        // Too late in a cycle to finish another request.
#define SHORT_CYCLES 50
#define TORQUE_MS 150    // Maximum age of a torque report, more than two rounds.

// Longest reply (48 bytes of 10 bits) after a return delay of 500 us; half microseconds.
#define TIMEOUT_HALF_US ((uint16_t)(2 * (800 + 480000000UL / SERVO_BAUD)))
_Static_assert(SERVO_BAUD >= 250000, "six servos do not fit into a cycle below this");

#define ALL ((1 << CT_SERVOS) - 1)

static const registers_t MODEL_NUMBER = {0, 2};

enum { PING, MOVING, STATE, TORQUE, SETTING, TELL };
enum { GOALS_2, GOALS_1, ASK, EXTRA = ASK + CT_SERVOS, REST };

servo_command_t servo_command;

static uint8_t step = REST;
static uint8_t cycle_ms;
static bool due;

// Current request.
static const protocol_t *protocol;
static uint8_t servo, id;
static bool listening;
static bool renumbered;  // The ids changed during this cycle, so its responses are ignored.
static uint8_t question;
static uint16_t listening_since;

static servo_report_t reports[CT_SERVOS];
static uint8_t age_ms[CT_SERVOS], torque_age_ms[CT_SERVOS];
static uint8_t to_tell;  // Bit i: the torque command must be sent to servo i.
static uint8_t told_torque;

// The additional request of each cycle, after goals and positions: its type and servo.
static uint8_t more, more_to, torque_turn, state_turn, setting_turn, since_other, others;
static bool more_due;
static uint8_t short_cycles;  // Remaining cycles that have no time for it.
static const servo_model_t *model[CT_SERVOS];  // NULL if not read.
static uint8_t setting[CT_SERVOS];  // Next setting to read.
static uint8_t probe;  // Next servo and protocol to ping.
static uint8_t right[CT_SERVOS];    // Consecutive settings with the required value.

void servos_start(void) { servo_line_start(); }

static uint8_t bit(uint8_t i) { return 1 << i; }

static const protocol_t *spoken_by(uint8_t i) {
  return table.servo_protocol & bit(i) ? &PROTOCOL_2 : &PROTOCOL_1;
}

// Sends the request in the line's buffer, if any.
static bool send(uint8_t length) {
  if (!length) return false;
  protocol->listen();
  listening = false;
  servo_line_send(length);
  return true;
}

static bool send_goals(const protocol_t *to, uint8_t mask) {
  uint16_t goals[CT_SERVOS];
  uint8_t those = mask & table.servo_found & servo_command.torque;
  if (!those) return false;
  for (uint8_t i = 0; i < CT_SERVOS; i++) goals[i] = gimbals_goal(i, servo_command.goal[i]);
  protocol = to;
  return send(to->set_goals(servo_line_request(), those, goals));
}

static void turn_to(uint8_t i, uint8_t what, const protocol_t *spoken) {
  servo = i;
  id = table.servo_id[i];  // Id of the request; the table may change before the response.
  question = what;
  protocol = spoken;
}

static bool put(uint8_t what, uint8_t i, registers_t registers) {
  if (!(table.servo_found & bit(i))) return false;
  turn_to(i, what, spoken_by(i));
  return send(protocol->read(servo_line_request(), id, registers));
}

static uint8_t first(uint8_t mask) {
  uint8_t i = 0;
  while (i < CT_SERVOS && !(mask & bit(i))) i++;
  return i;
}

// Next servo in `mask` after `i`, or `i` if the mask is empty.
static uint8_t after(uint8_t i, uint8_t mask) {
  uint8_t next = i;
  do {
    next = next + 1 < CT_SERVOS ? next + 1 : 0;
  } while (next != i && !(mask & bit(next)));
  return next;
}

// Chooses the additional request of this cycle, usually a torque check. The others are torque
// commands, settings (unchecked servos first) and state.
static void choose_more(void) {
  bool armed = table.mode != BOARD_DISARMED;
  uint8_t told = to_tell & table.servo_found, unchecked = table.servo_found & ~table.servo_checked;
  more_due = true;
  since_other++;
  if (since_other < (armed ? TORQUE_CYCLES : 2)) {
    more = TORQUE;
    more_to = torque_turn = after(torque_turn, ALL);
    return;
  }
  since_other = 0;
  others++;
  if (told) {
    more = TELL;
    more_to = first(told);
  } else if (!armed && others % (unchecked ? 8 : 4)) {
    more = SETTING;
    more_to = setting_turn = after(setting_turn, unchecked ? unchecked : table.servo_found);
  } else {
    more = STATE;
    more_to = state_turn = after(state_turn, table.servo_found);
  }
}

// Next registers to read for checking the settings, beginning with the model number.
static registers_t next_settings(uint8_t i) {
  if (!model[i]) return MODEL_NUMBER;
  const setting_t *of = &model[i]->settings[setting[i]];
  return (registers_t){of->address, of->read};
}

static bool ask_more(void) {
  const protocol_t *to = spoken_by(more_to);
  more_due = false;
  if (more == TORQUE) return put(TORQUE, more_to, to->torque);
  if (more == STATE) return put(STATE, more_to, to->state);
  if (more == SETTING) return put(SETTING, more_to, next_settings(more_to));
  turn_to(more_to, TELL, to);
  bool torque = servo_command.torque & bit(more_to);
  return send(to->set_torque(servo_line_request(), id, torque));
}

// Additional request after goals and positions, if there is time. With slow servos the time may be
// too short; then it replaces the position request of its servo for a while.
static bool ask_more_at_last(void) {
  if (!more_due) return false;
  if (table.mode != BOARD_DISARMED && cycle_ms >= LATE_MS) {
    short_cycles = SHORT_CYCLES;
    return false;
  }
  return ask_more();
}

// Extrapolates the position of a servo that is not read in this cycle.
static void reckon(uint8_t i) {
  reports[i].position += reports[i].velocity / (1000 / SERVOS_CYCLE_MS);
  gimbals_report(i, &reports[i]);
}

// Requests the position of a servo, or pings one missing servo per cycle.
static bool ask(uint8_t i) {
  if (short_cycles && more_due && i == more_to) {
    reckon(i);
    return ask_more();
  }
  if (table.servo_found & bit(i)) return put(MOVING, i, spoken_by(i)->moving);
  if (i != probe / 2) return false;
  turn_to(i, PING, probe % 2 ? &PROTOCOL_1 : &PROTOCOL_2);
  return send(protocol->ping(servo_line_request(), id));
}

static bool begin(uint8_t now) {
  switch (now) {
    case GOALS_2:
      return send_goals(&PROTOCOL_2, table.servo_protocol);
    case GOALS_1:
      return send_goals(&PROTOCOL_1, ~table.servo_protocol);
    case EXTRA:
      return ask_more_at_last();
    default:
      return ask(now - ASK);
  }
}

static void next(void) {
  do {
    step++;
  } while (step < REST && !begin(step));
}

static void begin_cycle(void) {
  do {
    probe = (probe + 1) % (2 * CT_SERVOS);
  } while (table.servo_found != ALL && (table.servo_found & bit(probe / 2)));
  due = false;
  renumbered = false;
  to_tell |= servo_command.torque ^ told_torque;
  told_torque = servo_command.torque;
  if (short_cycles) short_cycles--;
  if (!more_due) choose_more();
  step = GOALS_2;
  if (!begin(step)) next();
}

static int32_t number(const uint8_t *data, uint8_t size) {
  uint32_t value = 0;
  for (uint8_t i = size; i > 0; i--) value = value << 8 | data[i - 1];
  return (int32_t)value;
}

static void found(uint8_t i) {
  table.servo_found |= bit(i);
  if (protocol == &PROTOCOL_2) {
    table.servo_protocol |= bit(i);
  } else {
    table.servo_protocol &= ~bit(i);
  }
  to_tell |= bit(i);
  model[i] = NULL;
  setting[i] = right[i] = 0;
  age_ms[i] = 0;  // If it never reports a position, it is pinged again with both protocols.
}

static void take_moving(uint8_t i, const uint8_t *data) {
  protocol->report_moving(data, &reports[i]);
  gimbals_report(i, &reports[i]);
  age_ms[i] = 0;
  table.servo_alive |= bit(i);
  if (reports[i].shut_down) table.servo_torque &= ~bit(i);
}

static void take_torque(uint8_t i, bool on) {
  torque_age_ms[i] = 0;
  if (on && !reports[i].shut_down) {
    table.servo_torque |= bit(i);
  } else {
    table.servo_torque &= ~bit(i);
  }
  bool told = told_torque & bit(i);
  if (on != told) {
    to_tell |= bit(i);
  } else {
    to_tell &= ~bit(i);  // Even if the servo does not respond to the command.
  }
}

static void name_wrong(uint8_t i, uint8_t address, int32_t value) {
  right[i] = 0;
  table.servo_checked &= ~bit(i);
  table.wrong_servo = i + 1;
  table.wrong_register = address;
  table.wrong_value = (uint32_t)value;
}

static void take_model(uint8_t i, const uint8_t *data) {
  uint16_t number = data[0] | (uint16_t)data[1] << 8;
  model[i] = servo_model(number);
  table.servo_model[i] = number;
  if (!model[i]) name_wrong(i, MODEL_NUMBER.address, number);
}

static void take_setting(uint8_t i, const setting_t *of, const uint8_t *data) {
  bool named = table.wrong_servo == i + 1 && table.wrong_register == of->address;
  int32_t value = number(data, of->size);
  if (value < of->least || value > of->most) {
    name_wrong(i, of->address, value);
    return;
  }
  if (named) table.wrong_servo = 0;
  if (right[i] < model[i]->count) right[i]++;
  if (right[i] == model[i]->count) table.servo_checked |= bit(i);
}

// Processes the settings from one read.
static void take_settings(uint8_t i, const uint8_t *data) {
  const setting_t *first = &model[i]->settings[setting[i]], *of = first;
  uint8_t at = 0;
  for (; at < first->read; at += of++->size) take_setting(i, of, data + at);
  setting[i] = (setting[i] + (of - first)) % model[i]->count;
}

static void take_answer(const uint8_t *data) {
  if (question == MOVING) {
    take_moving(servo, data);
  } else if (question == STATE) {
    protocol->report_state(data, model[servo] ? model[servo]->current_unit : 0, &reports[servo]);
  } else if (question == TORQUE) {
    take_torque(servo, data[0] != 0);
  } else if (!model[servo]) {
    take_model(servo, data);
  } else {
    take_settings(servo, data);
  }
}

static uint8_t expected_size(void) {
  if (question == MOVING) return protocol->moving.size;
  if (question == STATE) return protocol->state.size;
  if (question == TORQUE) return protocol->torque.size;
  return next_settings(servo).size;
}

static void miss(void) {
  table.servo_errors++;
  table.servo_missed[servo]++;
}

static void take_reply(reply_t reply) {
  if (renumbered) return;
  if (reply == REPLY_NONE || reply == REPLY_BROKEN) {
    if (question != PING) miss();
    return;
  }
  if (reply == REPLY_FAULT) {
    table.servo_fault |= bit(servo);
  } else {
    table.servo_fault &= ~bit(servo);
  }
  if (question == PING) {
    found(servo);
  } else if (question == TELL) {
    to_tell &= ~bit(servo);
  } else {
    const uint8_t *data = protocol->data(expected_size());
    if (data) {
      take_answer(data);
    } else {
      miss();
    }
  }
}

// Whether the current request is finished, with or without a reply.
static bool over(void) {
  if (!listening) {
    listening = true;
    listening_since = clock_half_us();
  }
  if (step < ASK) return true;  // Broadcasts have no reply.
  uint8_t byte = 0;
  while (servo_line_receive(&byte)) {
    reply_t reply = protocol->receive(byte, id);
    if (reply == REPLY_NONE) continue;
    take_reply(reply);
    return true;
  }
  if ((uint16_t)(clock_half_us() - listening_since) < TIMEOUT_HALF_US) return false;
  take_reply(REPLY_NONE);
  return true;
}

void servos_renumber(void) {
  table.servo_found = table.servo_alive = table.servo_torque = table.servo_checked = 0;
  table.servo_fault = table.wrong_servo = 0;
  renumbered = true;
}

void servos_poll(void) {
  while (step < REST && !servo_line_sending() && over()) next();
  if (step >= REST && due) begin_cycle();
}

void servos_tick(void) {
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    if (age_ms[i] < 255) age_ms[i]++;
    if (age_ms[i] > ALIVE_MS) table.servo_alive &= ~bit(i);
    if (torque_age_ms[i] < 255) torque_age_ms[i]++;
    if (torque_age_ms[i] > TORQUE_MS) table.servo_torque &= ~bit(i);
    if (age_ms[i] != GONE_MS) continue;
    table.servo_found &= ~bit(i);
    table.servo_checked &= ~bit(i);
    if (table.wrong_servo == i + 1) table.wrong_servo = 0;
  }
  if (++cycle_ms < SERVOS_CYCLE_MS) return;
  cycle_ms = 0;
  if (step < REST) table.overruns++;
  due = true;
}
