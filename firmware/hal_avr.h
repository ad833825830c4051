// Implementation of hal.h on the ATmega2560 of an Arduino Mega at 16 MHz. README.md lists the pins.
#ifndef HAL_AVR_H
#define HAL_AVR_H

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "baud.h"

_Static_assert(BAUD_FITS(HOST_BAUD), "HOST_BAUD cannot be made of 16 MHz");
_Static_assert(BAUD_FITS(SERVO_BAUD), "SERVO_BAUD cannot be made of 16 MHz");

#define HAL_ATOMIC ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
#define HAL_AT_RESET __attribute__((naked, used, section(".init3")))
#define HAL_KEPT __attribute__((section(".noinit")))

#define HAL_INTERRUPT(name) HAL_INTERRUPT_##name
#define HAL_INTERRUPT_tick ISR(TIMER2_COMPA_vect)
#define HAL_INTERRUPT_receiver ISR(PCINT2_vect)
#define HAL_INTERRUPT_radio_byte ISR(USART3_RX_vect)
#define HAL_INTERRUPT_host_byte ISR(USART0_RX_vect)
#define HAL_INTERRUPT_host_empty ISR(USART0_UDRE_vect)
#define HAL_INTERRUPT_bus_byte ISR(USART1_RX_vect)
#define HAL_INTERRUPT_bus_empty ISR(USART1_UDRE_vect)
#define HAL_INTERRUPT_bus_sent ISR(USART1_TX_vect)
#define HAL_INTERRUPT_wheels ISR(TIMER5_COMPA_vect, ISR_NOBLOCK)  // No byte waits for it.

HAL void hal_clock_start(void) {
  TCCR5A = 0;
  TCCR5B = _BV(CS51);  // 16 MHz / 8.
  TCCR2A = _BV(WGM21);
  OCR2A = F_CPU / 64 / 1000 - 1;
  TCCR2B = _BV(CS22);  // 16 MHz / 64.
  TIMSK2 = _BV(OCIE2A);
  set_sleep_mode(SLEEP_MODE_IDLE);
}

HAL uint16_t hal_half_us(void) { return TCNT5; }

HAL void hal_interrupts_start(void) { sei(); }

HAL void hal_wake(void) { GPIOR0 |= 1; }

HAL void hal_sleep(void) {
  cli();
  if (!(GPIOR0 & 1)) {
    sleep_enable();
    sei();  // Takes effect after the next instruction, so no interrupt can occur in between.
    sleep_cpu();
    sleep_disable();
  }
  GPIOR0 = 0;
  sei();
}

