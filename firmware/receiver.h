// The receiver of the radio control, of either kind.
#ifndef RECEIVER_H
#define RECEIVER_H

#include <stdbool.h>
#include <stdint.h>

// Takes a channel, from 0, and the width of its pulse.
typedef void (*heard_t)(uint8_t channel, uint16_t us);

typedef enum { RC_FORWARD, RC_LEFT, RC_TURN, RC_SPEED, RC_KILL, RC_MANUAL } channel_t;

void receiver_start(void);

// To be called each millisecond: brings table.rc up to date.
void receiver_tick(void);

// All channels are heard: have pulses, or frames of a receiver that has a signal.
bool receiver_present(void);

// A channel that is needed is not heard. All are, if the setup says so, or once any had some since
// power came, also over resets: a kill switch that is wired alone must not be taken for one that works.
bool receiver_lost(void);

// The kill switch is on.
bool receiver_kills(void);

// The switch between PC and radio control stands at the latter.
bool receiver_manual(void);

#endif
