#include "wheel_speed.h"

#include <stdbool.h>

#include "clock.h"
#include "hal.h"
#include "table.h"
#include "wheel_telemetry.h"

#define MS 32             // Time is counted in half us / 64, about 1/32 ms.
#define HZ (2000000UL / 64)
#define ROOM 16           // Looks with edges that wait for the main loop: 7 ms.
#define WINDOW (50 * MS)  // Shortest time that a speed is averaged over.
#define OVERDUE (20 * MS)
#define REST (200 * MS)   // Without a pulse for this time, a wheel is at rest.
#define TURN_MS 4         // A wheel's speed is calculated in turn, every 12 ms.
#define KEPT 5            // Intervals, whose median is not changed by a lost or an additional pulse.

static const uint8_t BITS[] = HAL_WHEELS;
static struct {
  uint16_t half_us;
  uint8_t wheels;
} looks[ROOM];
static volatile uint8_t head, tail;
static volatile bool full;
static uint8_t turn;
static volatile uint8_t kind;  // WHEEL_SENSOR_*: the sensors in use.
static uint16_t now, now_half_us;  // The same time.

typedef struct {
  bool moves;
  uint8_t kept, next;
  uint16_t last;  // Time of the last pulse.
  uint16_t intervals[KEPT], before, usual;
  uint16_t elapsed, pulses;  // Since the last result.
} wheel_t;
static wheel_t wheels[CT_ESCS];

HAL_INTERRUPT(wheels) {
  uint16_t half_us = hal_wheels_next();
  if (HAL_TELEMETRY && kind == WHEEL_SENSOR_TELEMETRY) {
    wheel_telemetry_take();
    return;
  }
  uint8_t pulsed = hal_wheels_take(), at = head, next = (at + 1) % ROOM;
  if (!pulsed) return;
  if (next == tail) {
    full = true;
    return;
  }
  looks[at].half_us = half_us;
  looks[at].wheels = pulsed;
  head = next;
}

static void advance_to(uint16_t half_us) {
  int16_t passed = half_us - now_half_us;
  if (passed < 0) return;  // A look that came after the clock was read.
  now += (uint16_t)passed / 64;
  now_half_us += passed & ~63;
}

// Pulses in an interval: none or two if one was additional or lost. The previous interval
// distinguishes a wheel that becomes slower from a lost pulse.
static uint8_t pulses_in(uint16_t interval, uint16_t before, uint16_t usual) {
  uint16_t longest = before > usual ? before : usual;
  if (2 * interval <= usual) return 0;
  return usual && 4 * interval > 7 * longest ? 2 : 1;
}

static void hear(wheel_t *wheel) {
  uint16_t interval = now - wheel->last;
  wheel->last = now;
  if (!wheel->moves) {
    wheel->moves = true;
    return;
  }
  wheel->intervals[wheel->next] = interval;
  if (++wheel->next == KEPT) wheel->next = 0;
  if (wheel->kept < KEPT) wheel->kept++;
  wheel->elapsed += interval;
  wheel->pulses += pulses_in(interval, wheel->before, wheel->usual);
  wheel->before = interval;
}

static uint16_t median(const wheel_t *wheel) {
  uint16_t sorted[KEPT];
  uint8_t count = wheel->kept;
  for (uint8_t k = 0; k < count; k++) {
    uint16_t interval = wheel->intervals[k];
    uint8_t at = k;
    for (; at && sorted[at - 1] > interval; at--) sorted[at] = sorted[at - 1];
    sorted[at] = interval;
  }
  return count ? sorted[count / 2] : 0;
}

static uint16_t rpm_of(uint16_t pulses, uint16_t elapsed) {
  uint32_t rpm = 60 * HZ * pulses / ((uint32_t)elapsed * table.wheel_pulses);
  return rpm > UINT16_MAX ? UINT16_MAX : rpm;
}

static void rest(uint8_t i) {
  wheels[i] = (wheel_t){.moves = false};
  table.wheel_rpm[i] = 0;
  table.wheel_age[i] = UINT8_MAX;
}

static void conclude(uint8_t i) {
  wheel_t *wheel = &wheels[i];
  uint16_t since = now - wheel->last;
  if (!wheel->moves) return;
  if (since >= REST) {
    rest(i);
    return;
  }
  table.wheel_age[i] = since / MS;
  wheel->usual = median(wheel);
  if (wheel->elapsed >= WINDOW && wheel->pulses) {
    table.wheel_rpm[i] = rpm_of(wheel->pulses, wheel->elapsed);
    wheel->elapsed = wheel->pulses = 0;
    if (wheel->kept == KEPT) table.wheel_measured |= 1 << i;
  } else if (since >= OVERDUE && since / 3 > wheel->usual) {
    // Several pulses are overdue, so the wheel has become slower.
    uint16_t most = rpm_of(1, since);
    if (table.wheel_rpm[i] > most) table.wheel_rpm[i] = most;
  } else {
    // The last result applies.
  }
}

// Looks are missing because the main loop was late: measure again from here.
static void skip(void) {
  tail = head;
  full = false;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    wheels[i].last = now;
    wheels[i].elapsed = wheels[i].pulses = 0;
  }
}

static void hear_look(uint8_t at) {
  advance_to(looks[at].half_us);
  uint8_t pulsed = looks[at].wheels;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    if (pulsed & BITS[i]) hear(&wheels[i]);
  }
}

static void change(uint8_t wanted) {
  if (HAL_TELEMETRY && kind == WHEEL_SENSOR_TELEMETRY) hal_telemetry_stop();
  if (kind == WHEEL_SENSOR_HALL) hal_wheels_stop();
  table.wheel_measured = 0;
  for (uint8_t i = 0; i < CT_ESCS; i++) rest(i);
  kind = wanted;
  if (kind == WHEEL_SENSOR_HALL) hal_wheels_start();
  if (HAL_TELEMETRY && kind == WHEEL_SENSOR_TELEMETRY) {
    wheel_telemetry_start();
    hal_telemetry_start();
  }
}

static void count_pulses(void) {
  uint16_t half_us = clock_half_us();
  if (full) skip();
  for (uint8_t at = tail; at != head; at = (at + 1) % ROOM) {
    hear_look(at);
    tail = (at + 1) % ROOM;
  }
  advance_to(half_us);
  if (++turn >= CT_ESCS * TURN_MS) turn = 0;
  if (turn % TURN_MS == 0) conclude(turn / TURN_MS);
}

void wheel_speed_tick(void) {
  if (table.wheel_sensor != kind) change(table.wheel_sensor);
  if (kind == WHEEL_SENSOR_HALL) count_pulses();
  if (HAL_TELEMETRY && kind == WHEEL_SENSOR_TELEMETRY) wheel_telemetry_tick();
}

uint8_t wheel_speed_expected(void) {
  bool sent = HAL_TELEMETRY && kind == WHEEL_SENSOR_TELEMETRY;
  return sent ? wheel_telemetry_heard() : table.wheel_measured;
}
