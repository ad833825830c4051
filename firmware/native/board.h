// A board in virtual time, as simulator/board.py and the fuzzer use it. `board` is what `board_open`
// returned; a library has one.
#ifndef NATIVE_BOARD_H
#define NATIVE_BOARD_H

#include <stdbool.h>
#include <stdint.h>

// Gives power to it; NULL when it has some already. The arguments are those of the other simulator.
void *board_open(const char *path, uint16_t mode_address);
void board_close(void *board);

// Lets time pass until `cycle`, of 16 MHz, or until an answer came that `board_ask` waits for.
bool board_run(void *board, uint64_t cycle);
uint64_t board_cycle(void *board);

// Takes its power away, gives it back with the cause of the reset; resets it; how often that was.
void board_off(void *board);
void board_on(void *board, uint8_t cause, bool lose_memory);
void board_reset(void *board, bool power);
uint32_t board_resets(void *board);

// Faults: no instruction is executed; the tick of a millisecond ceases.
void board_hang(void *board);
void board_stop_tick(void *board);

// The main loop takes so many microseconds for its next turn, in which only interrupts happen.
void board_busy(void *board, uint32_t us);

// The next byte from the PC comes with the flag of one that was lost before it.
void board_overrun(void *board);

// The line to the PC.
void board_send(void *board, const uint8_t *bytes, uint32_t count);
uint32_t board_receive(void *board, uint8_t *bytes, uint32_t room);

// For each of `count` cases sends it and `ping`, and waits for `answer`; returns the index of the
// first that was not answered in time, or `count`.
uint32_t board_ask(void *board, const uint8_t *cases, const uint32_t *lengths, uint32_t count,
                   const uint8_t *ping, uint32_t ping_length, const uint8_t *answer,
                   uint32_t answer_length, uint32_t patience_us);

// The servo bus: what the board asks, what is answered so many microseconds later; bytes sent while
// listening, requests cut by the pin, answers talked over, bytes that came before the board listened.
void board_on_request(void *board, void (*call)(const uint8_t *, uint32_t));
void board_reply(void *board, const uint8_t *bytes, uint32_t count, uint32_t delay_us);
void board_bus_faults(void *board, uint32_t *counts);

// Pulses to a speed controller: how many, width of the newest or 0 if they have ceased, widest while
// disarmed, when the first began; in cycles.
void board_esc(void *board, uint32_t index, uint64_t *facts);

// Whether the light is on.
bool board_light(void *board);

// Inputs.
void board_set_rc(void *board, const uint32_t *us);
// Has the receiver send frames of SBUS with such flags, instead of pulses; has such bytes arrive from
// it, with bits of HAL_BROKEN.
void board_sbus(void *board, bool on, uint8_t flags);
void board_radio(void *board, const uint8_t *bytes, uint32_t count, uint8_t errors);

// Has the pulses of all channels begin at once, the next ones so many cycles from now.
void board_parallel_rc(void *board, uint32_t cycles);
void board_set_adc(void *board, uint32_t channel, uint32_t millivolts);
void board_set_supply(void *board, uint32_t millivolts);

// Memory: a byte of the control table; one that outlives power.
uint8_t board_peek(void *board, uint16_t address);
uint8_t board_peek_eeprom(void *board, uint16_t address);
void board_poke_eeprom(void *board, uint16_t address, uint8_t value);

#endif
