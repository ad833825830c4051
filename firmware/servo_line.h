// UART1, the half-duplex servo bus: sends one request, then listens.
#ifndef SERVO_LINE_H
#define SERVO_LINE_H

#include <stdbool.h>
#include <stdint.h>

// The longest request: goals of six servos, stuffed as much as can be, or any packet of ours.
#define SERVO_LINE_ROOM 64

void servo_line_start(void);

// Where the next request is to be written, before `servo_line_send`.
uint8_t *servo_line_request(void);
void servo_line_send(uint8_t length);
bool servo_line_sending(void);
bool servo_line_receive(uint8_t *byte);

#endif
