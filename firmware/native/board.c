// The controller board on a PC, in virtual time: hal.h implemented by events, with the same
// interface as simulator/board.c. The program takes no time. Each copy of the library is a separate
// board.
#include "board.h"

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "../baud.h"
#include "../control_table.h"
#include "../esc.h"
#include "../hal.h"
#include "../main.h"
#include "../watchdog.h"
#include "radio.h"

#define CYCLES_US (F_CPU / 1000000)
#define US(us) ((uint64_t)(us) * CYCLES_US)
#define MS(ms) US(1000ULL * (ms))
#define NEVER UINT64_MAX
#define QUEUE 65536  // An index wraps automatically.
#define LONGEST_REQUEST 256
#define EEPROM_SIZE 4096
#define CONVERSION US(104)
#define STORING US(3400)
#define PULSE_PERIOD MS(20)
#define HOST_BYTE (10ULL * 8 * (BAUD_REGISTER(HOST_BAUD) + 1))
#define RADIO_BYTE (12 * US(10))
#define TELEMETRY_BYTE (10 * F_CPU / 115200)
#define BUS_BYTE (10ULL * 8 * (BAUD_REGISTER(SERVO_BAUD) + 1))

typedef struct {
  uint8_t bytes[QUEUE];
  uint16_t head, tail;
} queue_t;

typedef struct {
  uint64_t pulses, width, unarmed_widest, rise, fall, first_rise;
  bool wanted, wanted_before;
} pulse_t;

typedef struct {
  uint64_t period, due, extra_due;
  uint8_t lost, extra;
} wheel_t;

typedef struct {
  queue_t bytes;
  uint64_t ends;  // Time when the next byte is complete.
  bool broken;
} wire_t;

enum {
  TICK, HOST_IN, HOST_OUT, BUS_IN, BUS_OUT, RECEIVER, RADIO_IN, RADIO_FRAMES, RISE, FALL,
  WATCHDOG = FALL + CT_ESCS, FREE, WHEELS, EVENTS
};

static struct {
  uint64_t now, clock_start, due[EVENTS];
  uint32_t resets;
  bool off, hung, awake, interrupts;
  queue_t to_board, to_host, to_bus;
  // The line to the PC.
  uint8_t host_byte;
  bool host_on, host_sending, overrun;
  uint64_t host_free;
  const uint8_t *awaited;
  uint32_t awaited_length;
  bool answered;
  // The servo bus.
  hal_bus_t bus;
  bool bus_on, driving, arriving, heard;
  uint8_t bus_byte, request[LONGEST_REQUEST];
  uint32_t request_length, strays, cuts, collisions, deaf;
  void (*on_request)(const uint8_t *, uint32_t);
  // Pulses.
  pulse_t pulse[CT_ESCS];
  uint16_t width[CT_ESCS];
  // The receiver.
  uint32_t rc_us[CT_RC_CHANNELS];
  uint8_t rc_pins;
  bool rc_listening, rc_parallel, sbus, radio_arriving;
  uint8_t sbus_flags, radio_byte, radio_errors;
  queue_t to_radio;
  uint64_t rc_frame, rc_rise[CT_RC_CHANNELS], rc_fall[CT_RC_CHANNELS];
  // Wheel sensors.
  wheel_t wheel[CT_ESCS];
  wire_t wire[CT_ESCS];
  uint32_t random;
  // The converter and the EEPROM.
  uint32_t input_mv[2], supply_mv, sampled_mv;
  hal_adc_t sampled_input;
  uint16_t converted;
  uint64_t conversion_ends, storing_ends;
  uint8_t eeprom[EEPROM_SIZE];
  uint8_t cause;
  bool light_on, light;
} board;

extern control_table_t table;

// Memory of the program, grouped by the Makefile in three sections and restored at a reset.
extern uint8_t __start_firmware_data[], __stop_firmware_data[];
extern uint8_t __start_firmware_bss[], __stop_firmware_bss[];
extern uint8_t __start_kept[], __stop_kept[];
static uint8_t *image;

// Byte by byte and without sanitizer, because the sections have gaps between variables.
__attribute__((no_sanitize("address"))) static void put(uint8_t *to, const uint8_t *end,
                                                        const volatile uint8_t *from, uint8_t byte) {
  while (to < end) *to++ = from ? *from++ : byte;
}

