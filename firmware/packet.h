// Packets of Protocol 2.0, to and from bytes; both the PC and the servos speak it.
// Source: Robotis e-Manual, "DYNAMIXEL Protocol 2.0".
#ifndef PACKET_H
#define PACKET_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"

#define PACKET_BROADCAST 0xfe
#define PACKET_ALERT 0x80  // In the error of a status: the device reports a hardware error.

typedef enum {
  PACKET_PING = 0x01,
  PACKET_READ = 0x02,
  PACKET_WRITE = 0x03,
  PACKET_STATUS = 0x55,
  PACKET_SYNC_WRITE = 0x83,
} instruction_t;

// The longest packet that is understood, and room for the longest that is made: a read of
// PACKET_READ_LONGEST bytes, stuffed as much as can be.
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
  uint8_t needed;  // Bytes before there is anything to look at.
  uint8_t done;    // Bytes of the packet that was taken last.
  uint16_t crc_errors;
} decoder_t;

void decoder_clear(decoder_t *decoder);

// Takes a byte; returns whether there is anything to look at. Short, and here: a byte comes every
// 160 cycles. There is always room: a packet that would not fit is given up at its length.
static inline bool decoder_push(decoder_t *decoder, uint8_t byte) {
  decoder->bytes[decoder->length++] = byte;
  return decoder->length >= decoder->needed;
}

// There is something to look at.
static inline bool decoder_pending(const decoder_t *decoder) {
  return decoder->length >= decoder->needed;
}

// Looks at the first header: takes its packet, or gives it up, so that a call never checks more than
// one sum. Call it while something is pending, and at other times in between: bytes may be headers
// in headers. The packet stays as it is until the next call.
bool decoder_take(decoder_t *decoder, packet_t *packet);

// Gives up on the packet that has begun, if any, so that the bytes behind its header are searched.
bool decoder_give_up(decoder_t *decoder);

// Writes a packet to `out`, which has PACKET_ROOM bytes, and returns its length.
uint8_t packet_write(uint8_t *out, uint8_t id, uint8_t instruction, const uint8_t *parameters,
                     uint8_t count);

#endif
