#include "pulses.h"

#include <stdbool.h>

#include "clock.h"
#include "hal.h"

#define WIRES 6
#define SHORTEST_US 800
#define LONGEST_US 2200
#define EDGES 32  // A frame has twelve, even with noise on the wires; one entry remains free.

// The interrupt only records edges; they are measured later, because bytes from both lines are
// waiting, and six pulses may end simultaneously.
static struct {
  uint16_t half_us;
  uint8_t pins;
} edges[EDGES];
static volatile uint8_t head, tail;
static volatile bool full;

static uint8_t high, known;  // Bit i: level of wire i after its last edge, at `since[i]`.
static uint16_t since[WIRES];

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

static void measure(uint8_t pins, uint16_t half_us, heard_t hear) {
  uint8_t changed = pins ^ high;
  high = pins;
  for (uint8_t i = 0, mask = 1; changed; i++, mask <<= 1, changed >>= 1) {
    if (!(changed & 1)) continue;
    uint16_t us = (uint16_t)(half_us - since[i]) / 2;
    if (!(pins & mask) && (known & mask) && us >= SHORTEST_US && us <= LONGEST_US) hear(i, us);
    since[i] = half_us;
    known |= mask;
  }
}

// The timer wraps, so forget edges of wires that were high for too long to be a pulse.
void pulses_forget(void) {
  uint16_t now = clock_half_us();
  for (uint8_t i = 0; i < WIRES; i++) {
    if ((uint16_t)(now - since[i]) / 2 > 2 * LONGEST_US) known &= ~(1 << i);
  }
}

void pulses_tick(heard_t hear) {
  if (full) {
    // Empty the queue first; the interrupt sets `full` again if there is no room.
    tail = head;
    full = false;
    // The start times of pulses in progress are unknown.
    high = hal_receiver_pins();
    known = 0;
  }
  while (tail != head) {
    uint8_t at = tail;
    measure(edges[at].pins, edges[at].half_us, hear);
    tail = (at + 1) % EDGES;
  }
}
