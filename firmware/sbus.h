// Receiver with one wire for all channels: SBUS, frames of 25 bytes with a bit for "no signal".
#ifndef SBUS_H
#define SBUS_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"
#include "receiver.h"

#define SBUS_FRAME 25
#define SBUS_CHANNELS CT_RECEIVER_CHANNELS

// Content of a frame.
typedef enum { SBUS_NONE, SBUS_CHANNELS_HEARD, SBUS_FAILSAFE } sbus_frame_t;

typedef struct {
  uint8_t bytes[SBUS_FRAME];
  uint8_t count;  // At SBUS_FRAME or more, bytes are ignored until the next pause.
} sbus_decoder_t;

void sbus_clear(sbus_decoder_t *decoder);

// Adds a byte: `first` after a pause, `broken` if received with an error. Returns the content of a
// completed frame, and reports its channels. Frames that the receiver invented, because it missed
// one from its transmitter, have no content.
sbus_frame_t sbus_push(sbus_decoder_t *decoder, uint8_t byte, bool first, bool broken, heard_t hear);

void sbus_start(void);

// Call every millisecond: reports new channels; returns false while the receiver reports no signal.
bool sbus_tick(heard_t hear);

#endif
