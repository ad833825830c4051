// The program: what is done once, and again and again.
#ifndef MAIN_H
#define MAIN_H

void main_start(void);

// Once through the loop, at the end of which the board sleeps.
void main_turn(void);

#endif
