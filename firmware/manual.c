#include "manual.h"

#include <math.h>
#include <string.h>

#include "kinematics.h"
#include "receiver.h"
#include "robot.h"
#include "table.h"

#define PERIOD_MS 20
#define CENTRE_US 1500
#define DEAD_US 20
#define TRAVEL_US 400  // From the centre to the end.
#define SPEED_LOW_US 1100
#define SPEED_TRAVEL_US 780  // Less than the stick has: its end is the end.

uint16_t manual_throttle[CT_ESCS];
int16_t manual_goal[CT_SERVOS];

static twist_t twist;
static uint8_t phase;

// Stick from -1 to 1, with a dead zone at the centre.
static float stick(channel_t channel) {
  int16_t off = table.rc[channel] - CENTRE_US;
  if (off > -DEAD_US && off < DEAD_US) return 0.0f;
  return fmin(1.0f, fmax(-1.0f, (off < 0 ? off + DEAD_US : off - DEAD_US) /
                                    (float)(TRAVEL_US - DEAD_US)));
}

static uint16_t speed_us(void) {
  uint16_t us = table.rc[RC_SPEED];
  if (us <= SPEED_LOW_US) return 0;
  us -= SPEED_LOW_US;
  return us < SPEED_TRAVEL_US ? us : SPEED_TRAVEL_US;
}

bool manual_speed_is_zero(void) { return speed_us() == 0; }

static twist_t wanted(void) {
  twist_t goal = {stick(RC_FORWARD), stick(RC_LEFT), stick(RC_TURN)};
  float over = fmax(1.0f, hypot(goal.vx, goal.vy));
  goal.vx *= ROBOT_SPEED_MPS / over;
  goal.vy *= ROBOT_SPEED_MPS / over;
  goal.omega *= ROBOT_TURN_RATE;
  return kinematics_limit(goal);
}

// Approaches `goal` within the limits of acceleration, all parts alike.
static void approach(twist_t goal) {
  float dx = goal.vx - twist.vx, dy = goal.vy - twist.vy, dw = goal.omega - twist.omega;
  float over = fmax(1.0f, fmax(hypot(dx, dy) / (ROBOT_ACCELERATION * PERIOD_MS / 1000),
                               fabs(dw) / (ROBOT_ANGULAR_ACCELERATION * PERIOD_MS / 1000)));
  twist = (twist_t){twist.vx + dx / over, twist.vy + dy / over, twist.omega + dw / over};
}

void manual_begin(void) {
  twist = (twist_t){0.0f, 0.0f, 0.0f};
  memset(manual_goal, 0, sizeof manual_goal);
  for (uint8_t i = 0; i < CT_ESCS; i++) manual_throttle[i] = CT_ZERO_THROTTLE;
  phase = 0;
}

void manual_tick(void) {
  // One module each millisecond: arc sines take a while, and the lines do not wait.
  static int16_t goals[CT_SERVOS];
  if (phase == 0) {
    approach(wanted());
  } else if (phase <= ROBOT_MODULES) {
    kinematics_module(twist, phase - 1, goals + 2 * (phase - 1));
    if (phase == ROBOT_MODULES) memcpy(manual_goal, goals, sizeof goals);
  }
  if (++phase == PERIOD_MS) phase = 0;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    uint32_t span = ROBOT_CRUISE_THROTTLE[i] - CT_ZERO_THROTTLE;
    manual_throttle[i] = CT_ZERO_THROTTLE + span * speed_us() / SPEED_TRAVEL_US;
  }
}
