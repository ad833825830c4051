// Fuzzer of the whole program, compiled for the PC with the address and undefined-behaviour
// sanitizers: random bytes and commands from the PC, random servo responses, receiver pulses and
// frames, voltages and resets. `make fuzz`, then `build/fuzz_board SEED ROUNDS`. Any error ends it,
// as does a pulse while disarmed.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "control_table.h"
#include "hal.h"
#include "native/board.h"
#include "packet.h"
#include "servo.h"
#include "table.h"

#define LONGEST 120
#define MS 16000ULL

static uint32_t state;
static void *board;

static uint32_t draw(uint32_t below) {
  state ^= state << 13;
  state ^= state >> 17;
  state ^= state << 5;
  return state % below;
}

static uint8_t draw_byte(void) {
  static const uint8_t LIKELY[] = {0xff, 0xff, 0xfd, 0x00, 0x55, 0x01, 0x02, 0x03, 200};
  return draw(3) ? LIKELY[draw(sizeof LIKELY)] : (uint8_t)draw(256);
}

#define MX64 311

// Registers of a servo with Protocol 2.0: required settings, torque on, position 2048, and zeros.
static void fill(uint8_t *data, uint8_t address, uint8_t size) {
  const servo_model_t *model = servo_model(MX64);
  memset(data, 0, size);
  for (uint8_t i = 0; i < model->count; i++) {
    const setting_t *of = &model->settings[i];
    int32_t value = of->least;
    if (of->address < address || of->address + of->size > address + size) continue;
    memcpy(data + of->address - address, &value, of->size);
  }
  if (address == 0 && size == 2) memcpy(data, &(uint16_t){MX64}, size);
  if (address == PROTOCOL_2.torque.address) data[0] = 1;
  if (address == PROTOCOL_2.moving.address) data[5] = 8;
}

// Usually a correct servo response, sometimes an arbitrary one.
static void answer(const uint8_t *request, uint32_t length) {
  uint8_t out[PACKET_ROOM], parameters[1 + PACKET_LONGEST] = {0};
  uint8_t id = length > 4 ? request[4] : 1, count = 1;
  if (id == 0 || id > CT_SERVOS) return;
  if (length > 7 && request[7] == PACKET_PING) count = 4;
  if (length > 10 && request[7] == PACKET_READ && request[10] < PACKET_LONGEST) {
    count = 1 + request[10];
    fill(parameters + 1, request[8], request[10]);
  }
  uint32_t rarely = count > 5 ? 50 : 2000;  // With more errors it would never stay armed.
  for (uint8_t i = 1; i < count; i++) {
    if (draw(rarely) == 0) parameters[i] = draw_byte();
  }
  uint8_t size = packet_write(out, id, PACKET_STATUS, parameters, count);
  if (draw(300) == 0) out[draw(size)] ^= (uint8_t)(1 << draw(8));
  board_reply(board, out, draw(500) ? size : draw(size), 20 + draw(500));
}

static void write_block(uint16_t address, const void *block, uint8_t size) {
  uint8_t out[PACKET_ROOM], parameters[2 + LONGEST] = {address & 0xff, (uint8_t)(address >> 8)};
  memcpy(parameters + 2, block, size);
  board_send(board, out, packet_write(out, CT_BOARD_ID, PACKET_WRITE, parameters, (uint8_t)(size + 2)));
}

static void command(void) {
  control_table_t wanted = table;
  const uint8_t *block = (const uint8_t *)&wanted + CT_COMMAND;
  wanted.heartbeat++;
  wanted.arm = draw(8) != 0;
  memcpy(wanted.session, table.nonce, sizeof wanted.session);
  bool fast = table.mode == BOARD_ARMED;
  for (uint8_t i = 0; i < CT_ESCS; i++) wanted.throttle[i] = CT_ZERO_THROTTLE + (fast ? draw(2001) : 0);
  for (uint8_t i = 0; i < CT_SERVOS; i++) {
    // The servos do not move, so a permanent goal away from their position would trip.
    wanted.goal[i] = fast && draw(2) ? (int16_t)draw(2047) - 1023 : 0;
  }
  write_block(CT_COMMAND, block, CT_COMMAND_SIZE);
}

