/* Entry time and duration of interrupts, and stack depth.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <string.h>

#include "board.h"

#define ENTRY 5 /* Cycles for pushing the three-byte address, which simavr does not count. */
#define RETI 5
#define PAINT 0xa5 /* Same value as after a loss of power. */

static void on_running(avr_irq_t *irq, uint32_t vector, void *param) {
  (void)irq;
  board_t *board = param;
  avr_t *avr = board->avr;
  if (vector) {
    board->running = vector;
    board->entered = avr->cycle;
    for (int i = 0; i < ENTRY; i++) { /* Timers and wires continue. */
      avr->cycle++;
      avr_cycle_timer_process(avr);
    }
    return;
  }
  uint32_t took = avr->cycle + RETI - board->entered;
  if (took > board->longest[board->running]) board->longest[board->running] = took;
}

void interrupts_open(board_t *board) {
  avr_irq_t *irq = avr_get_interrupt_irq(board->avr, AVR_INT_ANY);
  avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, on_running, board);
}

/* Maximum duration of an interrupt from call to return, in cycles. */
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
