/* The controller board in virtual time: the compiled firmware in libsimavr, with what is around it.

   SPDX-License-Identifier: GPL-3.0-or-later, as libsimavr, which this is linked with. */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "avr_adc.h"
#include "avr_eeprom.h"
#include "avr_extint.h"
#include "avr_ioport.h"
#include "avr_uart.h"
#include "sim_avr.h"
#include "sim_elf.h"

#define FREQUENCY 16000000
#define US(us) ((avr_cycle_count_t)(us) * (FREQUENCY / 1000000))
/* Addresses in the data space of the ATmega2560. */
#define PCIFR 0x3B
#define PCICR 0x68
#define PCMSK2 0x6D
#define UBRR0 0xC4
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

static bool queue_take(queue_t *queue, uint8_t *byte) {
  if (queue->head == queue->tail) return false;
  *byte = queue->bytes[queue->tail++];
  return true;
}

static void queue_put(queue_t *queue, const uint8_t *bytes, uint32_t count) {
  while (count--) queue->bytes[queue->head++] = *bytes++;
}

typedef struct {
  uint32_t pulses, width; /* Of the newest pulse, in cycles. */
  uint32_t unarmed_widest; /* Of pulses that nobody may have wanted. */
  avr_cycle_count_t rise, first_rise;
  bool wanted, wanted_before;
} esc_t;

typedef struct board {
  avr_io_t io; /* First: simavr calls it at each reset. */
  avr_t *avr;
  uint32_t resets;
  uint16_t mode_address; /* Where the firmware says who has the joints; 0 is nobody. */
  queue_t to_board, to_host;
  /* Servo bus. */
  bool sending;
  uint8_t request[LONGEST_REQUEST];
  uint32_t request_length, strays, cuts, collisions;
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

/* The firmware's own byte time, so that it cannot be flooded beyond its rate. */
static avr_cycle_count_t byte_cycles(avr_t *avr, uint16_t ubrr) {
  uint32_t divisor = avr->data[ubrr] | (avr->data[ubrr + 1] & 0xf) << 8;
  return (divisor + 1) * 8 * 11; /* simavr counts eleven bits. */
}

static avr_irq_t *uart(board_t *board, char name, int irq) {
  return avr_io_getirq(board->avr, AVR_IOCTL_UART_GETIRQ(name), irq);
}

static avr_cycle_count_t feed_host(avr_t *avr, avr_cycle_count_t when, void *param) {
  board_t *board = param;
  uint8_t byte = 0;
  if (!queue_take(&board->to_board, &byte)) return 0;
  avr_raise_irq(uart(board, '0', UART_IRQ_INPUT), byte);
  return when + byte_cycles(avr, UBRR0);
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

/* The servo bus: one wire, so the board hears itself; servos see what is sent while the direction
   pin is high, and take its fall for the end of the request. */
static avr_cycle_count_t feed_bus(avr_t *avr, avr_cycle_count_t when, void *param) {
  board_t *board = param;
  uint8_t byte = 0;
  if (!queue_take(&board->to_bus, &byte)) return 0;
  if (board->sending) {
    board->collisions++;
  } else {
    avr_raise_irq(uart(board, '1', UART_IRQ_INPUT), byte);
  }
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
  esc->pulses++;
  /* A pulse that began within 20 ms of the disarming may have been on its way. */
  if (!esc->wanted && !esc->wanted_before && esc->width > esc->unarmed_widest) {
    esc->unarmed_widest = esc->width;
  }
}

static void set_rc_pin(board_t *board, bool high) {
  avr_t *avr = board->avr;
  avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('K'), board->rc_channel), high);
  if (avr->data[PCMSK2] & 1 << board->rc_channel) avr_raise_interrupt(avr, &board->rc_change);
}

/* Six pulses one after the other, as receivers make them. */
static avr_cycle_count_t step_receiver(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr;
  board_t *board = param;
  if (board->rc_high) {
    set_rc_pin(board, false);
    board->rc_high = false;
    board->rc_channel++;
  }
  while (board->rc_channel < RC_CHANNELS && !board->rc_us[board->rc_channel]) board->rc_channel++;
  if (board->rc_channel == RC_CHANNELS) {
    board->rc_channel = 0;
    board->rc_frame += RC_FRAME;
    if (board->rc_frame <= when) board->rc_frame = when + RC_FRAME;
    return board->rc_frame;
  }
  set_rc_pin(board, true);
  board->rc_high = true;
  return when + US(board->rc_us[board->rc_channel]);
}

/* simavr looks at the low byte only to see whether a width changed. */
static void on_width(avr_t *avr, avr_io_addr_t address, uint8_t value, void *param) {
  (void)param;
  avr->data[address] = value;
  avr->data[address - 1] ^= 1;
}

