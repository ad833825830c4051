// Firmware of the triple singularity drive for the Arduino Mega (ATmega2560).
#include "main.h"

#include "clock.h"
#include "crc16.h"
#include "gimbals.h"
#include "hal.h"
#include "host.h"
#include "nonce.h"
#include "power.h"
#include "receiver.h"
#include "safety.h"
#include "servos.h"
#include "setup.h"
#include "table.h"
#include "trip_history.h"
#include "watchdog.h"
#include "wheel_speed.h"

enum { BEGIN, SENSE, DECIDE, FOLLOW, PUT_OUT, SERVOS, DONE };
static uint8_t stage = DONE;

// One stage of a tick; between stages, the lines are served.
static void run_stage(void) {
  switch (stage) {
    case BEGIN:
      table.millis++;
      receiver_tick();
      host_tick();
      break;
    case SENSE:
      power_tick();
      setup_tick();
      trip_history_tick();
      wheel_speed_tick();
      break;
    case DECIDE:
      safety_tick();
      break;
    case FOLLOW:
      safety_follow();
      break;
    case PUT_OUT:
      safety_put_out();
      break;
    default:
      servos_tick();  // A cycle of the servos begins with the goals of this tick.
      break;
  }
  stage++;
}

void main_start(void) {
  crc16_start();
  table_start();
  watchdog_remember();
  setup_start();
  trip_history_start();
  gimbals_start();
  nonce_start();
  safety_start();
  receiver_start();
  power_start();
  servos_start();
  host_start();
  clock_start();
  hal_interrupts_start();
}

void main_turn(void) {
  bool more = host_poll();
  servos_poll();
  do {  // Ticks that are late are not interrupted.
    if (stage == DONE && clock_tick()) stage = BEGIN;
    if (stage != DONE) run_stage();
  } while (clock_waiting());
  if (stage == DONE && !more) hal_sleep();
}

#ifdef __AVR__
int main(void) {
  main_start();
  while (true) main_turn();
}
#endif
