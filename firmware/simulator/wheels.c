/* The wheel sensors: a wire with pulses per wheel.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <string.h>

#include "board.h"

static const uint8_t FLAGS[] = {0x10, 0x20, 0x01}; /* In EIFR: INT4, INT5, INT0. */

static avr_cycle_count_t step_wheels(avr_t *avr, avr_cycle_count_t when, void *param) {
  board_t *board = param;
  avr_cycle_count_t next = 0;
  for (int i = 0; i < WHEELS; i++) {
    wheel_t *wheel = &board->wheel[i];
    if (!wheel->period) continue;
    if (wheel->due <= when) {
      wheel->due += wheel->period;
      avr->data[EIFR] |= FLAGS[i];
    }
    if (!next || wheel->due < next) next = wheel->due;
  }
  return next;
}

/* Writing 1 clears a flag. */
static void on_flags(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)param;
  avr->data[address] &= ~value;
}

/* Matches of the timer. Those of simavr are switched off, because it misses some when the timer wraps. */
static avr_cycle_count_t match(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)when;
  board_t *board = param;
  avr_raise_interrupt(avr, &board->look->interrupt);
  return 0;
}

static uint16_t word(const avr_t *avr, avr_io_addr_t low) {
  return avr->data[low] | avr->data[low + 1] << 8;
}

/* Both bytes of a new time are written. */
static void on_match(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  board_t *board = param;
  avr_io_addr_t count = AVR_DATA_TO_IO(TCNT5L);
  avr->data[address] = value;
  avr->io[count].r.c(avr, TCNT5L, avr->io[count].r.param);
  uint16_t left = word(avr, OCR5AL) - word(avr, TCNT5L);
  board->look->comp_cycles = 0;
  avr_cycle_timer_cancel(avr, match, param);
  avr_cycle_timer_register(avr, 8 * (left + 1), match, param);
}

void wheels_open(board_t *board) {
  for (avr_io_t *io = board->avr->io_port; io; io = io->next) {
    avr_timer_t *timer = (avr_timer_t *)io;
    if (!strcmp(io->kind, "timer") && timer->name == '5') {
      board->look = &timer->comp[AVR_TIMER_COMPA];
    }
  }
  avr_register_io_write(board->avr, EIFR, on_flags, board);
  avr_io_addr_t at = AVR_DATA_TO_IO(OCR5AL);
  board->avr->io[at].w.c = on_match; /* Replaces the handler of simavr. */
  board->avr->io[at].w.param = board;
}

void wheels_reset(board_t *board) {
  avr_t *avr = board->avr;
  avr_cycle_timer_cancel(avr, step_wheels, board);
  avr_cycle_count_t next = step_wheels(avr, 0, board);
  if (next) avr_cycle_timer_register(avr, next > avr->cycle ? next - avr->cycle : 1, step_wheels, board);
}

/* Sends a pulse per `period` cycles, or none if it is 0. */
void board_set_wheel(board_t *board, uint32_t index, uint32_t period) {
  wheel_t *wheel = &board->wheel[index];
  avr_cycle_count_t now = board->avr->cycle;
  if (!wheel->period) {
    wheel->due = now + period;
  } else if (wheel->due > now) {
    wheel->due = now + (wheel->due - now) * period / wheel->period;
  }
  wheel->period = period;
  wheels_reset(board);
}
