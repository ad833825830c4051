/* SBUS receiver on the third UART.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include "../native/radio.h"

#include "board.h"

static avr_cycle_count_t feed_radio(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  uart_t *uart = &board->uart[2];
  if (board->radio_arriving) uart_end(uart, board->radio_byte, board->radio_errors);
  board->radio_arriving = queue_take(&board->to_radio, &board->radio_byte);
  if (!board->radio_arriving) return 0;
  uart_begin(uart);
  return when + byte_cycles(uart);
}

/* Sends bytes with error flags of UCSRnA. */
void board_radio(board_t *board, const uint8_t *bytes, uint32_t count, uint8_t errors) {
  if (board->off) return;
  board->radio_errors = errors;
  queue_put(&board->to_radio, bytes, count);
  if (!avr_cycle_timer_status(board->avr, feed_radio, board)) {
    avr_cycle_timer_register(board->avr, 1, feed_radio, board);
  }
}

static avr_cycle_count_t send_frame(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  uint8_t frame[RADIO_FRAME];
  if (board->sbus && board->rc_us[0]) {
    radio_frame(frame, board->rc_us, RC_CHANNELS, board->sbus_flags);
    board_radio(board, frame, sizeof frame, 0);
  }
  return when + US(RADIO_PERIOD_US);
}

void radio_reset(board_t *board) {
  board->to_radio.tail = board->to_radio.head;
  board->radio_arriving = false;
  avr_cycle_timer_register(board->avr, US(RADIO_PERIOD_US), send_frame, board);
}

/* Sends the channels as frames with `flags` instead of pulses. */
void board_sbus(board_t *board, bool on, uint8_t flags) {
  board->sbus = on;
  board->sbus_flags = flags;
}
