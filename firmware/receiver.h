// Radio receiver of either type.
#ifndef RECEIVER_H
#define RECEIVER_H

#include <stdbool.h>
#include <stdint.h>

// Receives a channel, from 0, and its pulse width.
typedef void (*heard_t)(uint8_t channel, uint16_t us);

typedef enum { RC_FORWARD, RC_LEFT, RC_TURN, RC_SPEED, RC_KILL, RC_MANUAL } channel_t;

void receiver_start(void);

// Call every millisecond: updates table.rc.
void receiver_tick(void);

// Whether all channels are received: as pulses, or in frames of a receiver with signal.
bool receiver_present(void);

// Whether a required channel is missing. All channels are required if the setup says so, or if any was
// received since power-on, even before a reset, so that a partially connected receiver does not count
// as a working kill switch.
bool receiver_lost(void);

// Whether the kill switch is on.
bool receiver_kills(void);

// Whether the switch between PC and radio control is at the latter.
bool receiver_manual(void);

#endif