HAL void hal_host_start(void) {
  UCSR0A = _BV(U2X0);
  UBRR0 = BAUD_REGISTER(HOST_BAUD);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

_Static_assert(HAL_OVERRUN == _BV(DOR0), "as the chip has it");
HAL uint8_t hal_host_flags(void) { return UCSR0A; }
HAL uint8_t hal_host_receive(void) { return UDR0; }
HAL void hal_host_send(uint8_t byte) { UDR0 = byte; }

HAL void hal_host_sending(bool on) {
  if (on) {
    UCSR0B |= _BV(UDRIE0);
  } else {
    UCSR0B &= ~_BV(UDRIE0);
  }
}

// Direction of the bus: PA0 (D22), high while the board sends.
HAL void hal_bus_drive(bool on) {
  if (on) {
    PORTA |= _BV(PA0);
  } else {
    PORTA &= ~_BV(PA0);
  }
}

HAL void hal_bus_mode(hal_bus_t mode) {
  if (mode == BUS_SENDING) UCSR1B = _BV(UDRIE1) | _BV(TXEN1);
  if (mode == BUS_LISTENING) UCSR1B = _BV(RXCIE1) | _BV(RXEN1) | _BV(TXEN1);
  if (mode == BUS_ENDING) {
    // A gap between bytes may have set this flag already; only the end of the last byte counts.
    UCSR1A = _BV(U2X1) | _BV(TXC1);
    UCSR1B = _BV(TXCIE1) | _BV(TXEN1);
  }
}

HAL void hal_bus_start(void) {
  DDRA |= _BV(PA0);
  UCSR1A = _BV(U2X1);
  UBRR1 = BAUD_REGISTER(SERVO_BAUD);
  UCSR1C = _BV(UCSZ11) | _BV(UCSZ10);
  hal_bus_mode(BUS_LISTENING);
}

HAL uint8_t hal_bus_receive(void) { return UDR1; }
HAL void hal_bus_send(uint8_t byte) { UDR1 = byte; }

// Speed controllers: OC4A, OC4B, OC4C on PH3, PH4, PH5 (D6, D7, D8).
#define ESC_PERIOD (F_CPU / 8 / 50 - 1)

HAL void hal_esc_start(uint16_t half_us) {
  DDRH |= _BV(PH3) | _BV(PH4) | _BV(PH5);
  OCR4A = OCR4B = OCR4C = half_us - 1;
  ICR4 = ESC_PERIOD;
  TCCR4A = _BV(COM4A1) | _BV(COM4B1) | _BV(COM4C1) | _BV(WGM41);
  TCNT4 = ESC_PERIOD - 1;  // Start the first pulse now instead of in 20 ms.
  TCCR4B = _BV(WGM43) | _BV(WGM42) | _BV(CS41);  // Fast PWM up to ICR4, 16 MHz / 8.
}

HAL uint16_t hal_esc_phase(void) { return TCNT4; }

HAL void hal_esc_put(uint8_t i, uint16_t half_us) {
  if (i == 0) OCR4A = half_us - 1;
  if (i == 1) OCR4B = half_us - 1;
  if (i == 2) OCR4C = half_us - 1;
}

// Receiver: six wires on PK0 to PK5 (A8 to A13), pin change interrupt 2; or serial on PJ0 (D15,
// RX3).
#define RADIO_BAUD 100000UL
_Static_assert(BAUD_REACHED(RADIO_BAUD) == RADIO_BAUD, "exact with 16 MHz");

HAL void hal_receiver_start(void) {
  PORTK |= HAL_RECEIVER_PINS;  // Pull-ups, so that a disconnected wire makes no pulses.
  PORTJ |= _BV(PJ0);
  PCMSK2 = HAL_RECEIVER_PINS;
  UCSR3A = _BV(U2X3);
  UBRR3 = BAUD_REGISTER(RADIO_BAUD);
  UCSR3C = _BV(UPM31) | _BV(USBS3) | _BV(UCSZ31) | _BV(UCSZ30);
  UCSR3B = _BV(RXCIE3) | _BV(RXEN3);
  PCICR |= _BV(PCIE2);
}

HAL uint8_t hal_receiver_pins(void) { return PINK & HAL_RECEIVER_PINS; }

_Static_assert(HAL_BROKEN == (_BV(FE3) | _BV(DOR3) | _BV(UPE3)), "as the chip has it");
HAL uint8_t hal_radio_flags(void) { return UCSR3A; }
HAL uint8_t hal_radio_receive(void) { return UDR3; }

// Wheel sensors: INT4, INT5, INT0 on PE4, PE5, PD0 (D2, D3, D21). Their interrupts stay off, because
// they would precede those of the lines; only their flags are used, and the clock's timer takes them.
#define WHEEL_FLAGS (_BV(INTF0) | _BV(INTF4) | _BV(INTF5))
HAL uint16_t hal_wheels_next(void) {
  uint16_t now = 0;
  HAL_ATOMIC {  // Interrupts use the timer's hidden byte too.
    now = TCNT5;
    OCR5A = now + 2 * HAL_WHEEL_US;
  }
  return now;
}

HAL void hal_wheels_start(void) {
  PORTE |= _BV(PE4) | _BV(PE5);
  PORTD |= _BV(PD0);
  EICRA |= _BV(ISC01);
  EICRB |= _BV(ISC41) | _BV(ISC51);
  EIFR = WHEEL_FLAGS;
  hal_wheels_next();
  TIFR5 = _BV(OCF5A);
  TIMSK5 = _BV(OCIE5A);
}

HAL void hal_wheels_stop(void) { TIMSK5 = 0; }

HAL uint8_t hal_wheels_take(void) {
  uint8_t flags = EIFR & WHEEL_FLAGS;
  EIFR = flags;
  return flags;  // As in HAL_WHEELS.
}

// Battery at ADC0 (PF0, A0), speed controllers behind the contactor at ADC1 (PF1, A1).
HAL void hal_adc_start(void) {
  ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);  // 16 MHz / 128.
}

HAL void hal_adc_convert(hal_adc_t input) {
  ADMUX = _BV(REFS0) | input;  // Relative to the 5 V supply.
  ADCSRA |= _BV(ADSC);
}

HAL bool hal_adc_busy(void) { return ADCSRA & _BV(ADSC); }
HAL uint16_t hal_adc_value(void) { return ADC; }

HAL uint8_t hal_eeprom_read(uint16_t address) {
  return eeprom_read_byte((const uint8_t *)address);
}
HAL bool hal_eeprom_ready(void) { return eeprom_is_ready(); }
HAL void hal_eeprom_write(uint16_t address, uint8_t byte) {
  eeprom_update_byte((uint8_t *)address, byte);
}

_Static_assert(HAL_WATCHDOG_MS == 250, "as WDTO_250MS");
HAL void hal_watchdog_start(void) { wdt_enable(WDTO_250MS); }
HAL void hal_watchdog_kick(void) { wdt_reset(); }

_Static_assert(HAL_CAUSE_POWER == _BV(PORF) && HAL_CAUSE_WATCHDOG == _BV(WDRF), "as the chip has it");
HAL uint8_t hal_reset_cause(void) {
  uint8_t cause = MCUSR;
  MCUSR = 0;
  return cause;
}

// PB7 (D13).
HAL void hal_light_start(void) { DDRB |= _BV(PB7); }
HAL void hal_light(bool on) {
  if (on) {
    PORTB |= _BV(PB7);
  } else {
    PORTB &= ~_BV(PB7);
  }
}

#endif
