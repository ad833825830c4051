/* What is around the chip; each wire has a file.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "avr_uart.h"
#include "sim_avr.h"

#define FREQUENCY 16000000
#define US(us) ((avr_cycle_count_t)(us) * (FREQUENCY / 1000000))

/* Addresses in the data space of the ATmega2560. */
#define PCIFR 0x3B
#define PCICR 0x68
#define PCMSK2 0x6D
#define UBRR0 0xC4
#define UCSR1B 0xC9
#define RXEN1 0x10
#define UBRR1 0xCC
#define OCR4AH 0xA9
#define OCR4CH 0xAD
#define PCINT2_VECTOR 11

#define RC_CHANNELS 6
#define RC_FRAME US(20000)
#define QUEUE 65536 /* An index wraps by itself. */
#define LONGEST_REQUEST 256

typedef struct {
  uint8_t bytes[QUEUE];
  uint16_t head, tail;
} queue_t;

typedef struct {
  uint32_t pulses, width; /* Of the newest pulse, in cycles. */
  uint32_t unarmed_widest; /* Of pulses in disarmed mode. */
  avr_cycle_count_t rise, fall, first_rise;
  bool wanted, wanted_before;
} esc_t;

typedef struct board {
  avr_io_t io; /* First: simavr calls it at each reset. */
  avr_t *avr;
  uint32_t resets;
  bool off; /* Without power, or in its boot loader: no pin is driven. */
  uint16_t mode_address; /* Address of the board mode: source of joint commands, 0 is none. */
  queue_t to_board, to_host;
  /* Servo bus. */
  bool sending;
  uint8_t request[LONGEST_REQUEST];
  uint32_t request_length, strays, cuts, collisions, deaf;
  uint8_t byte; /* Of a reply, on its way. */
  bool arriving, heard;
  queue_t to_bus;
  void (*on_request)(const uint8_t *bytes, uint32_t length);
  esc_t esc[3];
  /* Receiver. */
  avr_int_vector_t rc_change; /* simavr 1.6 has pin change interrupts at port B only. */
  uint32_t rc_us[RC_CHANNELS];
  uint8_t rc_channel;
  bool rc_high;
  avr_cycle_count_t rc_frame;
  /* A piece of flash that was overwritten to hang the firmware. */
  avr_flashaddr_t hung_at;
  uint8_t hung_over[4];
  bool hung;
  /* What `board_ask` waits for. */
  const uint8_t *awaited;
  uint32_t awaited_length;
  bool answered;
} board_t;

/* Of a byte, at the rate that the firmware set: no line can be flooded beyond it. */
avr_cycle_count_t byte_cycles(const avr_t *avr, uint16_t ubrr);
avr_irq_t *uart(board_t *board, char name, int irq);
bool queue_take(queue_t *queue, uint8_t *byte);
void queue_put(queue_t *queue, const uint8_t *bytes, uint32_t count);

/* Each wire connects itself, and forgets what it did at a reset. */
void host_open(board_t *board);
void host_reset(board_t *board);
void bus_open(board_t *board);
void bus_reset(board_t *board);
void pulses_open(board_t *board);
void pulses_reset(board_t *board);
void receiver_open(board_t *board);
void receiver_reset(board_t *board);

bool board_run(board_t *board, uint64_t cycle);

#endif