static size_t data_size(void) { return (size_t)(__stop_firmware_data - __start_firmware_data); }

// Keeps the initial values before anything runs.
static void remember(void) {
  if (image) return;
  image = malloc(data_size() + 1);
  put(image, image + data_size(), __start_firmware_data, 0);
  memset(board.eeprom, 0xff, sizeof board.eeprom);
  put(__start_kept, __stop_kept, NULL, 0xa5);
}

static bool queue_take(queue_t *queue, uint8_t *byte) {
  if (queue->head == queue->tail) return false;
  *byte = queue->bytes[queue->tail++];
  return true;
}

static void queue_put(queue_t *queue, const uint8_t *bytes, uint32_t count) {
  while (count--) queue->bytes[queue->head++] = *bytes++;
}

static bool runs(void) { return board.interrupts && !board.hung; }

// Time, interrupts, sleep.
void hal_clock_start(void) {
  board.clock_start = board.now;
  board.due[TICK] = board.now + MS(1);
}
uint16_t hal_half_us(void) { return (uint16_t)((board.now - board.clock_start) / 8); }
void hal_interrupts_start(void) { board.interrupts = true; }
void hal_sleep(void) { board.awake = false; }
void hal_wake(void) { board.awake = true; }

// The line to the PC.
void hal_host_start(void) { board.host_on = true; }

uint8_t hal_host_flags(void) {
  uint8_t flags = board.overrun ? HAL_OVERRUN : 0x20;  // A bit that is not an error flag.
  board.overrun = false;
  return flags;
}

uint8_t hal_host_receive(void) { return board.host_byte; }

void hal_host_send(uint8_t byte) {
  queue_put(&board.to_host, &byte, 1);
  board.host_free = board.now + HOST_BYTE;
  if (!board.awaited) return;
  uint16_t start = (uint16_t)(board.to_host.head - board.awaited_length);
  for (uint32_t i = 0; i < board.awaited_length; i++) {
    if (board.to_host.bytes[(uint16_t)(start + i)] != board.awaited[i]) return;
  }
  board.answered = true;
}

void hal_host_sending(bool on) {
  board.host_sending = on;
  uint64_t free = board.host_free > board.now ? board.host_free : board.now;
  board.due[HOST_OUT] = on ? free : NEVER;
}

static void host_in(void) {
  if (!queue_take(&board.to_board, &board.host_byte)) {
    board.due[HOST_IN] = NEVER;
    return;
  }
  board.due[HOST_IN] = board.now + HOST_BYTE;
  if (board.host_on && runs()) hal_interrupt_host_byte();
}

static void host_out(void) {
  board.due[HOST_OUT] = NEVER;
  if (!runs()) return;
  hal_interrupt_host_empty();
  if (board.host_sending) board.due[HOST_OUT] = board.host_free;
}

// The servo bus.
void hal_bus_start(void) {
  board.bus_on = true;
  board.bus = BUS_LISTENING;
}

void hal_bus_mode(hal_bus_t mode) {
  board.bus = mode;
  if (mode == BUS_SENDING) board.due[BUS_OUT] = board.now;
}

void hal_bus_drive(bool on) {
  if (on == board.driving) return;
  board.driving = on;
  if (on) {
    board.request_length = 0;
  } else if (board.due[BUS_OUT] != NEVER) {
    board.cuts++;
  } else if (board.on_request && board.request_length) {
    board.on_request(board.request, board.request_length);
  }
}

uint8_t hal_bus_receive(void) { return board.bus_byte; }

void hal_bus_send(uint8_t byte) {
  if (!board.driving) {
    board.strays++;
  } else if (board.request_length < LONGEST_REQUEST) {
    board.request[board.request_length++] = byte;
  }
  board.due[BUS_OUT] = board.now + BUS_BYTE;
}

static void bus_out(void) {
  board.due[BUS_OUT] = NEVER;
  if (!board.bus_on || !runs()) return;
  if (board.bus == BUS_SENDING) {
    hal_interrupt_bus_empty();
  } else if (board.bus == BUS_ENDING) {
    hal_interrupt_bus_sent();
  }
}

static void bus_in(void) {
  if (board.arriving) {
    board.arriving = false;
    if (board.driving) {
      board.collisions++;
    } else if (!board.heard) {
      board.deaf++;
    } else if (runs()) {
      hal_interrupt_bus_byte();
    }
  }
  if (!queue_take(&board.to_bus, &board.bus_byte)) {
    board.due[BUS_IN] = NEVER;
    return;
  }
  board.heard = board.bus == BUS_LISTENING;
  board.arriving = true;
  board.due[BUS_IN] = board.now + BUS_BYTE;
}

