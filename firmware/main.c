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
#include "watchdog.h"

static void tick(void) {
  table.millis++;
  receiver_tick();
  servos_tick();
  host_tick();
  power_tick();
  setup_tick();
  safety_tick();
}

void main_start(void) {
  crc16_start();
  table_start();
  watchdog_remember();
  setup_start();
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
  while (clock_tick()) tick();
  if (!more) hal_sleep();
}

#ifdef __AVR__
int main(void) {
  main_start();
  while (true) main_turn();
}
#endif