static void set_up(void) {
  static control_table_t first;
  if (!first.model) first = table;
  control_table_t wanted = first;
  uint8_t *block = (uint8_t *)&wanted + CT_SETUP;
  wanted.receiver_kind = draw(16) == 0;
  wanted.wheel_sensor = draw(4) ? 0 : 1 + draw(2);
  if (draw(3) == 0) block[draw(CT_SETUP_SIZE)] = (uint8_t)draw(256);
  memcpy(wanted.pulse_low, first.pulse_low, sizeof wanted.pulse_low);  // For the check in `main`.
  write_block(CT_SETUP, block, CT_SETUP_SIZE);
}

// The stop circuit must be open once.
static void prove_stop(void) {
  board_set_adc(board, ADC_DRIVE, 0);
  board_run(board, board_cycle(board) + 100 * MS);
  board_set_adc(board, ADC_DRIVE, 3000);
}

static void garbage(void) {
  uint8_t bytes[LONGEST];
  uint32_t count = draw(LONGEST);
  for (uint32_t i = 0; i < count; i++) bytes[i] = draw_byte();
  board_send(board, bytes, count);
}

static void sticks(void) {
  uint32_t us[CT_RC_CHANNELS] = {1500, 1500, 1500, 1100, 1900, 1100};
  if (draw(3) == 0) us[draw(CT_RC_CHANNELS)] = draw(8) ? 1000 + draw(1000) : draw(3000);
  board_set_rc(board, us);
}

// Complete, incomplete and random frames.
static void radio(void) {
  uint8_t bytes[LONGEST];
  uint32_t count = draw(2) ? 25 : draw(LONGEST);
  for (uint32_t i = 0; i < count; i++) bytes[i] = draw_byte();
  if (count) bytes[0] = draw(8) ? 0x0f : draw_byte();
  if (count > 24 && draw(8)) bytes[24] = 0;
  board_radio(board, bytes, count, draw(8) ? 0 : (uint8_t)draw(256));
}

static void telemetry(void) {
  uint8_t bytes[LONGEST];
  uint32_t count = draw(2) ? 10 : draw(LONGEST);
  for (uint32_t i = 0; i < count; i++) bytes[i] = draw_byte();
  board_telemetry(board, draw(CT_ESCS), bytes, count, draw(8) == 0);
}

static void act(void) {
  switch (draw(40)) {
    case 0:
      garbage();
      break;
    case 1:
      set_up();
      break;
    case 2:
      sticks();
      break;
    case 3:
      board_set_adc(board, draw(2), draw(20) ? 3000 : draw(5000));
      break;
    case 6:
      radio();
      break;
    case 7:
      board_sbus(board, draw(8) == 0, draw(8) ? 0 : (uint8_t)draw(256));
      break;
    case 9:
      board_set_wheel(board, draw(CT_ESCS), draw(4) ? 16000 + draw(160000) : draw(2000));
      break;
    case 10:
      telemetry();
      break;
    case 8:
      board_parallel_rc(board, 1 + draw(320000));
      break;
    case 4:
      if (draw(40) == 0) {
        board_reset(board, draw(2));
        prove_stop();
      }
      break;
    case 5:
      if (draw(40) == 0) board_hang(board);
      break;
    default:
      command();
  }
}

int main(int count, char **arguments) {
  if (count != 3) return 2;
  state = (uint32_t)strtoul(arguments[1], NULL, 10) * 2654435761U + 1U;
  uint32_t rounds = (uint32_t)strtoul(arguments[2], NULL, 10), armed = 0;
  uint8_t heard[4096];
  board = board_open("", 0);
  board_on_request(board, answer);
  board_set_adc(board, ADC_BATTERY, 3000);
  prove_stop();
  set_up();
  board_run(board, 2200 * MS);
  for (uint32_t i = 0; i < rounds; i++) {
    act();
    board_run(board, board_cycle(board) + (1 + draw(30)) * MS);
    board_receive(board, heard, sizeof heard);
    if (draw(60) == 0) board_run(board, board_cycle(board) + 2100 * MS);
    armed += table.mode == BOARD_ARMED;
    for (uint32_t wheel = 0; wheel < CT_ESCS; wheel++) {
      uint64_t facts[4];
      board_esc(board, wheel, facts);
      if (facts[2] <= 16016) continue;
      fprintf(stderr, "a pulse of %lu cycles while disarmed\n", (unsigned long)facts[2]);
      abort();
    }
  }
  printf("armed in %u of %u rounds, %u resets\n", armed, rounds, board_resets(board));
  return 0;
}
