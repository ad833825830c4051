#include "host_line.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "baud.h"
#include "clock.h"

_Static_assert(BAUD_FITS(HOST_BAUD), "HOST_BAUD cannot be made of 16 MHz");

// As long as an index can count: it wraps by itself.
static uint8_t in[256], out[256];
static volatile uint8_t in_head, out_tail, lost;
static uint8_t in_tail, out_head;

ISR(USART0_RX_vect) {
  uint8_t status = UCSR0A;
  uint8_t head = in_head;
  in[head++] = UDR0;
  if (status & (_BV(FE0) | _BV(DOR0))) lost++;
  if (head == in_tail) {
    lost++;
  } else {
    in_head = head;
  }
  CLOCK_WAKE();
}

ISR(USART0_UDRE_vect) {
  uint8_t tail = out_tail;
  UDR0 = out[tail++];
  out_tail = tail;
  if (tail == out_head) UCSR0B &= ~_BV(UDRIE0);
}

void host_line_start(void) {
  UCSR0A = _BV(U2X0);
  UBRR0 = BAUD_REGISTER(HOST_BAUD);
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

bool host_line_receive(uint8_t *byte) {
  if (in_tail == in_head) return false;
  *byte = in[in_tail++];
  return true;
}

bool host_line_send(const uint8_t *bytes, uint8_t length) {
  if ((uint8_t)(out_tail - out_head - 1) < length) return false;
  for (uint8_t i = 0; i < length; i++) out[(uint8_t)(out_head + i)] = bytes[i];
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    out_head += length;
    UCSR0B |= _BV(UDRIE0);
  }
  return true;
}

uint8_t host_line_lost(void) {
  uint8_t count = 0;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    count = lost;
    lost = 0;
  }
  return count;
}
