// A board in virtual time, used by simulator/board.py and the fuzzer. `board` is the result of
// `board_open`; each library has one.
#ifndef NATIVE_BOARD_H
#define NATIVE_BOARD_H

#include <stdbool.h>
#include <stdint.h>

// Powers the board; NULL if it is open already. Same arguments as in the other simulator.
void *board_open(const char *path, uint16_t mode_address);
void board_close(void *board);

// Runs until `cycle` (16 MHz), or until the response that `board_ask` waits for.
bool board_run(void *board, uint64_t cycle);
uint64_t board_cycle(void *board);

// Switches power off, and on with a reset cause; resets the board; number of resets.
void board_off(void *board);
void board_on(void *board, uint8_t cause, bool lose_memory);
void board_reset(void *board, bool power);
uint32_t board_resets(void *board);

// Faults: no instruction is executed; the millisecond tick stops.
void board_hang(void *board);
void board_stop_tick(void *board);

// The next turn of the main loop takes `us`, during which only interrupts run.
void board_busy(void *board, uint32_t us);

// Flags the next byte from the PC as following a lost byte.
void board_overrun(void *board);

// The line to the PC.
void board_send(void *board, const uint8_t *bytes, uint32_t count);
uint32_t board_receive(void *board, uint8_t *bytes, uint32_t room);

// Sends each of `count` cases and `ping`, and waits for `answer`; returns the index of the first
// that was not answered in time, or `count`.
uint32_t board_ask(void *board, const uint8_t *cases, const uint32_t *lengths, uint32_t count,
                   const uint8_t *ping, uint32_t ping_length, const uint8_t *answer,
                   uint32_t answer_length, uint32_t patience_us);

// The servo bus: request callback, response after `delay_us`, and fault counts: bytes sent while
// listening, requests cut by the pin, collisions with responses, bytes received before the board
// listened.
void board_on_request(void *board, void (*call)(const uint8_t *, uint32_t));
void board_reply(void *board, const uint8_t *bytes, uint32_t count, uint32_t delay_us);
void board_bus_faults(void *board, uint32_t *counts);

// Pulses to a speed controller: count, width of the last or 0 if they ceased, widest while
// disarmed, start of the first; in cycles.
void board_esc(void *board, uint32_t index, uint64_t *facts);

// Whether the light is on.
bool board_light(void *board);

// Inputs.
void board_set_rc(void *board, const uint32_t *us);
// Makes the receiver send SBUS frames with `flags` instead of pulses; sends bytes with error bits
// of HAL_BROKEN.
void board_sbus(void *board, bool on, uint8_t flags);
void board_radio(void *board, const uint8_t *bytes, uint32_t count, uint8_t errors);

// A wheel sensor gives a pulse per `period` cycles, or none if it is 0; `lost` in 256 pulses are
// missing, and `extra` in 256 are followed by another at a random time before the next.
void board_set_wheel(void *board, uint32_t index, uint32_t period);
void board_disturb_wheel(void *board, uint32_t index, uint8_t lost, uint8_t extra);

// Sends bytes on the telemetry wire of a speed controller, `broken` without stop bits.
void board_telemetry(void *board, uint32_t index, const uint8_t *bytes, uint32_t count, bool broken);

// Starts the pulses of all channels simultaneously, first after `cycles`.
void board_parallel_rc(void *board, uint32_t cycles);
void board_set_adc(void *board, uint32_t channel, uint32_t millivolts);
void board_set_supply(void *board, uint32_t millivolts);

// Memory: a byte of the control table; a byte of the EEPROM.
uint8_t board_peek(void *board, uint16_t address);
uint8_t board_peek_eeprom(void *board, uint16_t address);
void board_poke_eeprom(void *board, uint16_t address, uint8_t value);

#endif
