#include "host_line.h"

#include <string.h>

#include "hal.h"

// 256 bytes, so that an 8-bit index wraps automatically. If 256 bytes are pending, further bytes
// overwrite them, and their packets fail the CRC.
static uint8_t in[256], out[256];
static volatile uint8_t in_head, out_tail, status;
static uint8_t in_tail, out_head;

// Keep it short: on each of the two lines a byte arrives every 160 cycles, and two are buffered.
HAL_INTERRUPT(host_byte) {
  status |= hal_host_flags();
  uint8_t head = in_head;
  in[head] = hal_host_receive();
  in_head = head + 1;
  hal_wake();
}

HAL_INTERRUPT(host_empty) {
  uint8_t tail = out_tail;
  hal_host_send(out[tail++]);
  out_tail = tail;
  if (tail == out_head) hal_host_sending(false);
}

void host_line_start(void) { hal_host_start(); }

bool host_line_receive(uint8_t *byte) {
  if (in_tail == in_head) return false;
  *byte = in[in_tail++];
  return true;
}

bool host_line_waiting(void) { return in_tail != in_head; }

void host_line_send(const uint8_t *bytes, uint8_t length) {
  if ((uint8_t)(out_tail - out_head - 1) < length) return;
  uint16_t left = sizeof out - out_head;
  uint8_t first = length < left ? length : left;
  memcpy(out + out_head, bytes, first);
  memcpy(out, bytes + first, length - first);
  HAL_ATOMIC {
    out_head += length;
    hal_host_sending(true);
  }
}

bool host_line_overrun(void) {
  uint8_t seen = 0;
  HAL_ATOMIC {
    seen = status;
    status = 0;
  }
  return seen & HAL_OVERRUN;
}
