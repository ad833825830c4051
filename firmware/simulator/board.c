/* The controller board in virtual time: the compiled firmware in libsimavr.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include "board.h"

#include <stdlib.h>
#include <string.h>

#include "avr_adc.h"
#include "avr_eeprom.h"
#include "avr_extint.h"
#include "sim_elf.h"

bool queue_take(queue_t *queue, uint8_t *byte) {
  if (queue->head == queue->tail) return false;
  *byte = queue->bytes[queue->tail++];
  return true;
}

void queue_put(queue_t *queue, const uint8_t *bytes, uint32_t count) {
  while (count--) queue->bytes[queue->head++] = *bytes++;
}

avr_irq_t *uart_irq(board_t *board, char name, int irq) {
  return avr_io_getirq(board->avr, AVR_IOCTL_UART_GETIRQ(name), irq);
}

static avr_cycle_count_t slice_end(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr, (void)when, (void)param;
  return 0;
}

static void on_reset(avr_io_t *io) {
  board_t *board = (board_t *)io;
  avr_t *avr = board->avr;
  board->resets++;
  for (int i = 0; i < UARTS; i++) uart_reset(&board->uart[i]);
  interrupts_reset(board);
  host_reset(board);
  bus_reset(board);
  pulses_reset(board);
  receiver_reset(board);
  radio_reset(board);
  wheels_reset(board);
  if (board->hung) memcpy(avr->flash + board->hung_at, board->hung_over, 4);
  board->hung = false;
  /* Otherwise simavr polls the pins in every cycle while they are low. */
  for (int i = 0; i < 8; i++) avr_extint_set_strict_lvl_trig(avr, i, 0);
  avr->run_cycle_limit = FREQUENCY;
}

static void say_nothing(avr_t *avr, const int level, const char *format, va_list arguments) {
  (void)avr, (void)level, (void)format, (void)arguments;
}

static void never_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }

board_t *board_open(const char *elf, uint16_t mode_address) {
  avr_global_logger_set(say_nothing);
  elf_firmware_t firmware = {0};
  if (elf_read_firmware(elf, &firmware)) return NULL;
  avr_t *avr = avr_make_mcu_by_name("atmega2560");
  if (!avr) return NULL;
  avr_init(avr);
  firmware.frequency = FREQUENCY;
  avr_load_firmware(avr, &firmware);
  avr->frequency = FREQUENCY;
  avr->vcc = avr->avcc = avr->aref = 5000;
  avr->sleep = never_sleep;
  board_t *board = calloc(1, sizeof *board);
  board->avr = avr;
  board->mode_address = mode_address;
  board->io.kind = "board";
  board->io.reset = on_reset;
  avr_register_io(avr, &board->io);
  for (int i = 0; i < UARTS; i++) uart_open(&board->uart[i], avr, "013"[i]);
  interrupts_open(board);
  host_open(board);
  bus_open(board);
  pulses_open(board);
  receiver_open(board);
  wheels_open(board);
  avr_reset(avr);
  avr_regbit_set(avr, avr->reset_flags.porf);
  board->resets = 0;
  return board;
}

void board_close(board_t *board) {
  avr_terminate(board->avr);
  free(board->avr);
  free(board);
}

uint64_t board_cycle(board_t *board) { return board->avr->cycle; }
uint32_t board_resets(board_t *board) { return board->resets; }

/* Switches the chip's power off. */
void board_off(board_t *board) {
  if (board->off) return;
  avr_reset(board->avr);
  board->resets--;
  board->off = true;
}

/* Switches it on, with `cause` in MCUSR. */
void board_on(board_t *board, uint8_t cause, bool lose_memory) {
  avr_t *avr = board->avr;
  board->off = false;
  if (lose_memory) memset(avr->data + avr->ioend + 1, 0xa5, avr->ramend - avr->ioend);
  avr_reset(avr);
  if (cause & 1) avr_regbit_set(avr, avr->reset_flags.porf);
  if (cause & 2) avr_regbit_set(avr, avr->reset_flags.extrf);
  if (cause & 4) avr_regbit_set(avr, avr->reset_flags.borf);
}

/* Runs to `cycle`, or until the awaited response; returns false if the firmware crashed. */
bool board_run(board_t *board, uint64_t cycle) {
  avr_t *avr = board->avr;
  board->answered = false;
  if (board->off) {
    if (cycle > avr->cycle) avr->cycle = cycle;
    return true;
  }
  if (cycle > avr->cycle) avr_cycle_timer_register(avr, cycle - avr->cycle, slice_end, board);
  while (avr->cycle < cycle && !board->answered) {
    int state = avr_run(avr);
    if (state == cpu_Done || state == cpu_Crashed) return false;
  }
  return true;
}

void board_set_adc(board_t *board, uint32_t channel, uint32_t millivolts) {
  avr_raise_irq(avr_io_getirq(board->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel),
                millivolts);
}

/* Sets the supply of the chip, which is its analogue reference. */
void board_set_supply(board_t *board, uint32_t millivolts) {
  board->avr->vcc = board->avr->avcc = millivolts;
}

/* TIMSK2: stops only the millisecond tick. */
void board_stop_tick(board_t *board) { board->avr->data[0x70] = 0; }

uint8_t board_peek(board_t *board, uint16_t address) { return board->avr->data[address]; }

void board_poke_eeprom(board_t *board, uint16_t address, uint8_t value) {
  avr_eeprom_desc_t byte = {.ee = &value, .offset = address, .size = 1};
  avr_ioctl(board->avr, AVR_IOCTL_EEPROM_SET, &byte);
}

/* Makes the firmware hang with interrupts disabled, until the next reset. */
void board_hang(board_t *board) {
  static const uint8_t CLI_AND_STAY[] = {0xf8, 0x94, 0xff, 0xcf};
  if (board->hung) return;
  board->hung = true;
  board->hung_at = board->avr->pc;
  memcpy(board->hung_over, board->avr->flash + board->hung_at, 4);
  memcpy(board->avr->flash + board->hung_at, CLI_AND_STAY, 4);
}

/* Resets the chip by its reset pin, or by a power cycle. */
void board_reset(board_t *board, bool power) { board_on(board, power ? 1 : 2, power); }