// Pulses.
void hal_esc_start(uint16_t half_us) {
  for (uint8_t i = 0; i < CT_ESCS; i++) board.width[i] = half_us;
  board.due[RISE] = board.now + 8;
}

uint16_t hal_esc_phase(void) {
  uint64_t left = board.due[RISE] - board.now;
  return left > PULSE_PERIOD ? 0 : (uint16_t)((PULSE_PERIOD - left) / 8);
}

void hal_esc_put(uint8_t i, uint16_t half_us) { board.width[i] = half_us; }

static void rise(void) {
  board.due[RISE] = board.now + PULSE_PERIOD;
  for (uint8_t i = 0; i < CT_ESCS; i++) {
    pulse_t *pulse = &board.pulse[i];
    if (!pulse->first_rise) pulse->first_rise = board.now;
    pulse->rise = board.now;
    pulse->wanted_before = pulse->wanted;
    pulse->wanted = table.mode != BOARD_DISARMED;
    board.due[FALL + i] = board.now + 8ULL * board.width[i];
  }
}

static void fall(uint8_t i) {
  pulse_t *pulse = &board.pulse[i];
  board.due[FALL + i] = NEVER;
  pulse->width = board.now - pulse->rise;
  pulse->fall = board.now;
  pulse->pulses++;
  // A pulse that began within 20 ms of disarming may have been in progress.
  bool unarmed = !pulse->wanted && !pulse->wanted_before;
  if (unarmed && pulse->width > pulse->unarmed_widest) pulse->unarmed_widest = pulse->width;
}

// The receiver: pulses one after another, or simultaneous.
void hal_receiver_start(void) { board.rc_listening = true; }
uint8_t hal_radio_flags(void) { return board.radio_errors; }
uint8_t hal_radio_receive(void) { return board.radio_byte; }

static void radio_in(void) {
  if (board.radio_arriving && board.rc_listening && runs()) hal_interrupt_radio_byte();
  board.radio_arriving = queue_take(&board.to_radio, &board.radio_byte);
  board.due[RADIO_IN] = board.radio_arriving ? board.now + RADIO_BYTE : NEVER;
}

static void send_frame(void) {
  uint8_t frame[RADIO_FRAME];
  board.due[RADIO_FRAMES] = board.now + US(RADIO_PERIOD_US);
  if (!board.sbus || !board.rc_us[0]) return;
  radio_frame(frame, board.rc_us, CT_RC_CHANNELS, board.sbus_flags);
  board_radio(&board, frame, sizeof frame, 0);
}

uint8_t hal_receiver_pins(void) { return board.rc_pins; }

static void plan_pulses(void) {
  uint64_t rise = board.rc_frame;
  for (int i = 0; i < CT_RC_CHANNELS; i++) {
    uint64_t width = board.sbus ? 0 : US(board.rc_us[i]);
    board.rc_rise[i] = width ? rise : NEVER;
    board.rc_fall[i] = width ? rise + width : NEVER;
    if (!board.rc_parallel) rise += width;
  }
}

static void step_receiver(void) {
  uint8_t before = board.rc_pins;
  if (board.now >= board.rc_frame) {
    plan_pulses();
    board.rc_frame += PULSE_PERIOD;
  }
  board.due[RECEIVER] = board.rc_frame;
  for (int i = 0; i < CT_RC_CHANNELS; i++) {
    bool falls = board.rc_rise[i] == NEVER;
    uint64_t *due = falls ? &board.rc_fall[i] : &board.rc_rise[i];
    if (*due <= board.now) {
      *due = NEVER;
      board.rc_pins = (uint8_t)(falls ? board.rc_pins & ~(1 << i) : board.rc_pins | 1 << i);
      due = &board.rc_fall[i];
    }
    if (*due < board.due[RECEIVER]) board.due[RECEIVER] = *due;
  }
  if (board.rc_pins != before && board.rc_listening && runs()) hal_interrupt_receiver();
}

static void begin_pulses(uint64_t after) {
  for (int i = 0; i < CT_RC_CHANNELS; i++) board.rc_rise[i] = board.rc_fall[i] = NEVER;
  board.due[RECEIVER] = board.rc_frame = board.now + after;
}

