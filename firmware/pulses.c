#include "pulses.h"

#include <stdbool.h>

#include "hal.h"

#define WIRES 6
#define SHORTEST_US 800
#define LONGEST_US 2200
#define EDGES 32  // A frame has twelve, also a receiver with noise on its wires; one stays free.

// Edges are noted at once, and measured later: bytes of both lines wait meanwhile, and six pulses may
// end in one moment.
static struct {
  uint16_t half_us;
  uint8_t pins;
} edges[EDGES];
static volatile uint8_t head, tail;
static volatile bool full;

static uint8_t high, known;  // Bit i: wire i was high at the last edge; since `rise[i]`.
static uint16_t rise[WIRES];

HAL_INTERRUPT(receiver) {
  uint8_t at = head;
  edges[at].half_us = hal_half_us();
  edges[at].pins = hal_receiver_pins();
  uint8_t next = (at + 1) % EDGES;
  if (next == tail) {
    full = true;
  } else {
    head = next;
  }
}

static void measure(uint8_t pins, uint16_t half_us, uint16_t *us) {
  uint8_t changed = pins ^ high;
  high = pins;
  for (uint8_t i = 0; i < WIRES; i++) {
    uint8_t mask = 1 << i;
    if (!(changed & mask)) continue;
    if (pins & mask) {
      rise[i] = half_us;
      known |= mask;
    } else if (known & mask) {
      uint16_t width = (uint16_t)(half_us - rise[i]) / 2;
      if (width >= SHORTEST_US && width <= LONGEST_US) us[i] = width;
      known &= ~mask;
    }
  }
}

// The timer wraps: a wire that was high for long must not look like a pulse later.
static void forget_long_ones(uint16_t now) {
  for (uint8_t i = 0; i < WIRES; i++) {
    if ((uint16_t)(now - rise[i]) / 2 > 2 * LONGEST_US) known &= ~(1 << i);
  }
}

void pulses_tick(uint16_t *us) {
  uint16_t now = 0;
  bool spoilt = false;
  HAL_ATOMIC {
    now = hal_half_us();
    spoilt = full;
    full = false;
    if (spoilt) tail = head;
  }
  if (spoilt) known = 0;
  while (tail != head) {
    uint8_t at = tail;
    measure(edges[at].pins, edges[at].half_us, us);
    tail = (at + 1) % EDGES;
  }
  forget_long_ones(now);
}
