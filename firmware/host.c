#include "host.h"

#include <string.h>

#include "host_line.h"
#include "packet.h"
#include "table.h"

#define BETWEEN_BYTES_MS 10
#define DISTURBED_MS 50  // Equal to the maximum age of a servo response.
#define AT_A_TIME 32  // Bytes per call, so that a continuous stream cannot delay the safety rules.

static decoder_t decoder;
static uint8_t silent_ms;
static uint8_t since_error_ms = DISTURBED_MS;

void host_start(void) {
  decoder_clear(&decoder);
  host_line_start();
}

static uint16_t word(const uint8_t *bytes) { return bytes[0] | (uint16_t)bytes[1] << 8; }

static void answer(answer_t error, const uint8_t *data, uint8_t length) {
  static uint8_t parameters[1 + PACKET_READ_LONGEST], out[PACKET_ROOM];
  parameters[0] = error;
  if (length) memcpy(parameters + 1, data, length);
  // If the buffer is full, the PC has repeated requests before a response; it gets the first
  // responses.
  host_line_send(out, packet_write(out, CT_BOARD_ID, PACKET_STATUS, parameters, 1 + length));
}

static void ping(void) {
  uint8_t identity[] = {table.model & 0xff, table.model >> 8, table.fw};
  answer(ANSWER_OK, identity, sizeof identity);
}

static void read(const packet_t *packet) {
  if (packet->count != 4) {
    answer(ANSWER_LENGTH, NULL, 0);
    return;
  }
  uint16_t address = word(packet->parameters), length = word(packet->parameters + 2);
  if (length == 0 || length > PACKET_READ_LONGEST) {
    answer(ANSWER_LENGTH, NULL, 0);
  } else if (address > CT_SIZE - length) {
    answer(ANSWER_ACCESS, NULL, 0);
  } else {
    answer(ANSWER_OK, (const uint8_t *)&table + address, length);
  }
}

static answer_t write(const packet_t *packet) {
  if (packet->count < 3) return ANSWER_LENGTH;
  return table_write(word(packet->parameters), packet->parameters + 2, packet->count - 2);
}

static void handle(const packet_t *packet) {
  // Ignore packets for other devices; answer broadcasts only if they are pings.
  bool broadcast = packet->id == PACKET_BROADCAST && packet->instruction == PACKET_PING;
  if (packet->id != CT_BOARD_ID && !broadcast) return;
  switch (packet->instruction) {
    case PACKET_PING:
      ping();
      break;
    case PACKET_READ:
      read(packet);
      break;
    case PACKET_WRITE:
      answer(write(packet), NULL, 0);
      break;
    case PACKET_STATUS:
      break;
    default:
      answer(ANSWER_INSTRUCTION, NULL, 0);
      break;
  }
}

static void look(void) {
  packet_t packet;
  if (decoder_take(&decoder, &packet)) handle(&packet);
  if (decoder.crc_errors) since_error_ms = 0;
  table.crc_errors += decoder.crc_errors;
  decoder.crc_errors = 0;
}

static void add_error(void) {
  table.rx_errors++;
  since_error_ms = 0;
}

bool host_poll(void) {
  uint8_t byte = 0;
  bool pending = decoder_pending(&decoder);
  for (uint8_t i = 0; i < AT_A_TIME && !pending && host_line_receive(&byte); i++) {
    silent_ms = 0;
    pending = decoder_push(&decoder, byte);
  }
  if (pending) look();
  if (host_line_overrun()) add_error();
  return host_line_waiting() || decoder_pending(&decoder);
}

bool host_disturbed(void) { return since_error_ms < DISTURBED_MS; }

void host_tick(void) {
  if (since_error_ms < DISTURBED_MS) since_error_ms++;
  if (silent_ms < BETWEEN_BYTES_MS) {
    silent_ms++;
    return;
  }
  if (decoder_pending(&decoder)) return;
  if (decoder_give_up(&decoder)) add_error();
}