// The wheel sensors. Pulses are determined when the firmware looks at their flags.
uint16_t hal_wheels_next(void) {
  board.due[WHEELS] = board.now + US(HAL_WHEEL_US);
  return hal_half_us();
}

void hal_wheels_start(void) { hal_wheels_next(); }
void hal_wheels_stop(void) { board.due[WHEELS] = NEVER; }

static uint32_t draw(uint32_t below) {
  board.random = board.random * 1664525U + 1013904223U;
  return (uint32_t)((uint64_t)board.random * below >> 32);
}

static bool pulsed(wheel_t *wheel) {
  bool pulse = wheel->extra_due <= board.now;
  if (pulse) wheel->extra_due = NEVER;
  while (wheel->period && wheel->due <= board.now) {
    if (draw(256) >= wheel->lost) pulse = true;
    if (draw(256) < wheel->extra) wheel->extra_due = wheel->due + draw((uint32_t)wheel->period);
    wheel->due += wheel->period;
  }
  return pulse;
}

uint8_t hal_wheels_take(void) {
  uint8_t heard = 0;
  for (int i = 0; i < CT_ESCS; i++) {
    if (pulsed(&board.wheel[i])) heard |= (uint8_t)(1 << i);
  }
  return heard;
}

// Their telemetry, which arrives while the firmware waits for the next interrupt.
void hal_telemetry_start(void) {
  for (int i = 0; i < CT_ESCS; i++) board.wire[i].bytes.tail = board.wire[i].bytes.head;
  hal_wheels_next();
}

void hal_telemetry_stop(void) { board.due[WHEELS] = NEVER; }

int16_t hal_telemetry_take(uint8_t i) {
  wire_t *wire = &board.wire[i];
  uint8_t byte;
  if (wire->ends > board.now || !queue_take(&wire->bytes, &byte)) return -1;
  wire->ends += TELEMETRY_BYTE;
  return (int16_t)(byte | (wire->broken ? HAL_TELEMETRY_BROKEN : 0));
}

// The converter, the EEPROM, the watchdog, the light.
#define BANDGAP_MV 1100
#define NO_WIRE UINT32_MAX

void hal_adc_start(void) {}

void hal_adc_convert(hal_adc_t input) {
  // A disconnected input leaves the sampling capacitor unchanged; the bandgap has too high an
  // impedance to charge it in one conversion.
  if (input == ADC_BANDGAP) {
    board.sampled_mv = (board.sampled_mv + BANDGAP_MV + (board.sampled_mv < BANDGAP_MV)) / 2;
    if (board.sampled_input == ADC_BANDGAP) board.sampled_mv = BANDGAP_MV;
  } else if (input == ADC_GROUND) {
    board.sampled_mv = 0;
  } else if (board.input_mv[input] != NO_WIRE) {
    board.sampled_mv = board.input_mv[input];
  } else {
    // Unchanged.
  }
  board.sampled_input = input;
  uint32_t value = board.supply_mv ? board.sampled_mv * 1024 / board.supply_mv : 0;
  board.converted = (uint16_t)(value > 1023 ? 1023 : value);
  board.conversion_ends = board.now + CONVERSION;
}

bool hal_adc_busy(void) { return board.now < board.conversion_ends; }
uint16_t hal_adc_value(void) { return board.converted; }

uint8_t hal_eeprom_read(uint16_t address) { return board.eeprom[address % EEPROM_SIZE]; }
bool hal_eeprom_ready(void) { return board.now >= board.storing_ends; }

void hal_eeprom_write(uint16_t address, uint8_t byte) {
  if (board.eeprom[address % EEPROM_SIZE] == byte) return;
  board.eeprom[address % EEPROM_SIZE] = byte;
  uint64_t from = board.now;
  if (board.interrupts && !hal_eeprom_ready()) from = board.due[FREE] = board.storing_ends;
  board.storing_ends = from + STORING;
}

void hal_watchdog_start(void) { board.due[WATCHDOG] = board.now + MS(HAL_WATCHDOG_MS); }

void hal_watchdog_kick(void) {
  if (board.due[WATCHDOG] != NEVER) hal_watchdog_start();
}

uint8_t hal_reset_cause(void) {
  uint8_t cause = board.cause;
  board.cause = 0;
  return cause;
}

