/* The receiver of the radio control.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <string.h>

#include "avr_ioport.h"
#include "board.h"

#define NEVER UINT64_MAX

/* Plans the edges of a frame's pulses: one after another, or simultaneous. */
static void plan(board_t *board) {
  avr_cycle_count_t rise = board->rc_frame;
  for (int i = 0; i < RC_CHANNELS; i++) {
    avr_cycle_count_t width = board->sbus ? 0 : US(board->rc_us[i]);
    board->rc_rise[i] = width ? rise : NEVER;
    board->rc_fall[i] = width ? rise + width : NEVER;
    if (!board->rc_parallel) rise += width;
  }
}

/* Simultaneous edges raise one interrupt. */
static avr_cycle_count_t step_receiver(avr_t *avr, avr_cycle_count_t when, void *param) {
  board_t *board = param;
  avr_cycle_count_t next = NEVER;
  uint8_t changed = 0;
  if (when >= board->rc_frame) {
    board->rc_frame = when;
    plan(board);
    board->rc_frame += RC_FRAME;
  }
  for (int i = 0; i < RC_CHANNELS; i++) {
    bool falls = board->rc_rise[i] == NEVER;
    avr_cycle_count_t *due = falls ? &board->rc_fall[i] : &board->rc_rise[i];
    if (*due <= when) {
      *due = NEVER;
      changed |= 1 << i;
      avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('K'), i), !falls);
      due = &board->rc_fall[i];
    }
    if (*due < next) next = *due;
  }
  if (avr->data[PCMSK2] & changed) avr_raise_interrupt(avr, &board->rc_change);
  return next < board->rc_frame ? next : board->rc_frame;
}

void receiver_open(board_t *board) {
  board->rc_change = (avr_int_vector_t){
      .vector = PCINT2_VECTOR,
      .enable = AVR_IO_REGBIT(PCICR, 2),
      .raised = AVR_IO_REGBIT(PCIFR, 2),
  };
  avr_register_vector(board->avr, &board->rc_change);
}

static void begin(board_t *board, avr_cycle_count_t after) {
  for (int i = 0; i < RC_CHANNELS; i++) board->rc_rise[i] = board->rc_fall[i] = NEVER;
  board->rc_frame = board->avr->cycle + after;
  avr_cycle_timer_register(board->avr, after, step_receiver, board);
}

void receiver_reset(board_t *board) { begin(board, RC_FRAME); }

void board_set_rc(board_t *board, const uint32_t *us) {
  memcpy(board->rc_us, us, sizeof board->rc_us);
}

/* Starts all pulses simultaneously, first after `cycles`. */
void board_parallel_rc(board_t *board, uint32_t cycles) {
  board->rc_parallel = true;
  begin(board, cycles);
}
