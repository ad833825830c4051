#include "servo_line.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "baud.h"
#include "clock.h"
#include "pins.h"

_Static_assert(BAUD_FITS(SERVO_BAUD), "SERVO_BAUD cannot be made of 16 MHz");

static uint8_t request[SERVO_LINE_ROOM];
static volatile uint8_t sent, length;
static volatile bool sending;

// As long as an index can count.
static uint8_t in[256];
static volatile uint8_t in_head;
static uint8_t in_tail;

#define SENDING (_BV(UDRIE1) | _BV(TXEN1))  // Deaf meanwhile: it would hear itself.
#define ENDING (_BV(TXCIE1) | _BV(TXEN1))
#define LISTENING (_BV(RXCIE1) | _BV(RXEN1) | _BV(TXEN1))

// As short as that of the other line. A byte that is broken breaks the sum of its packet.
ISR(USART1_RX_vect) {
  uint8_t head = in_head;
  in[head] = UDR1;
  in_head = head + 1;
  CLOCK_WAKE();
}

ISR(USART1_UDRE_vect) {
  uint8_t at = sent;
  if (at + 1 == length) {
    // A gap between bytes has raised this flag already; only the end of the last one counts.
    UCSR1A = _BV(U2X1) | _BV(TXC1);
    UCSR1B = ENDING;
  }
  UDR1 = request[at];
  sent = at + 1;
}

ISR(USART1_TX_vect) {
  BUS_PORT &= ~BUS_SEND;  // The servos wait two bits at least; this takes less.
  sending = false;
  UCSR1B = LISTENING;
  CLOCK_WAKE();
}

void servo_line_start(void) {
  BUS_DDR |= BUS_SEND;
  UCSR1A = _BV(U2X1);
  UBRR1 = BAUD_REGISTER(SERVO_BAUD);
  UCSR1C = _BV(UCSZ11) | _BV(UCSZ10);
  UCSR1B = LISTENING;
}

uint8_t *servo_line_request(void) { return request; }

void servo_line_send(uint8_t count) {
  in_tail = in_head;  // What is late belongs to an older request.
  sent = 0;
  length = count;
  sending = true;
  BUS_PORT |= BUS_SEND;
  UCSR1B = SENDING;
}

bool servo_line_sending(void) { return sending; }

bool servo_line_receive(uint8_t *byte) {
  if (in_tail == in_head) return false;
  *byte = in[in_tail++];
  return true;
}