void hal_light_start(void) { board.light_on = true; }
void hal_light(bool on) { board.light = board.light_on && on; }

// Releases all pins.
static void stop(void) {
  for (int i = 0; i < EVENTS; i++) board.due[i] = NEVER;
  board.interrupts = board.hung = board.host_on = board.host_sending = false;
  board.light_on = board.light = false;
  board.bus_on = board.driving = board.arriving = board.rc_listening = board.radio_arriving = false;
  board.request_length = 0;
  board.to_board.tail = board.to_board.head;
  board.to_bus.tail = board.to_bus.head;
  board.to_radio.tail = board.to_radio.head;
  board.rc_pins = 0;
  board.conversion_ends = board.storing_ends = 0;
}

static void start(uint8_t cause) {
  stop();
  board.off = false;
  board.cause |= cause;
  board.resets++;
  begin_pulses(PULSE_PERIOD);
  board.due[RADIO_FRAMES] = board.now + US(RADIO_PERIOD_US);
  put(__start_firmware_data, __stop_firmware_data, image, 0);
  put(__start_firmware_bss, __stop_firmware_bss, NULL, 0);
  watchdog_start();
  esc_start();
  main_start();
  board.awake = true;
}

static void happen(int event) {
  switch (event) {
    case TICK:
      board.due[TICK] = board.now + MS(1);
      if (runs()) hal_interrupt_tick();
      break;
    case HOST_IN:
      host_in();
      break;
    case HOST_OUT:
      host_out();
      break;
    case BUS_IN:
      bus_in();
      break;
    case BUS_OUT:
      bus_out();
      break;
    case RECEIVER:
      step_receiver();
      break;
    case RADIO_IN:
      radio_in();
      break;
    case RADIO_FRAMES:
      send_frame();
      break;
    case RISE:
      rise();
      break;
    case WATCHDOG:
      start(HAL_CAUSE_WATCHDOG);
      break;
    case FREE:
      board.due[FREE] = NEVER;
      break;
    case WHEELS:
      board.due[WHEELS] = NEVER;
      if (runs()) hal_interrupt_wheels();
      break;
    default:
      fall((uint8_t)(event - FALL));
  }
}

// Interface shared with simulator/board.c.
bool board_run(void *it, uint64_t cycle) {
  (void)it;
  board.answered = false;
  while (!board.answered) {
    while (!board.off && !board.hung && board.awake && board.due[FREE] == NEVER) main_turn();
    int next = 0;
    for (int i = 1; i < EVENTS; i++) {
      if (board.due[i] < board.due[next]) next = i;
    }
    if (board.due[next] > cycle) break;
    board.now = board.due[next];
    happen(next);
  }
  if (!board.answered && cycle > board.now) board.now = cycle;
  return true;
}

void *board_open(const char *path, uint16_t mode_address) {
  (void)path, (void)mode_address;
  if (board.supply_mv) return NULL;
  remember();
  board.supply_mv = 5000;
  start(HAL_CAUSE_POWER);
  board.resets = 0;
  return &board;
}

void board_close(void *it) {
  (void)it;
  free(image);
  image = NULL;
}

uint64_t board_cycle(void *it) { return (void)it, board.now; }
uint32_t board_resets(void *it) { return (void)it, board.resets; }

void board_off(void *it) {
  (void)it;
  stop();
  board.off = true;
}

void board_on(void *it, uint8_t cause, bool lose_memory) {
  (void)it;
  if (lose_memory) put(__start_kept, __stop_kept, NULL, 0xa5);
  start(cause);
}

void board_reset(void *it, bool power) { board_on(it, power ? HAL_CAUSE_POWER : 2, power); }
void board_hang(void *it) { (void)it, board.hung = true; }
void board_overrun(void *it) { (void)it, board.overrun = true; }
void board_busy(void *it, uint32_t us) { (void)it, board.due[FREE] = board.now + US(us); }
void board_stop_tick(void *it) { (void)it, board.due[TICK] = NEVER; }

void board_send(void *it, const uint8_t *bytes, uint32_t count) {
  (void)it;
  if (board.off) return;
  queue_put(&board.to_board, bytes, count);
  if (board.due[HOST_IN] == NEVER) board.due[HOST_IN] = board.now + 1;
}

uint32_t board_receive(void *it, uint8_t *bytes, uint32_t room) {
  (void)it;
  uint32_t count = 0;
  while (count < room && queue_take(&board.to_host, bytes + count)) count++;
  return count;
}

