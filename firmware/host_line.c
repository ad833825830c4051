#include "host_line.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <string.h>
#include <util/atomic.h>

#include "baud.h"
#include "clock.h"

_Static_assert(BAUD_FITS(HOST_BAUD), "HOST_BAUD cannot be made of 16 MHz");

// As long as an index can count: it wraps by itself. Bytes that come while 256 wait spoil those,
// and the sums of their packets with them.
static uint8_t in[256], out[256];
static volatile uint8_t in_head, out_tail, status;
static uint8_t in_tail, out_head;

// Short: a byte comes every 160 cycles, on this line and on that of the servos, and two wait.
ISR(USART0_RX_vect) {
  status |= UCSR0A;
  uint8_t head = in_head;
  in[head] = UDR0;
  in_head = head + 1;
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

bool host_line_waiting(void) { return in_tail != in_head; }

bool host_line_send(const uint8_t *bytes, uint8_t length) {
  if ((uint8_t)(out_tail - out_head - 1) < length) return false;
  uint16_t left = sizeof out - out_head;
  uint8_t first = length < left ? length : left;
  memcpy(out + out_head, bytes, first);
  memcpy(out, bytes + first, length - first);
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    out_head += length;
    UCSR0B |= _BV(UDRIE0);
  }
  return true;
}

bool host_line_overrun(void) {
  uint8_t seen = 0;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    seen = status;
    status = 0;
  }
  return seen & _BV(DOR0);
}
