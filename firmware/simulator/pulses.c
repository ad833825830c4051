/* The signals to the three speed controllers.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include "avr_ioport.h"
#include "board.h"

static void on_esc(avr_irq_t *irq, uint32_t value, void *param) {
  board_t *board = param;
  esc_t *esc = &board->esc[irq->irq - 3];
  avr_cycle_count_t now = board->avr->cycle;
  if (value & 1) {
    if (!esc->first_rise) esc->first_rise = now;
    esc->rise = now;
    esc->wanted_before = esc->wanted;
    esc->wanted = !board->mode_address || board->avr->data[board->mode_address];
    return;
  }
  if (!esc->rise) return;
  esc->width = now - esc->rise;
  esc->rise = 0;
  esc->fall = now;
  esc->pulses++;
  /* A pulse that began within 20 ms of disarming may have been in progress. */
  if (!esc->wanted && !esc->wanted_before && esc->width > esc->unarmed_widest) {
    esc->unarmed_widest = esc->width;
  }
}

/* simavr detects changed widths by the low byte only. */
static void on_width(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)param;
  avr->data[address] = value;
  avr->data[address - 1] ^= 1;
}

void pulses_open(board_t *board) {
  for (int i = 3; i < 6; i++) {
    avr_irq_t *pin = avr_io_getirq(board->avr, AVR_IOCTL_IOPORT_GETIRQ('H'), i);
    avr_irq_register_notify(pin, on_esc, board);
  }
  for (int address = OCR4AH; address <= OCR4CH; address += 2) {
    avr_register_io_write(board->avr, address, on_width, board);
  }
}

void pulses_reset(board_t *board) {
  for (int i = 0; i < 3; i++) board->esc[i].rise = 0;
}

/* Pulse count, width of the last or 0 if they ceased, widest while disarmed, first rise; cycles. */
void board_esc(board_t *board, uint32_t index, uint64_t *facts) {
  const esc_t *esc = &board->esc[index];
  facts[0] = esc->pulses;
  facts[1] = board->avr->cycle - esc->fall < US(25000) ? esc->width : 0;
  facts[2] = esc->unarmed_widest;
  facts[3] = esc->first_rise;
}