static avr_cycle_count_t slice_end(avr_t *avr, avr_cycle_count_t when, void *param) {
  (void)avr, (void)when, (void)param;
  return 0;
}

static void on_reset(avr_io_t *io) {
  board_t *board = (board_t *)io;
  avr_t *avr = board->avr;
  board->resets++;
  board->sending = false;
  board->request_length = 0;
  board->to_bus.tail = board->to_bus.head;
  board->to_board.tail = board->to_board.head;
  for (int i = 0; i < 3; i++) board->esc[i].rise = 0;
  if (board->hung) memcpy(avr->flash + board->hung_at, board->hung_over, 4);
  board->hung = false;
  board->rc_high = false;
  board->rc_channel = 0;
  avr_cycle_timer_register(avr, RC_FRAME, step_receiver, board);
  /* Otherwise it looks at the pins in every cycle while they are low. */
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
  board->rc_change = (avr_int_vector_t){
      .vector = PCINT2_VECTOR,
      .enable = AVR_IO_REGBIT(PCICR, 2),
      .raised = AVR_IO_REGBIT(PCIFR, 2),
  };
  avr_register_vector(avr, &board->rc_change);
  uint32_t flags = 0;
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('1'), &flags);
  avr_irq_register_notify(uart(board, '0', UART_IRQ_OUTPUT), on_host_byte, board);
  avr_irq_register_notify(uart(board, '1', UART_IRQ_OUTPUT), on_bus_byte, board);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('A'), 0), on_direction, board);
  for (int i = 3; i < 6; i++) {
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('H'), i), on_esc, board);
  }
  for (int address = OCR4AH; address <= OCR4CH; address += 2) {
    avr_register_io_write(avr, address, on_width, board);
  }
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

/* Runs to `cycle`, or until what is awaited came; false when the firmware crashed. */
bool board_run(board_t *board, uint64_t cycle) {
  avr_t *avr = board->avr;
  board->answered = false;
  if (cycle > avr->cycle) avr_cycle_timer_register(avr, cycle - avr->cycle, slice_end, board);
  while (avr->cycle < cycle && !board->answered) {
    int state = avr_run(avr);
    if (state == cpu_Done || state == cpu_Crashed) return false;
  }
  return true;
}

void board_send(board_t *board, const uint8_t *bytes, uint32_t count) {
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
   the pin cut short, replies that the board talked over. */
void board_bus_faults(board_t *board, uint32_t *counts) {
  counts[0] = board->strays;
  counts[1] = board->cuts;
  counts[2] = board->collisions;
}

/* Pulses seen, width of the newest, widest while nobody had the joints, first rise; cycles. */
void board_esc(board_t *board, uint32_t index, uint64_t *facts) {
  const esc_t *esc = &board->esc[index];
  facts[0] = esc->pulses;
  facts[1] = esc->width;
  facts[2] = esc->unarmed_widest;
  facts[3] = esc->first_rise;
}

void board_set_rc(board_t *board, const uint32_t *us) {
  memcpy(board->rc_us, us, sizeof board->rc_us);
}

void board_set_adc(board_t *board, uint32_t channel, uint32_t millivolts) {
  avr_raise_irq(avr_io_getirq(board->avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + channel),
                millivolts);
}

uint8_t board_peek(board_t *board, uint16_t address) { return board->avr->data[address]; }
void board_poke(board_t *board, uint16_t address, uint8_t value) {
  board->avr->data[address] = value;
}

void board_poke_eeprom(board_t *board, uint16_t address, uint8_t value) {
  avr_eeprom_desc_t byte = {.ee = &value, .offset = address, .size = 1};
  avr_ioctl(board->avr, AVR_IOCTL_EEPROM_SET, &byte);
}

/* Makes the firmware hang with interrupts off, wherever it is; the next reset mends it. */
void board_hang(board_t *board) {
  static const uint8_t CLI_AND_STAY[] = {0xf8, 0x94, 0xff, 0xcf};
  if (board->hung) return;
  board->hung = true;
  board->hung_at = board->avr->pc;
  memcpy(board->hung_over, board->avr->flash + board->hung_at, 4);
  memcpy(board->avr->flash + board->hung_at, CLI_AND_STAY, 4);
}

/* Resets the chip as its reset pin does, or as power does that comes back. */
void board_reset(board_t *board, bool power) {
  avr_t *avr = board->avr;
  if (power) memset(avr->data + avr->ioend + 1, 0xa5, avr->ramend - avr->ioend);
  avr_reset(avr);
  avr_regbit_set(avr, power ? avr->reset_flags.porf : avr->reset_flags.extrf);
}

/* For each of `count` cases sends it and `ping`, and waits for `answer`; returns the index of the
   first that was not answered in time, or `count`. */
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
