/* The receiver of the radio control.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <string.h>

#include "avr_ioport.h"
#include "board.h"

static void set_rc_pin(board_t *board, bool high) {
  avr_t *avr = board->avr;
  avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('K'), board->rc_channel), high);
  if (avr->data[PCMSK2] & 1 << board->rc_channel) avr_raise_interrupt(avr, &board->rc_change);
}

/* Six pulses one after the other, as receivers make them. */
static avr_cycle_count_t step_receiver(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  if (board->rc_high) {
    set_rc_pin(board, false);
    board->rc_high = false;
    board->rc_channel++;
  }
  while (board->rc_channel < RC_CHANNELS && !board->rc_us[board->rc_channel]) board->rc_channel++;
  if (board->rc_channel == RC_CHANNELS) {
    board->rc_channel = 0;
    board->rc_frame += RC_FRAME;
    if (board->rc_frame <= when) board->rc_frame = when + RC_FRAME;
    return board->rc_frame;
  }
  set_rc_pin(board, true);
  board->rc_high = true;
  return when + US(board->rc_us[board->rc_channel]);
}

void receiver_open(board_t *board) {
  board->rc_change = (avr_int_vector_t){
      .vector = PCINT2_VECTOR,
      .enable = AVR_IO_REGBIT(PCICR, 2),
      .raised = AVR_IO_REGBIT(PCIFR, 2),
  };
  avr_register_vector(board->avr, &board->rc_change);
}

void receiver_reset(board_t *board) {
  board->rc_high = false;
  board->rc_channel = 0;
  avr_cycle_timer_register(board->avr, RC_FRAME, step_receiver, board);
}

void board_set_rc(board_t *board, const uint32_t *us) {
  memcpy(board->rc_us, us, sizeof board->rc_us);
}

