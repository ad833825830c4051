// A receiver with one wire for all channels: SBUS, frames of 25 bytes with a bit for "no signal".
#ifndef SBUS_H
#define SBUS_H

#include <stdbool.h>
#include <stdint.h>

#include "control_table.h"
#include "receiver.h"

#define SBUS_FRAME 25
#define SBUS_CHANNELS CT_RECEIVER_CHANNELS

// What a frame says.
typedef enum { SBUS_NONE, SBUS_CHANNELS_HEARD, SBUS_FAILSAFE } sbus_frame_t;

typedef struct {
  uint8_t bytes[SBUS_FRAME];
  uint8_t count;  // A frame or more: what comes is left out until the next pause.
} sbus_decoder_t;

void sbus_clear(sbus_decoder_t *decoder);

// Takes a byte: `first` after a pause, `broken` when it arrived so. Returns what a frame says that is
// complete now, and tells of its channels. A frame that the receiver made up, since it missed one of
// its transmitter, says nothing.
sbus_frame_t sbus_push(sbus_decoder_t *decoder, uint8_t byte, bool first, bool broken, heard_t hear);

void sbus_start(void);

// To be called each millisecond: tells of new channels; returns false while the receiver says that it
// has no signal.
bool sbus_tick(heard_t hear);

#endif
