#include "wheel_following.h"

#include "robot.h"
#include "table.h"
#include "wheel_speed.h"

#define TURN_MS 4
#define LAG_TURNS (ROBOT_WHEEL_LAG_MS / (TURN_MS * CT_ESCS))
#define OFF_TURNS (300 / (TURN_MS * CT_ESCS))

typedef struct {
  uint16_t least, most;
} range_t;

// Setpoints of the current interval of ROBOT_WHEEL_LAG_MS and of the previous one, because a wheel follows
// later. [rpm]
static struct {
  range_t now, before;
  uint16_t turns, throttle, rpm;
  uint8_t off_turns;
  bool counted;
} wheels[CT_ESCS];
static uint8_t turn;

// Speed at the present throttle, from the curve of the motor.
static uint16_t wanted_rpm(uint8_t i) {
  uint16_t throttle = table.throttle_out[i];
  if (throttle == wheels[i].throttle) return wheels[i].rpm;  // A division takes 40 us.
  uint8_t k = 1;
  while (k < ROBOT_CURVE_POINTS - 1 && throttle > ROBOT_CURVE_THROTTLE[k]) k++;
  uint16_t from = ROBOT_CURVE_THROTTLE[k - 1], low = ROBOT_CURVE_RPM[i][k - 1];
  uint32_t rise = ROBOT_CURVE_RPM[i][k] - low, part = throttle > from ? throttle - from : 0;
  wheels[i].throttle = throttle;
  wheels[i].rpm = low + part * rise / (ROBOT_CURVE_THROTTLE[k] - from);
  return wheels[i].rpm;
}

static void extend(range_t *range, uint16_t rpm) {
  if (rpm < range->least) range->least = rpm;
  if (rpm > range->most) range->most = rpm;
}

static bool deviates(uint8_t i) {
  uint16_t rpm = table.wheel_rpm[i];
  range_t range = wheels[i].before;
  extend(&range, wheels[i].now.least);
  extend(&range, wheels[i].now.most);
  uint16_t nearest = rpm < range.least ? range.least : rpm > range.most ? range.most : rpm;
  uint16_t off = rpm < nearest ? nearest - rpm : rpm - nearest;
  return off > ROBOT_WHEEL_LEAST_RPM && off > nearest / 4;
}

// Updates the recent setpoints; `begins` when the wheel may still turn as before.
static void remember(uint8_t i, bool begins) {
  uint16_t rpm = wanted_rpm(i);
  // Below its starting speed a motor may stand.
  range_t wanted = {rpm < ROBOT_WHEEL_START_RPM ? 0 : rpm, rpm};
  if (++wheels[i].turns >= LAG_TURNS || begins) {
    wheels[i].turns = 0;
    wheels[i].before = wheels[i].now;
    wheels[i].now = wanted;
  }
  extend(&wheels[i].now, wanted.least);
  extend(&wheels[i].now, wanted.most);
  if (!begins) return;
  extend(&wheels[i].now, table.wheel_rpm[i]);
  wheels[i].before = wheels[i].now;
}

void wheel_following_tick(bool driven) {
  if (++turn >= TURN_MS * CT_ESCS) turn = 0;
  if (turn % TURN_MS) return;
  uint8_t i = turn / TURN_MS;
  bool counts = driven && wheel_speed_expected() & 1 << i;
  if (counts) remember(i, !wheels[i].counted);
  wheels[i].counted = counts;
  if (!counts || !deviates(i)) {
    wheels[i].off_turns = 0;
  } else if (wheels[i].off_turns < OFF_TURNS) {
    wheels[i].off_turns++;
  } else {
    // The maximum is reached.
  }
}

static uint8_t stuck_wheel(void) {
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    if (wheels[i].off_turns == OFF_TURNS) return i + 1;
  }
  return 0;
}

bool wheel_following_stuck(void) { return stuck_wheel() != 0; }

void wheel_following_report(bool stuck) {
  uint8_t number = stuck ? stuck_wheel() : 0;
  table.wheel_stuck = number;
  table.stuck_rpm = number ? table.wheel_rpm[number - 1] : 0;
  table.stuck_wanted_rpm = number ? wheels[number - 1].rpm : 0;
}
