// The light on the board: who has the robot, and the cause of the last trip.
#ifndef LIGHT_H
#define LIGHT_H

// Call every millisecond.
void light_tick(void);

#endif
