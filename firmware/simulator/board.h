/* Environment of the chip, with one file per wire.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "avr_timer.h"
#include "avr_uart.h"
#include "sim_avr.h"

#define FREQUENCY 16000000
#define US(us) ((avr_cycle_count_t)(us) * (FREQUENCY / 1000000))

/* Addresses in the data space of the ATmega2560. */
#define PCIFR 0x3B
#define EIFR 0x3C
#define PCICR 0x68
#define PCMSK2 0x6D
#define OCR4AH 0xA9
#define TCNT5L 0x124
#define OCR5AL 0x128
#define OCR4CH 0xAD
#define PCINT2_VECTOR 11

#define RC_CHANNELS 6
#define RC_FRAME US(20000)
#define QUEUE 65536 /* An index wraps automatically. */
#define LONGEST_REQUEST 256

typedef struct {
  uint8_t bytes[QUEUE];
  uint16_t head, tail;
} queue_t;

/* Two bytes in the buffer and one in the shift register. */
#define UARTS 3
#define UART_ROOM 3
#define UART_ERRORS 0x14 /* Bits of UCSRnA: no stop bit, wrong parity. */

typedef struct {
  avr_uart_t *chip;
  uint8_t bytes[UART_ROOM], errors[UART_ROOM], count;
  avr_cycle_count_t ended[UART_ROOM];
  uint32_t lost, longest_wait;
  avr_io_write_t control, baud; /* Original handlers of simavr. */
  void *control_param, *baud_param;
} uart_t;

typedef struct {
  uint32_t pulses, width; /* Width of the last pulse, in cycles. */
  uint32_t unarmed_widest; /* Widest pulse while disarmed. */
  avr_cycle_count_t rise, fall, first_rise;
  bool wanted, wanted_before;
} esc_t;

#define WHEELS 3
#define DEPTH 4 /* Nesting of interrupts; only one can be interrupted. */

typedef struct {
  uint32_t period; /* 0 without pulses. */
  avr_cycle_count_t due; /* Next pulse. */
} wheel_t;

typedef struct board {
  avr_io_t io; /* Must be first; simavr calls it at each reset. */
  avr_t *avr;
  uint32_t resets;
  bool off; /* No power, or in the boot loader; no pin is driven. */
  uint16_t mode_address; /* Address of the board mode; 0 if there is no source. */
  uart_t uart[UARTS]; /* To the PC, to the servos, from the receiver. */
  /* Interrupts and stack. */
  uint32_t depth, running[DEPTH], spent[DEPTH], longest[64], stack_end;
  avr_cycle_count_t entered; /* By the last interrupt, or its return to this one. */
  queue_t to_board, to_host;
  uint8_t host_byte; /* In transmission. */
  bool host_arriving;
  /* Servo bus. */
  bool sending;
  uint8_t request[LONGEST_REQUEST];
  uint32_t request_length, strays, cuts, collisions, deaf;
  uint8_t byte; /* Reply byte in transmission. */
  bool arriving, heard;
  queue_t to_bus;
  avr_cycle_count_t bus_sent; /* Last stop bit of the board. */
  uint32_t turn_around; /* Maximum time from there to the falling edge of the direction pin. */
  void (*on_request)(const uint8_t *bytes, uint32_t length);
  esc_t esc[3];
  wheel_t wheel[WHEELS];
  avr_timer_comp_t *look; /* Its interrupt takes their edges. */
  /* Receiver. */
  avr_int_vector_t rc_change; /* simavr 1.6 has pin change interrupts on port B only. */
  uint32_t rc_us[RC_CHANNELS];
  bool sbus; /* One wire with frames instead of pulses. */
  uint8_t sbus_flags, radio_byte, radio_errors;
  bool radio_arriving;
  queue_t to_radio;
  bool rc_parallel; /* Pulses are simultaneous instead of consecutive. */
  avr_cycle_count_t rc_frame, rc_rise[RC_CHANNELS], rc_fall[RC_CHANNELS]; /* 0 if absent. */
  /* Part of the flash that was overwritten to hang the firmware. */
  avr_flashaddr_t hung_at;
  uint8_t hung_over[4];
  bool hung;
  /* Response awaited by `board_ask`. */
  const uint8_t *awaited;
  uint32_t awaited_length;
  bool answered;
} board_t;

/* Duration of a byte at the rate set by the firmware, which limits the data rate of the line. */
avr_cycle_count_t byte_cycles(const uart_t *uart);

/* UART of the chip: start and end of a received byte. */
void uart_open(uart_t *uart, avr_t *avr, char name);
void uart_reset(uart_t *uart);
bool uart_listens(const uart_t *uart);
void uart_begin(uart_t *uart);
void uart_end(uart_t *uart, uint8_t byte, uint8_t errors);
avr_irq_t *uart_irq(board_t *board, char name, int irq);
bool queue_take(queue_t *queue, uint8_t *byte);
void queue_put(queue_t *queue, const uint8_t *bytes, uint32_t count);

/* Connect each wire, and reset it with the chip. */
void interrupts_open(board_t *board);
void interrupts_reset(board_t *board);
void host_open(board_t *board);
void host_reset(board_t *board);
void bus_open(board_t *board);
void bus_reset(board_t *board);
void pulses_open(board_t *board);
void pulses_reset(board_t *board);
void receiver_open(board_t *board);
void receiver_reset(board_t *board);
void radio_reset(board_t *board);
void wheels_open(board_t *board);
void wheels_reset(board_t *board);

bool board_run(board_t *board, uint64_t cycle);

#endif
