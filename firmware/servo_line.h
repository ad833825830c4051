// UART1, the half-duplex servo bus: sends a request, then listens.
#ifndef SERVO_LINE_H
#define SERVO_LINE_H

#include <stdbool.h>
#include <stdint.h>

// Longest request: goals of six servos with maximum stuffing, or any other packet.
#define SERVO_LINE_ROOM 64

void servo_line_start(void);

// Buffer for the next request, to be filled before `servo_line_send`.
uint8_t *servo_line_request(void);
void servo_line_send(uint8_t length);
bool servo_line_sending(void);
bool servo_line_receive(uint8_t *byte);

#endif
