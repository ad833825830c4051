// Encoding and decoding of Protocol 2.0 packets, for the PC and the servos.
// Source: Robotis e-Manual, "DYNAMIXEL Protocol 2.0".
#ifndef PACKET_H
#define PACKET_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"

#define PACKET_BROADCAST 0xfe
#define PACKET_ALERT 0x80  // Error bit of a status: the device reports a hardware error.

typedef enum {
  PACKET_PING = 0x01,
  PACKET_READ = 0x02,
  PACKET_WRITE = 0x03,
  PACKET_STATUS = 0x55,
  PACKET_SYNC_WRITE = 0x83,
} instruction_t;

// Longest received packet, and room for the longest sent packet: a read of PACKET_READ_LONGEST
// bytes with maximum stuffing.
#define PACKET_LONGEST 160
#define PACKET_READ_LONGEST 160
#define PACKET_ROOM (PACKET_READ_LONGEST + PACKET_READ_LONGEST / 3 + 14)

_Static_assert(PACKET_ROOM <= 255, "lengths are bytes");

typedef struct {
  uint8_t id;
  uint8_t instruction;
  const uint8_t *parameters;
  uint8_t count;
} packet_t;

typedef struct {
  uint8_t bytes[PACKET_LONGEST];
  uint8_t length;
  uint8_t needed;  // Bytes required before the next check.
  uint8_t done;    // Bytes of the last packet taken.
  uint16_t crc_errors;
} decoder_t;

void decoder_clear(decoder_t *decoder);

// Adds a byte; returns whether decoder_take must be called. Short and inline, because a byte
// arrives every 160 cycles. There is always room, because packets that would not fit are rejected
// by their length.
static inline bool decoder_push(decoder_t *decoder, uint8_t byte) {
  decoder->bytes[decoder->length++] = byte;
  return decoder->length >= decoder->needed;
}

// Whether decoder_take must be called.
static inline bool decoder_pending(const decoder_t *decoder) {
  return decoder->length >= decoder->needed;
}

// Checks the first header and takes or rejects its packet, so that each call computes at most one
// CRC. Call it while it is pending; extra calls are allowed. Repetition is required because headers
// can be nested. The packet is valid until the next call.
bool decoder_take(decoder_t *decoder, packet_t *packet);

// Abandons the packet in progress, if any, so that the bytes after its header are searched.
bool decoder_give_up(decoder_t *decoder);

// Writes a packet to `out`, which has PACKET_ROOM bytes, and returns its length.
uint8_t packet_write(uint8_t *out, uint8_t id, uint8_t instruction, const uint8_t *parameters,
                     uint8_t count);

#endif
