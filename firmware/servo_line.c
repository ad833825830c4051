#include "servo_line.h"

#include "hal.h"

static uint8_t request[SERVO_LINE_ROOM];
static volatile uint8_t sent, length;
static volatile bool sending;

// 256 bytes, so that an 8-bit index wraps.
static uint8_t in[256];
static volatile uint8_t in_head;
static uint8_t in_tail;

// As short as the interrupt of the other line. A corrupt byte fails the checksum of its packet.
HAL_INTERRUPT(bus_byte) {
  uint8_t head = in_head;
  in[head] = hal_bus_receive();
  in_head = head + 1;
  hal_wake();
}

HAL_INTERRUPT(bus_empty) {
  uint8_t at = sent;
  if (at + 1 == length) hal_bus_mode(BUS_ENDING);
  hal_bus_send(request[at]);
  sent = at + 1;
}

HAL_INTERRUPT(bus_sent) {
  hal_bus_drive(false);  // Servos wait at least two bits; this takes less.
  sending = false;
  hal_bus_mode(BUS_LISTENING);
  hal_wake();
}

void servo_line_start(void) { hal_bus_start(); }

uint8_t *servo_line_request(void) { return request; }

void servo_line_send(uint8_t count) {
  in_tail = in_head;  // Late bytes belong to an earlier request.
  sent = 0;
  length = count;
  sending = true;
  hal_bus_drive(true);
  hal_bus_mode(BUS_SENDING);
}

bool servo_line_sending(void) { return sending; }

bool servo_line_receive(uint8_t *byte) {
  if (in_tail == in_head) return false;
  *byte = in[in_tail++];
  return true;
}
