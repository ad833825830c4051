/* Entry time and duration of interrupts, and stack depth.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <string.h>

#include "board.h"

#define ENTRY 5 /* Cycles for pushing the three-byte address, which simavr does not count. */
#define RETI 5
#define PAINT 0xa5 /* Same value as after a loss of power. */

/* An interrupt is entered, or returns: to the main program (0), or to the interrupt that it interrupted. */
static void on_running(avr_irq_t *irq, uint32_t vector, void *param) {
  (void)irq;
  board_t *board = param;
  avr_t *avr = board->avr;
  uint32_t at = board->depth - 1, spent = avr->cycle - board->entered;
  if (!vector || (board->depth > 1 && board->running[at - 1] == vector)) {
    uint32_t took = board->spent[at] + spent + RETI;
    if (took > board->longest[board->running[at]]) board->longest[board->running[at]] = took;
    board->depth--;
    board->entered = avr->cycle + RETI;
    return;
  }
  if (board->depth) board->spent[at] += spent;
  board->running[board->depth] = vector;
  board->spent[board->depth++] = 0;
  board->entered = avr->cycle;
  for (int i = 0; i < ENTRY; i++) { /* Timers and wires continue. */
    avr->cycle++;
    avr_cycle_timer_process(avr);
  }
}

void interrupts_reset(board_t *board) { board->depth = 0; }

void interrupts_open(board_t *board) {
  avr_irq_t *irq = avr_get_interrupt_irq(board->avr, AVR_INT_ANY);
  avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, on_running, board);
}

/* Maximum duration of an interrupt from call to return, without interrupts of it, in cycles. */
uint32_t board_interrupt(board_t *board, uint32_t vector) { return board->longest[vector]; }

/* Paints the memory after the variables, starting at `end`, before anything runs. */
void board_paint(board_t *board, uint32_t end) {
  board->stack_end = end;
  memset(board->avr->data + end, PAINT, board->avr->ramend + 1 - end);
}

/* Bytes of stack written since. */
uint32_t board_stack(board_t *board) {
  const avr_t *avr = board->avr;
  uint32_t at = board->stack_end;
  while (at <= avr->ramend && avr->data[at] == PAINT) at++;
  return avr->ramend + 1 - at;
}
