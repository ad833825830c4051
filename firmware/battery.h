// The voltage of the battery, over a divider.
#ifndef BATTERY_H
#define BATTERY_H

void battery_start(void);

// To be called each millisecond: brings table.battery_mv up to date.
void battery_tick(void);

#endif
