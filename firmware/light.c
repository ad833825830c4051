// On while the robot is armed; under radio control it goes out for 0.2 s every 1.7 s. Off while it is disarmed, except
// after a trip: then it blinks the code, with a long blink for each five and a short one for each of the rest.
#include "light.h"

#include "hal.h"
#include "table.h"

#define LONG_MS 800
#define SHORT_MS 200
#define GAP_MS 300
#define PAUSE_MS 1500
#define FIVE 5

static uint8_t mode, code;      // As shown.
static uint8_t longs, shorts;  // Blinks that follow.
static bool blinks;
static uint16_t left_ms;

static void begin_next(void) {
  blinks = !blinks && (longs != 0 || shorts != 0);
  if (blinks && longs != 0) {
    longs--;
    left_ms = LONG_MS;
  } else if (blinks) {
    shorts--;
    left_ms = SHORT_MS;
  } else if (longs != 0 || shorts != 0) {
    left_ms = GAP_MS;
  } else {
    longs = code / FIVE;
    shorts = code % FIVE;
    left_ms = PAUSE_MS;
  }
}

void light_tick(void) {
  uint8_t now = table.mode == BOARD_DISARMED ? table.trip : table.mode == BOARD_RC ? 1 : 0;
  if (mode != table.mode || code != now) {
    mode = table.mode;
    code = now;
    longs = 0;
    shorts = 0;
    blinks = true;
    left_ms = 0;
  }
  if (left_ms == 0) begin_next();
  left_ms--;
  hal_light((mode != BOARD_DISARMED) != blinks);
}
