// Device 200 on the line to the PC: answers ping, read and write.
#ifndef HOST_H
#define HOST_H

#include <stdbool.h>

// Handles some of the received bytes; returns whether there are more.
bool host_poll(void);

// Call every millisecond: abandons incomplete packets.
void host_tick(void);

void host_start(void);

// Whether bytes from the PC were lost or corrupt within the last 50 ms.
bool host_disturbed(void);

#endif
