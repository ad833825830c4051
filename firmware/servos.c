#include "servos.h"

#include "clock.h"
#include "control_table.h"
#include "gimbals.h"
#include "servo.h"
#include "servo_line.h"
#include "table.h"

#define ALIVE_MS 50   // As control_table.h says.
#define GONE_MS 200   // Then it is looked for by ping, in both protocols.
#define REMIND_CYCLES 16  // A servo that lost power for a moment is told again what it shall do.

// The longest reply, 48 bytes of 10 bits, after a return delay of 500 us; in half microseconds.
#define TIMEOUT_HALF_US ((uint16_t)(2 * (800 + 480000000UL / SERVO_BAUD)))
_Static_assert(SERVO_BAUD >= 250000, "six servos do not fit into a cycle below this");

#define ALL ((1 << CT_SERVOS) - 1)

enum { GOALS_2, GOALS_1, ASK, EXTRA = ASK + CT_SERVOS, REST };

servo_command_t servo_command;

static uint8_t step = REST;
static uint8_t cycle_ms, cycles, reminded;
static bool due;

// The request under way.
static const protocol_t *protocol;
static uint8_t servo;
static bool pinging, listening;
static uint16_t listening_since;

static servo_report_t reports[CT_SERVOS];
static uint8_t age_ms[CT_SERVOS];
static uint8_t to_tell;  // Bit i: servo i has to be told whether to hold.
static bool told_torque;
static uint8_t probe;  // Next servo to look for, and in which protocol.

void servos_start(void) {
  for (uint8_t i = 0; i < CT_SERVOS; i++) age_ms[i] = 255;
  servo_line_start();
}

static uint8_t bit(uint8_t i) { return 1 << i; }

static const protocol_t *spoken_by(uint8_t i) {
  return table.servo_protocol & bit(i) ? &PROTOCOL_2 : &PROTOCOL_1;
}

// Sends what was written to the line, if it is anything.
static bool send(uint8_t length) {
  if (!length) return false;
  protocol->listen();
  listening = false;
  servo_line_send(length);
  return true;
}

static bool send_goals(const protocol_t *to, uint8_t mask) {
  if (!servo_command.torque) return false;
  uint16_t goals[CT_SERVOS];
  for (uint8_t i = 0; i < CT_SERVOS; i++) goals[i] = gimbals_goal(i, servo_command.goal[i]);
  protocol = to;
  return send(to->set_goals(servo_line_request(), mask & table.servo_found, goals));
}

static bool ask(uint8_t i) {
  if (!(table.servo_found & bit(i))) return false;
  servo = i;
  protocol = spoken_by(i);
  // All of a report takes long: one servo at a time, and none in cycles with another request.
  return send(protocol->ask(servo_line_request(), i + 1, cycles % REMIND_CYCLES == 2 * i + 1));
}

// Tells one servo whether to hold, or looks for one that is missing.
static bool tell_or_ping(void) {
  uint8_t *request = servo_line_request();
  for (servo = 0; servo < CT_SERVOS; servo++) {
    if (!(to_tell & table.servo_found & bit(servo))) continue;
    pinging = false;
    protocol = spoken_by(servo);
    return send(protocol->set_torque(request, servo + 1, servo_command.torque));
  }
  if (table.servo_found == ALL) return false;
  while (true) {
    probe = (probe + 1) % (2 * CT_SERVOS);
    servo = probe / 2;
    if (table.servo_found & bit(servo)) continue;
    pinging = true;
    protocol = probe % 2 ? &PROTOCOL_1 : &PROTOCOL_2;
    return send(protocol->ping(request, servo + 1));
  }
}

static bool begin(uint8_t now) {
  switch (now) {
    case GOALS_2:
      return send_goals(&PROTOCOL_2, table.servo_protocol);
    case GOALS_1:
      return send_goals(&PROTOCOL_1, ~table.servo_protocol);
    case EXTRA:
      return tell_or_ping();
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
  due = false;
  if (servo_command.torque != told_torque) to_tell = ALL;
  told_torque = servo_command.torque;
  if (++cycles % REMIND_CYCLES == 0) {
    reminded = (reminded + 1) % CT_SERVOS;
    to_tell |= bit(reminded);
  }
  step = GOALS_2;
  if (!begin(step)) next();
}

static void take_report(uint8_t i) {
  if (!protocol->report(&reports[i])) {
    table.servo_errors++;
    return;
  }
  gimbals_report(i, &reports[i]);
  age_ms[i] = 0;
  table.servo_alive |= bit(i);
}

static void found(uint8_t i) {
  table.servo_found |= bit(i);
  if (protocol == &PROTOCOL_2) {
    table.servo_protocol |= bit(i);
  } else {
    table.servo_protocol &= ~bit(i);
  }
  to_tell |= bit(i);
}

static void take_reply(reply_t reply) {
  if (reply == REPLY_NONE || reply == REPLY_BROKEN) {
    if (step != EXTRA || !pinging) table.servo_errors++;
    return;
  }
  if (reply == REPLY_FAULT) {
    table.servo_fault |= bit(servo);
  } else {
    table.servo_fault &= ~bit(servo);
  }
  if (step != EXTRA) {
    take_report(servo);
  } else if (pinging) {
    found(servo);
  } else {
    to_tell &= ~bit(servo);
  }
}

// Whether the request under way is over, with or without a reply.
static bool over(void) {
  if (!listening) {
    listening = true;
    listening_since = clock_half_us();
  }
  if (step < ASK) return true;  // Broadcasts are not answered.
  uint8_t byte = 0;
  while (servo_line_receive(&byte)) {
    reply_t reply = protocol->receive(byte, servo + 1);
    if (reply == REPLY_NONE) continue;
    take_reply(reply);
    return true;
  }
  if ((uint16_t)(clock_half_us() - listening_since) < TIMEOUT_HALF_US) return false;
  take_reply(REPLY_NONE);
  return true;
}

void servos_poll(void) {
  while (step < REST && !servo_line_sending() && over()) next();
  if (step >= REST && due) begin_cycle();
}

void servos_tick(void) {
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    if (age_ms[i] < 255) age_ms[i]++;
    if (age_ms[i] > ALIVE_MS) table.servo_alive &= ~bit(i);
    if (age_ms[i] == GONE_MS) table.servo_found &= ~bit(i);
  }
  if (++cycle_ms < SERVOS_CYCLE_MS) return;
  cycle_ms = 0;
  if (step < REST) table.overruns++;
  due = true;
}
