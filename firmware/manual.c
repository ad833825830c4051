#include "manual.h"

#include <math.h>
#include <string.h>

#include "kinematics.h"
#include "receiver.h"
#include "robot.h"
#include "table.h"

#define PERIOD_MS 20
uint16_t manual_throttle[CT_ESCS];
int16_t manual_goal[CT_SERVOS];

static twist_t twist;
static uint8_t phase;
static bool slow;  // Set by a hot servo; cleared only at a start, so that speed never rises in use.

static uint8_t hottest(void) {
  uint8_t most = 0;
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    if (table.temperature[i] > most) most = table.temperature[i];
  }
  return most;
}

// Fraction of `span`, 0 to 1, without the dead bands at both ends.
static float part(int16_t off, int16_t span) {
  int16_t dead = table.stick_dead;
  if (off <= dead || span <= 2 * dead) return 0.0f;
  return fmin(1.0f, (float)(off - dead) / (float)(span - 2 * dead));
}

// Stick position, -1 to 1.
static float stick(channel_t channel) {
  int16_t us = table.rc[channel], centre = table.stick_centre[channel];
  return us < centre ? -part(centre - us, centre - table.stick_low[channel])
                     : part(us - centre, table.stick_high[channel] - centre);
}

static float speed(void) {
  int16_t low = table.stick_low[RC_SPEED];
  return part(table.rc[RC_SPEED] - low, table.stick_high[RC_SPEED] - low);
}

bool manual_speed_is_zero(void) { return speed() <= 0.0f; }

static twist_t wanted(void) {
  twist_t goal = {stick(RC_FORWARD), stick(RC_LEFT), stick(RC_TURN)};
  float over = fmax(1.0f, hypot(goal.vx, goal.vy));
  float share = slow ? ROBOT_SLOW_SHARE : 1.0f;
  goal.vx *= share * ROBOT_SPEED_MPS / over;
  goal.vy *= share * ROBOT_SPEED_MPS / over;
  goal.omega *= share * ROBOT_TURN_RATE;
  return kinematics_limit(goal);
}

// Moves `twist` towards `goal` within the acceleration limits, scaling all components equally.
static void approach(twist_t goal) {
  float dx = goal.vx - twist.vx, dy = goal.vy - twist.vy, dw = goal.omega - twist.omega;
  float over = fmax(1.0f, fmax(hypot(dx, dy) / (ROBOT_ACCELERATION * PERIOD_MS / 1000),
                               fabs(dw) / (ROBOT_ANGULAR_ACCELERATION * PERIOD_MS / 1000)));
  twist = (twist_t){twist.vx + dx / over, twist.vy + dy / over, twist.omega + dw / over};
}

void manual_begin(void) {
  twist = (twist_t){0.0f, 0.0f, 0.0f};
  memset(manual_goal, 0, sizeof manual_goal);
  phase = 0;
  if (hottest() < ROBOT_WARM_C) slow = false;
}

void manual_tick(void) {
  // One module per millisecond, because arc sines are slow and the serial lines cannot wait.
  static int16_t goals[CT_SERVOS];
  if (phase == 0) {
    if (hottest() >= ROBOT_HOT_C) slow = true;
    approach(wanted());
  } else if (phase <= ROBOT_MODULES) {
    kinematics_module(twist, phase - 1, goals + 2 * (phase - 1));
    if (phase == ROBOT_MODULES) memcpy(manual_goal, goals, sizeof goals);
  }
  if (++phase == PERIOD_MS) phase = 0;
  float share = speed();
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    uint16_t span = ROBOT_CRUISE_THROTTLE[i] - CT_ZERO_THROTTLE;
    manual_throttle[i] = CT_ZERO_THROTTLE + (uint16_t)(share * span);
  }
}
