#include "packet.h"

#include <string.h>

#include "crc16.h"

#define HEADER 7  // FF FF FD 00, id, length (2).
#define SHORTEST 3  // Instruction and CRC.

static const uint8_t START[] = {0xff, 0xff, 0xfd, 0x00};

void decoder_clear(decoder_t *decoder) {
  decoder->length = 0;
  decoder->needed = HEADER;
  decoder->done = 0;
}

static void drop(decoder_t *decoder, uint8_t count) {
  decoder->length -= count;
  memmove(decoder->bytes, decoder->bytes + count, decoder->length);
  decoder->needed = HEADER;
}

// Number of bytes before the first possible packet start.
static uint8_t before_start(const decoder_t *decoder) {
  uint8_t at = 0;
  for (; at < decoder->length; at++) {
    uint8_t left = decoder->length - at;
    if (memcmp(decoder->bytes + at, START, left < sizeof START ? left : sizeof START) == 0) break;
  }
  return at;
}

// Size of the packet at the start of the buffer; 0 if its length is invalid.
static uint8_t whole(const decoder_t *decoder) {
  uint16_t length = decoder->bytes[5] | (uint16_t)decoder->bytes[6] << 8;
  return length < SHORTEST || length > PACKET_LONGEST - HEADER ? 0 : HEADER + length;
}

// Removes the byte stuffing in place; returns the remaining length.
static uint8_t unstuffed(uint8_t *data, uint8_t length) {
  uint8_t *end = data + length, *at = data;
  while ((at = memchr(at, START[2], end - at))) {
    at++;
    bool header = at - data >= 3 && at[-2] == START[1] && at[-3] == START[0];
    if (header && at < end && *at == START[2]) memmove(at, at + 1, --end - at);
  }
  return end - data;
}

// Stuffs header-like bytes in place; returns the new length.
static uint8_t stuffed(uint8_t *data, uint8_t length) {
  uint8_t *end = data + length, *at = data;
  while ((at = memchr(at, START[2], end - at))) {
    at++;
    bool header = at - data >= 3 && at[-2] == START[1] && at[-3] == START[0];
    if (!header) continue;
    memmove(at + 1, at, end++ - at);
    *at++ = START[2];
  }
  return end - data;
}

bool decoder_take(decoder_t *decoder, packet_t *packet) {
  drop(decoder, decoder->done);
  decoder->done = 0;
  drop(decoder, before_start(decoder));
  if (decoder->length < HEADER) return false;
  uint8_t size = whole(decoder);
  if (decoder->length < size) {
    decoder->needed = size;
    return false;
  }
  if (size) {
    uint8_t *bytes = decoder->bytes;
    uint16_t sum = bytes[size - 2] | (uint16_t)bytes[size - 1] << 8;
    if (crc16(0, bytes, size - 2) == sum) {
      uint8_t count = unstuffed(bytes + HEADER, size - HEADER - 2) - 1;
      *packet = (packet_t){bytes[4], bytes[HEADER], bytes + HEADER + 1, count};
      decoder->done = size;
      return true;
    }
    decoder->crc_errors++;
  }
  drop(decoder, 1);
  return false;
}

bool decoder_give_up(decoder_t *decoder) {
  if (decoder->length == 0) return false;
  drop(decoder, 1);
  return true;
}

uint8_t packet_write(uint8_t *out, uint8_t id, uint8_t instruction, const uint8_t *parameters,
                     uint8_t count) {
  memcpy(out, START, sizeof START);
  out[4] = id;
  out[HEADER] = instruction;
  if (count) memcpy(out + HEADER + 1, parameters, count);
  uint8_t end = stuffed(out + HEADER, 1 + count) + HEADER;
  uint16_t length = end - HEADER + 2;
  out[5] = length & 0xff;
  out[6] = length >> 8;
  uint16_t sum = crc16(0, out, end);
  out[end++] = sum & 0xff;
  out[end++] = sum >> 8;
  return end;
}
