// Where things are connected; README.md has the table for people.
#ifndef PINS_H
#define PINS_H

#include <avr/io.h>

// Speed controllers: OC4A, OC4B, OC4C (D6, D7, D8).
#define ESC_DDR DDRH
#define ESC_PORT PORTH
#define ESC_PINS (_BV(PH3) | _BV(PH4) | _BV(PH5))

// Direction of the half-duplex servo bus: high while the board sends (D22).
#define BUS_DDR DDRA
#define BUS_PORT PORTA
#define BUS_SEND _BV(PA0)

// Receiver: six channels on PK0 to PK5 (A8 to A13), pin change interrupt 2.
#define RC_INPUT PINK
#define RC_PULL_UPS PORTK
#define RC_MASK PCMSK2
#define RC_PINS 0x3f

// Battery at ADC0 (A0), speed controllers behind the contactor at ADC1 (A1): each over a divider of
// 30 and 10 kilo-ohm.
#define BATTERY_CHANNEL 0
#define DRIVE_CHANNEL 1
#define DIVIDER 4

// LED on the board: on while there is a source of joint commands (D13).
#define LIGHT_DDR DDRB
#define LIGHT_PORT PORTB
#define LIGHT _BV(PB7)

#endif
