/* Receive buffers and byte times of the chip's UARTs; simavr has room for 64 bytes, of 11 bits each.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <stdlib.h>
#include <string.h>

#include "board.h"

#define RXEN 0x10
#define OVERRUN 0x08

/* Bits per byte according to UCSRnC: start, eight data bits, parity, one or two stop bits. */
static uint32_t bits(const avr_t *avr, const avr_uart_t *chip) {
  uint8_t format = avr->data[chip->r_ucsrc];
  return 10 + (format & 0x20 ? 1 : 0) + (format & 0x08 ? 1 : 0);
}

avr_cycle_count_t byte_cycles(const uart_t *uart) {
  const avr_t *avr = uart->chip->io.avr;
  uint16_t ubrr = uart->chip->ubrrl.reg;
  uint32_t divisor = avr->data[ubrr] | (avr->data[ubrr + 1] & 0xf) << 8;
  return (divisor + 1) * 8 * bits(avr, uart->chip);
}

bool uart_listens(const uart_t *uart) {
  return uart->chip->io.avr->data[uart->chip->r_ucsrb] & RXEN;
}

/* Shows the flags of the oldest byte; its interrupt remains raised until the buffer is empty. */
static void show(uart_t *uart) {
  avr_t *avr = uart->chip->io.avr;
  uint8_t *status = &avr->data[uart->chip->r_ucsra];
  *status &= ~UART_ERRORS;
  if (uart->count) {
    *status |= uart->errors[0];
    avr_raise_interrupt(avr, &uart->chip->rxc);
  } else {
    avr_clear_interrupt(avr, &uart->chip->rxc);
    avr_regbit_clear(avr, uart->chip->rxc.raised);
  }
}

/* A start bit arrives. If two bytes are buffered and one is in the shift register, that one is lost. */
void uart_begin(uart_t *uart) {
  if (uart->count < UART_ROOM) return;
  uart->count--;
  uart->lost++;
  uart->chip->io.avr->data[uart->chip->r_ucsra] |= OVERRUN;
}

/* A byte is complete. */
void uart_end(uart_t *uart, uint8_t byte, uint8_t errors) {
  if (!uart_listens(uart) || uart->count == UART_ROOM) return;
  uart->bytes[uart->count] = byte;
  uart->errors[uart->count] = errors;
  uart->ended[uart->count++] = uart->chip->io.avr->cycle;
  show(uart);
}

static uint8_t read_byte(avr_t *avr, avr_io_addr_t address, void *param) {
  uart_t *uart = param;
  if (!uart->count) return avr->data[address];
  uint32_t waited = avr->cycle - uart->ended[0];
  if (waited > uart->longest_wait) uart->longest_wait = waited;
  avr->data[address] = uart->bytes[0];
  uart->count--;
  memmove(uart->bytes, uart->bytes + 1, uart->count);
  memmove(uart->errors, uart->errors + 1, uart->count);
  memmove(uart->ended, uart->ended + 1, uart->count * sizeof *uart->ended);
  avr->data[uart->chip->r_ucsra] &= ~OVERRUN;
  show(uart);
  return avr->data[address];
}

static void write_control(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  uart_t *uart = param;
  uart->control(avr, address, value, uart->control_param);
  if (!uart_listens(uart)) uart->count = 0;
  show(uart);
}

static void write_baud(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  uart_t *uart = param;
  uart->baud(avr, address, value, uart->baud_param);
  uart->chip->cycles_per_byte = byte_cycles(uart);
}

static avr_uart_t *found(const avr_t *avr, char name) {
  for (avr_io_t *io = avr->io_port; io; io = io->next) {
    avr_uart_t *chip = (avr_uart_t *)io;
    if (!strcmp(io->kind, "uart") && chip->name == name) return chip;
  }
  abort();
}

void uart_open(uart_t *uart, avr_t *avr, char name) {
  avr_uart_t *chip = uart->chip = found(avr, name);
  chip->flags = 0;
  avr_io_addr_t data = AVR_DATA_TO_IO(chip->r_udr), control = AVR_DATA_TO_IO(chip->r_ucsrb),
                baud = AVR_DATA_TO_IO(chip->ubrrl.reg);
  avr->io[data].r.c = read_byte;
  avr->io[data].r.param = uart;
  uart->control = avr->io[control].w.c;
  uart->control_param = avr->io[control].w.param;
  avr->io[control].w.c = write_control;
  avr->io[control].w.param = uart;
  uart->baud = avr->io[baud].w.c;
  uart->baud_param = avr->io[baud].w.param;
  avr->io[baud].w.c = write_baud;
  avr->io[baud].w.param = uart;
}

void uart_reset(uart_t *uart) { uart->count = 0; }

/* Bytes lost because the buffer was full, and maximum waiting time of a byte in cycles. */
void board_uart(board_t *board, uint32_t index, uint64_t *facts) {
  const uart_t *uart = &board->uart[index];
  facts[0] = uart->lost;
  facts[1] = uart->longest_wait;
}
