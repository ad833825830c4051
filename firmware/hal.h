// Hardware abstraction: ports, UARTs, timers, converter, EEPROM, watchdog. hal_avr.h implements it
// inline for the ATmega2560, mostly with single instructions; rp2040/hal.c for the RP2040, and
// native/board.c for a PC, in virtual time. No other file accesses registers.
#ifndef HAL_H
#define HAL_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __AVR__
#define HAL static inline __attribute__((always_inline))
#else
#define HAL extern
#endif

// HAL_INTERRUPT(name) { ... } defines an interrupt handler: tick; host_byte and host_empty (line to
// the PC); bus_byte, bus_empty and bus_sent (servo bus); receiver and radio_byte (receiver); wheels
// (wheel sensors).
//
// HAL_ATOMIC { ... } runs without interrupts.
//
// HAL_AT_RESET marks a function that runs within microseconds of a reset, before memory is set up.
// HAL_KEPT marks a variable that is not cleared by a reset; it is lost only with the power.

// Time: a tick per millisecond, and a count of half microseconds that wraps after 32 ms. The count
// may be read only with HAL_ATOMIC or in an interrupt.
HAL void hal_clock_start(void);
HAL uint16_t hal_half_us(void);

// Enables interrupts permanently.
HAL void hal_interrupts_start(void);

// Sleeps until an interrupt calls `hal_wake`, unless one did since the last sleep.
HAL void hal_sleep(void);
HAL void hal_wake(void);

// The line to the PC.
HAL void hal_host_start(void);
HAL uint8_t hal_host_flags(void);  // Read before each byte.
HAL uint8_t hal_host_receive(void);
HAL void hal_host_send(uint8_t byte);
HAL void hal_host_sending(bool on);  // Enables `host_empty`, which requests the next byte.
#define HAL_OVERRUN 0x08             // Flag: a byte was lost.

// The servo bus: one wire with a direction pin. Does not receive while it sends.
typedef enum { BUS_SENDING, BUS_ENDING, BUS_LISTENING } hal_bus_t;
HAL void hal_bus_start(void);
HAL void hal_bus_mode(hal_bus_t mode);  // BUS_ENDING: `bus_sent` follows the next byte sent.
HAL void hal_bus_drive(bool on);
HAL uint8_t hal_bus_receive(void);
HAL void hal_bus_send(uint8_t byte);

// Pulses to the speed controllers, 50 per second, in half microseconds. The first starts
// immediately; new widths apply from the next pulse.
HAL void hal_esc_start(uint16_t half_us);
HAL uint16_t hal_esc_phase(void);  // Time since the start of the last pulse.
HAL void hal_esc_put(uint8_t i, uint16_t half_us);

// The receiver: pulses (one bit per wire), whose edges raise an interrupt; or a serial line with
// 100,000 baud, even parity, two stop bits. Disconnected inputs are silent.
#define HAL_RECEIVER_PINS 0x3f
HAL void hal_receiver_start(void);
HAL uint8_t hal_receiver_pins(void);
HAL uint8_t hal_radio_flags(void);  // Read before each byte.
HAL uint8_t hal_radio_receive(void);
#define HAL_BROKEN 0x1c  // Flags: no stop bit, lost byte, wrong parity.

// The wheel sensors, a wire with pulses per wheel. The chip keeps falling edges, and `wheels` takes them
// every HAL_WHEEL_US, or later if the lines are busy, so that neither fast wheels nor noise cost more
// time.
#define HAL_WHEEL_US 500
HAL void hal_wheels_start(void);
HAL void hal_wheels_stop(void);
HAL uint16_t hal_wheels_next(void);  // Requests the next interrupt; returns the count of half us.
HAL uint8_t hal_wheels_take(void);   // Wheels with an edge since the last call.
#ifdef __AVR__
#define HAL_WHEELS {0x10, 0x20, 0x01}  // Bits of these wheels.
#else
#define HAL_WHEELS {0x01, 0x02, 0x04}
#endif

// The telemetry of the speed controllers, a serial line per wheel with 115,200 baud, taken by `wheels` too. The
// Mega has one free UART for three lines, so it does not accept this sensor.
#ifdef __AVR__
#define HAL_TELEMETRY false
#else
#define HAL_TELEMETRY true
#endif
#define HAL_TELEMETRY_BROKEN 0x100  // Flag: no stop bit.
void hal_telemetry_start(void);
void hal_telemetry_stop(void);
int16_t hal_telemetry_take(uint8_t i);  // Next byte of a wheel, with the flag; or -1.

// The converter, relative to the board's supply; full scale is 1023. The battery and drive inputs
// are behind a divider by HAL_DIVIDER.
#ifdef __arm__
#define HAL_DIVIDER 6  // 15 and 3 kilo-ohm.
#else
#define HAL_DIVIDER 4  // 30 and 10 kilo-ohm.
#endif
typedef enum { ADC_BATTERY = 0, ADC_DRIVE = 1, ADC_BANDGAP = 0x1e, ADC_GROUND = 0x1f } hal_adc_t;
HAL void hal_adc_start(void);
HAL void hal_adc_convert(hal_adc_t input);
HAL bool hal_adc_busy(void);
HAL uint16_t hal_adc_value(void);

// Non-volatile memory, of which all boards have HAL_EEPROM_SIZE bytes. Writing takes 3 ms: it returns immediately if
// the memory is ready, and waits otherwise.
#define HAL_EEPROM_SIZE 252
HAL uint8_t hal_eeprom_read(uint16_t address);
HAL bool hal_eeprom_ready(void);
HAL void hal_eeprom_write(uint16_t address, uint8_t byte);

// The watchdog, 250 ms.
#define HAL_WATCHDOG_MS 250
HAL void hal_watchdog_start(void);
HAL void hal_watchdog_kick(void);

// Returns the reset cause as bits of `ResetCause`, and clears it.
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
#define HAL_AT_RESET
#ifdef __arm__
#define HAL_KEPT __attribute__((section(".noinit")))
#define HAL_ATOMIC for (uint32_t before = hal_lock(), once = 1; once; once = 0, hal_unlock(before))
HAL uint32_t hal_lock(void);
HAL void hal_unlock(uint32_t before);
#else
#define HAL_ATOMIC if (true)
#define HAL_KEPT __attribute__((section("kept")))
#endif
HAL_INTERRUPT(tick);
HAL_INTERRUPT(receiver);
HAL_INTERRUPT(radio_byte);
HAL_INTERRUPT(host_byte);
HAL_INTERRUPT(host_empty);
HAL_INTERRUPT(bus_byte);
HAL_INTERRUPT(bus_empty);
HAL_INTERRUPT(bus_sent);
HAL_INTERRUPT(wheels);
#endif

#endif
