/* The servo bus: one wire, with a pin that says who speaks.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <stdlib.h>
#include <string.h>

#include "avr_ioport.h"
#include "board.h"

/* The servo bus: one wire, so the board hears itself; servos see what is sent while the direction
   pin is high, and take its fall for the end of the request. */
static avr_cycle_count_t feed_bus(avr_t *avr, avr_cycle_count_t when, void *param) {
  board_t *board = param;
  if (board->arriving) {
    board->arriving = false;
    if (board->sending) {
      board->collisions++;
    } else if (board->heard) {
      avr_raise_irq(uart(board, '1', UART_IRQ_INPUT), board->byte);
    } else {
      board->deaf++;
    }
  }
  if (!queue_take(&board->to_bus, &board->byte)) return 0;
  /* A byte whose start bit comes before the receiver is on is lost. */
  board->heard = avr->data[UCSR1B] & RXEN1;
  board->arriving = true;
  return when + byte_cycles(avr, UBRR1);
}

static void on_bus_byte(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq;
  board_t *board = param;
  if (!board->sending) {
    board->strays++;
    return;
  }
  if (board->request_length < LONGEST_REQUEST) board->request[board->request_length++] = value;
  avr_raise_irq(uart(board, '1', UART_IRQ_INPUT), value);
}

static const avr_uart_t *bus_uart(const avr_t *avr) {
  for (const avr_io_t *io = avr->io_port; io; io = io->next) {
    const avr_uart_t *found = (const avr_uart_t *)io;
    if (!strcmp(io->kind, "uart") && found->name == '1') return found;
  }
  abort();
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
  if (bus_uart(board->avr)->tx_cnt) {
    board->cuts++;
    return;
  }
  if (board->on_request && board->request_length) {
    board->on_request(board->request, board->request_length);
  }
}

void bus_open(board_t *board) {
  avr_irq_t *direction = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('A'), 0);
  avr_irq_register_notify(uart(board, '1', UART_IRQ_OUTPUT), on_bus_byte, board);
  avr_irq_register_notify(direction, on_direction, board);
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

/* What servos answer, `delay_us` after the end of the request. */
void board_reply(board_t *board, const uint8_t *bytes, uint32_t count, uint32_t delay_us) {
  queue_put(&board->to_bus, bytes, count);
  if (!avr_cycle_timer_status(board->avr, feed_bus, board)) {
    avr_cycle_timer_register(board->avr, US(delay_us) + 1, feed_bus, board);
  }
}

/* Counts of what must not happen on the bus: bytes sent while the pin says listen, requests that
   the pin cut short, replies that the board talked over, bytes that came before it listened. */
void board_bus_faults(board_t *board, uint32_t *counts) {
  counts[0] = board->strays;
  counts[1] = board->cuts;
  counts[2] = board->collisions;
  counts[3] = board->deaf;
}

