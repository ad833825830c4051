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

// A channel had pulses at some time since power came: from then on all are needed, also after a
// reset. Who wired the kill switch alone must not believe that it is heard.
bool receiver_seen(void);

// The kill switch is on, or its state is unknown. A robot without receiver has none.
bool receiver_kills(void);

// The switch between PC and radio control stands at the latter.
bool receiver_manual(void);

#endif
