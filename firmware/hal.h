// The hardware of the board, as all other files see it: ports, UARTs, timers, converter, EEPROM,
// watchdog. hal_avr.h implements it for the ATmega2560, in place: most of it is one instruction;
// native/board.c implements it for a PC, in virtual time. No other file includes a header of the chip.
#ifndef HAL_H
#define HAL_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __AVR__
#define HAL static inline __attribute__((always_inline))
#else
#define HAL extern
#endif

// HAL_INTERRUPT(name) { ... } is the handler of one of: tick; of the line to the PC:
// host_byte, host_empty; of the servo bus: bus_byte, bus_empty, bus_sent; of the receiver: receiver,
// radio_byte.
//
// HAL_ATOMIC { ... } runs without any of them between.
//
// HAL_AT_RESET marks a function that runs within microseconds of a reset, before memory is set up.
// HAL_KEPT marks a variable that is not cleared then: it outlives all but a loss of power.

// Time: a tick each millisecond, and a count of half microseconds that wraps after 32 ms. Without
// HAL_ATOMIC the count may be read in an interrupt only.
HAL void hal_clock_start(void);
HAL uint16_t hal_half_us(void);

// Allows interrupts, for good.
HAL void hal_interrupts_start(void);

// Sleeps until an interrupt calls `hal_wake`, unless one did since the last sleep.
HAL void hal_sleep(void);
HAL void hal_wake(void);

// The line to the PC.
HAL void hal_host_start(void);
HAL uint8_t hal_host_flags(void);  // To be read before each byte.
HAL uint8_t hal_host_receive(void);
HAL void hal_host_send(uint8_t byte);
HAL void hal_host_sending(bool on);  // Whether `host_empty` asks for the next byte.
#define HAL_OVERRUN 0x08             // In the flags: a byte was lost.

// The servo bus: one wire, and a pin that says who speaks. Deaf while it sends.
typedef enum { BUS_SENDING, BUS_ENDING, BUS_LISTENING } hal_bus_t;
HAL void hal_bus_start(void);
HAL void hal_bus_mode(hal_bus_t mode);  // Ending: `bus_sent` comes after the byte that is sent next.
HAL void hal_bus_drive(bool on);
HAL uint8_t hal_bus_receive(void);
HAL void hal_bus_send(uint8_t byte);

// Pulses to the speed controllers, 50 a second, in half microseconds. The first begins at once; a
// new width holds from the next pulse on.
HAL void hal_esc_start(uint16_t half_us);
HAL uint16_t hal_esc_phase(void);  // Since the last pulse began.
HAL void hal_esc_put(uint8_t i, uint16_t half_us);

// The receiver: pulses, a bit for each wire, whose edges raise an interrupt; or a serial line of
// 100,000 baud, even parity, two stop bits. An input without its wire is silent.
#define HAL_RECEIVER_PINS 0x3f
HAL void hal_receiver_start(void);
HAL uint8_t hal_receiver_pins(void);
HAL uint8_t hal_radio_flags(void);  // To be read before each byte.
HAL uint8_t hal_radio_receive(void);
#define HAL_BROKEN 0x1c  // In the flags: no stop bit, a byte was lost, wrong parity.

// The converter, against the board's supply; full scale is 1023.
typedef enum { ADC_BATTERY = 0, ADC_DRIVE = 1, ADC_BANDGAP = 0x1e, ADC_GROUND = 0x1f } hal_adc_t;
HAL void hal_adc_start(void);
HAL void hal_adc_convert(hal_adc_t input);
HAL bool hal_adc_busy(void);
HAL uint16_t hal_adc_value(void);

// Memory that outlives power. Writing takes 3 ms: it returns at once when the memory is ready, and
// waits otherwise.
HAL uint8_t hal_eeprom_read(uint16_t address);
HAL bool hal_eeprom_ready(void);
HAL void hal_eeprom_write(uint16_t address, uint8_t byte);

// The watchdog, of 250 ms.
#define HAL_WATCHDOG_MS 250
HAL void hal_watchdog_start(void);
HAL void hal_watchdog_kick(void);

// Why the board started, in the bits of `ResetCause`; clears it.
#define HAL_CAUSE_POWER 0x01
#define HAL_CAUSE_WATCHDOG 0x08
HAL uint8_t hal_reset_cause(void);

// The light on the board.
HAL void hal_light_start(void);
HAL void hal_light(bool on);

#ifdef __AVR__
#include "hal_avr.h"
#else
#define HAL_INTERRUPT(name) void hal_interrupt_##name(void)
#define HAL_ATOMIC if (true)
#define HAL_AT_RESET
#define HAL_KEPT __attribute__((section("kept")))
HAL_INTERRUPT(tick);
HAL_INTERRUPT(receiver);
HAL_INTERRUPT(radio_byte);
HAL_INTERRUPT(host_byte);
HAL_INTERRUPT(host_empty);
HAL_INTERRUPT(bus_byte);
HAL_INTERRUPT(bus_empty);
HAL_INTERRUPT(bus_sent);
#endif

#endif
