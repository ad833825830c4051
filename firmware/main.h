// The program: start and main loop.
#ifndef MAIN_H
#define MAIN_H

void main_start(void);

// One iteration of the main loop, which ends with sleep.
void main_turn(void);

#endif
