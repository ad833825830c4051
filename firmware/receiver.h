// The receiver of the radio control: one pulse of 1 to 2 ms in 20 ms on each of six wires.
#ifndef RECEIVER_H
#define RECEIVER_H

#include <stdbool.h>

typedef enum { RC_FORWARD, RC_LEFT, RC_TURN, RC_SPEED, RC_KILL, RC_MANUAL } channel_t;

void receiver_start(void);

// To be called each millisecond: brings table.rc up to date.
void receiver_tick(void);

// All channels have pulses.
bool receiver_present(void);

// A channel that is needed has no pulses. All are, if the setup says so, or once any had some since
// power came, also over resets: a kill switch that is wired alone must not be taken for one that works.
bool receiver_lost(void);

// The kill switch is on.
bool receiver_kills(void);

// The switch between PC and radio control stands at the latter.
bool receiver_manual(void);

#endif