uint32_t board_ask(void *it, const uint8_t *cases, const uint32_t *lengths, uint32_t count,
                   const uint8_t *ping, uint32_t ping_length, const uint8_t *answer,
                   uint32_t answer_length, uint32_t patience_us) {
  uint32_t done = 0;
  board.awaited = answer;
  board.awaited_length = answer_length;
  for (; done < count; done++) {
    board.to_host.tail = board.to_host.head;
    board_send(it, cases, lengths[done]);
    board_send(it, ping, ping_length);
    cases += lengths[done];
    if (!board_run(it, board.now + US(patience_us)) || !board.answered) break;
  }
  board.awaited = NULL;
  board.to_host.tail = board.to_host.head;
  return done;
}

void board_on_request(void *it, void (*call)(const uint8_t *, uint32_t)) {
  (void)it;
  board.on_request = call;
}

void board_reply(void *it, const uint8_t *bytes, uint32_t count, uint32_t delay_us) {
  (void)it;
  queue_put(&board.to_bus, bytes, count);
  if (board.due[BUS_IN] == NEVER) board.due[BUS_IN] = board.now + US(delay_us) + 1;
}

void board_bus_faults(void *it, uint32_t *counts) {
  (void)it;
  counts[0] = board.strays;
  counts[1] = board.cuts;
  counts[2] = board.collisions;
  counts[3] = board.deaf;
}

void board_esc(void *it, uint32_t index, uint64_t *facts) {
  (void)it;
  const pulse_t *pulse = &board.pulse[index];
  facts[0] = pulse->pulses;
  facts[1] = board.now - pulse->fall < MS(25) ? pulse->width : 0;
  facts[2] = pulse->unarmed_widest;
  facts[3] = pulse->first_rise;
}

void board_set_rc(void *it, const uint32_t *us) {
  (void)it;
  memcpy(board.rc_us, us, sizeof board.rc_us);
}

void board_sbus(void *it, bool on, uint8_t flags) {
  (void)it;
  board.sbus = on;
  board.sbus_flags = flags;
}

void board_radio(void *it, const uint8_t *bytes, uint32_t count, uint8_t errors) {
  (void)it;
  if (board.off) return;
  board.radio_errors = errors;
  queue_put(&board.to_radio, bytes, count);
  if (board.due[RADIO_IN] == NEVER) board.due[RADIO_IN] = board.now + 1;
}

void board_set_wheel(void *it, uint32_t index, uint32_t period) {
  (void)it;
  wheel_t *wheel = &board.wheel[index];
  if (!wheel->period) {
    wheel->due = board.now + period;
    wheel->extra_due = NEVER;
  } else if (wheel->due > board.now) {
    wheel->due = board.now + (wheel->due - board.now) * period / wheel->period;
  } else {
    // This pulse has not been seen yet.
  }
  wheel->period = period;
}

void board_disturb_wheel(void *it, uint32_t index, uint8_t lost, uint8_t extra) {
  (void)it;
  board.wheel[index].lost = lost;
  board.wheel[index].extra = extra;
}

void board_telemetry(void *it, uint32_t index, const uint8_t *bytes, uint32_t count, bool broken) {
  (void)it;
  wire_t *wire = &board.wire[index];
  if (wire->bytes.head == wire->bytes.tail) wire->ends = board.now + TELEMETRY_BYTE;
  wire->broken = broken;
  queue_put(&wire->bytes, bytes, count);
}

void board_parallel_rc(void *it, uint32_t cycles) {
  (void)it;
  board.rc_parallel = true;
  begin_pulses(cycles);
}

void board_set_adc(void *it, uint32_t channel, uint32_t millivolts) {
  (void)it;
  board.input_mv[channel] = millivolts;
}

bool board_light(void *it) { return (void)it, board.light; }

void board_set_supply(void *it, uint32_t millivolts) { (void)it, board.supply_mv = millivolts; }

// Byte of the control table.
uint8_t board_peek(void *it, uint16_t address) {
  return (void)it, ((const uint8_t *)&table)[address];
}

uint8_t board_peek_eeprom(void *it, uint16_t address) { return (void)it, board.eeprom[address]; }

void board_poke_eeprom(void *it, uint16_t address, uint8_t value) {
  (void)it, board.eeprom[address] = value;
}
