// The board as device 200 of the PC: answers ping, read and write.
#ifndef HOST_H
#define HOST_H

// Handles all that came.
void host_poll(void);

// To be called each millisecond: gives up on packets that were cut.
void host_tick(void);

void host_start(void);

#endif
