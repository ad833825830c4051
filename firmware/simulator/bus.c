/* The servo bus: one wire with a direction pin.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include "avr_ioport.h"
#include "board.h"

/* Servos receive the bytes sent while the direction pin is high; its falling edge ends the request. */
static avr_cycle_count_t feed_bus(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  uart_t *uart = &board->uart[1];
  if (board->arriving) {
    if (board->sending) {
      board->collisions++;
    } else if (board->heard) {
      uart_end(uart, board->byte, 0);
    } else {
      board->deaf++;
    }
  }
  board->arriving = queue_take(&board->to_bus, &board->byte);
  if (!board->arriving) return 0;
  /* A byte is lost if its start bit arrives before the receiver is on. */
  board->heard = uart_listens(uart);
  if (board->heard) uart_begin(uart);
  return when + byte_cycles(uart);
}

static void on_bus_byte(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  if (!board->sending) {
    board->strays++;
    return;
  }
  if (board->request_length < LONGEST_REQUEST) board->request[board->request_length++] = value;
}

/* A byte was sent. */
static void on_sent(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  if (value) board->bus_sent = board->avr->cycle;
}

static void on_direction(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  bool sending = value & 1;
  if (sending == board->sending) return;
  board->sending = sending;
  if (sending) {
    board->request_length = 0;
    return;
  }
  if (board->uart[1].chip->tx_cnt) {
    board->cuts++;
    return;
  }
  uint32_t took = board->avr->cycle - board->bus_sent;
  if (board->request_length && took > board->turn_around) board->turn_around = took;
  if (board->on_request && board->request_length) {
    board->on_request(board->request, board->request_length);
  }
}

void bus_open(board_t *board) {
  avr_irq_t *direction = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('A'), 0);
  avr_irq_register_notify(uart_irq(board, '1', UART_IRQ_OUTPUT), on_bus_byte, board);
  avr_irq_register_notify(direction, on_direction, board);
  avr_irq_register_notify(&board->uart[1].chip->txc.irq[AVR_INT_IRQ_PENDING], on_sent, board);
}

void bus_reset(board_t *board) {
  board->sending = false;
  board->request_length = 0;
  board->to_bus.tail = board->to_bus.head;
  board->arriving = false;
}

void board_on_request(board_t *board, void (*call)(const uint8_t *, uint32_t)) {
  board->on_request = call;
}

/* Sends a servo response, `delay_us` after the last stop bit of the request. It is lost if it starts while
   the board still drives the bus. */
void board_reply(board_t *board, const uint8_t *bytes, uint32_t count, uint32_t delay_us) {
  avr_cycle_count_t now = board->avr->cycle, begins = board->bus_sent + US(delay_us);
  queue_put(&board->to_bus, bytes, count);
  if (avr_cycle_timer_status(board->avr, feed_bus, board)) return;
  if (begins <= now) {
    board->arriving = queue_take(&board->to_bus, &board->byte);
    board->heard = false;
    begins += byte_cycles(&board->uart[1]);
  }
  avr_cycle_timer_register(board->avr, begins > now ? begins - now : 1, feed_bus, board);
}

/* Maximum time from the last stop bit of a request until the bus was released, in cycles. */
uint32_t board_turn_around(board_t *board) { return board->turn_around; }

/* Fault counts of the bus: bytes sent while listening, requests cut by the pin, collisions with
   replies, bytes received before the board listened. */
void board_bus_faults(board_t *board, uint32_t *counts) {
  counts[0] = board->strays;
  counts[1] = board->cuts;
  counts[2] = board->collisions;
  counts[3] = board->deaf;
}

