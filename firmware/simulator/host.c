/* The line to the PC, and requests that must be answered.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include "board.h"

#include <stddef.h>

static avr_cycle_count_t feed_host(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  uart_t *uart = &board->uart[0];
  if (board->host_arriving) uart_end(uart, board->host_byte, 0);
  board->host_arriving = queue_take(&board->to_board, &board->host_byte);
  if (!board->host_arriving) return 0;
  uart_begin(uart);
  return when + byte_cycles(uart);
}

static void on_host_byte(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  uint8_t byte = value;
  queue_put(&board->to_host, &byte, 1);
  if (!board->awaited) return;
  uint16_t start = board->to_host.head - board->awaited_length;
  for (uint32_t i = 0; i < board->awaited_length; i++) {
    if (board->to_host.bytes[(uint16_t)(start + i)] != board->awaited[i]) return;
  }
  board->answered = true;
}

void host_open(board_t *board) {
  avr_irq_register_notify(uart_irq(board, '0', UART_IRQ_OUTPUT), on_host_byte, board);
}

void host_reset(board_t *board) {
  board->to_board.tail = board->to_board.head;
  board->host_arriving = false;
}

void board_send(board_t *board, const uint8_t *bytes, uint32_t count) {
  if (board->off) return;
  queue_put(&board->to_board, bytes, count);
  if (!avr_cycle_timer_status(board->avr, feed_host, board)) {
    avr_cycle_timer_register(board->avr, 1, feed_host, board);
  }
}

uint32_t board_receive(board_t *board, uint8_t *bytes, uint32_t room) {
  uint32_t count = 0;
  while (count < room && queue_take(&board->to_host, bytes + count)) count++;
  return count;
}

/* Sends each of `count` cases and `ping`, and waits for `answer`; returns the index of the first
   that was not answered in time, or `count`. */
uint32_t board_ask(board_t *board, const uint8_t *cases, const uint32_t *lengths, uint32_t count,
                   const uint8_t *ping, uint32_t ping_length, const uint8_t *answer,
                   uint32_t answer_length, uint32_t patience_us) {
  uint32_t done = 0;
  board->awaited = answer;
  board->awaited_length = answer_length;
  for (; done < count; done++) {
    board->to_host.tail = board->to_host.head;
    board_send(board, cases, lengths[done]);
    board_send(board, ping, ping_length);
    cases += lengths[done];
    if (!board_run(board, board->avr->cycle + US(patience_us)) || !board->answered) break;
  }
  board->awaited = NULL;
  board->to_host.tail = board->to_host.head;
  return done;
}
