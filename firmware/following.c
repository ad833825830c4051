#include "following.h"

#include "control_table.h"
#include "servos.h"
#include "table.h"

#define FAR_STEPS 34
#define FAR_TURNS (300 / CT_SERVOS)
#define OFF_STEPS CT_DEFAULT(neutral_band)
#define OFF_TURNS (1000 / CT_SERVOS)

static uint8_t turn;
static uint8_t far_turns[CT_SERVOS], off_turns[CT_SERVOS];
static uint8_t stuck;

// Steps of error that the present speed will not eliminate within 0.3 s.
static int32_t error(uint8_t i) {
  int32_t off = (int32_t)servo_command.goal[i] - table.position[i];
  int32_t toward = off < 0 ? -table.velocity[i] : table.velocity[i];
  return (off < 0 ? -off : off) - (toward > 0 ? 3 * toward / 10 : 0);
}

static bool lasts(bool now, uint8_t *turns, uint8_t most) {
  if (!now) {
    *turns = 0;
  } else if (*turns < most) {
    (*turns)++;
  } else {
    // The maximum is reached.
  }
  return *turns == most;
}

void following_tick(bool driven) {
  if (++turn >= CT_SERVOS) turn = 0;
  bool counts = driven && table.servos_expected & 1 << turn;
  int32_t steps = counts ? error(turn) : 0;
  bool far = lasts(steps > FAR_STEPS, &far_turns[turn], FAR_TURNS);
  bool off = lasts(steps > OFF_STEPS, &off_turns[turn], OFF_TURNS);
  stuck &= ~(1 << turn);
  if (far || off) stuck |= 1 << turn;
}

uint8_t following_stuck(void) { return stuck; }
