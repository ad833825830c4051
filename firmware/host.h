// The board as device 200 of the PC: answers ping, read and write.
#ifndef HOST_H
#define HOST_H

#include <stdbool.h>

// Handles some of what came; returns whether there is more.
bool host_poll(void);

// To be called each millisecond: gives up on packets that were cut.
void host_tick(void);

void host_start(void);

// Bytes from the PC were lost or wrong within the last 50 ms.
bool host_disturbed(void);

#endif
