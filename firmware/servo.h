// What a servo reports, whatever it speaks.
#ifndef SERVO_H
#define SERVO_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
  int32_t position;  // [step], 0 to 4095 in a turn.
  int32_t velocity;  // [step/s]
  int16_t current;   // [mA]
  uint8_t voltage;   // [0.1 V]
  uint8_t temperature;  // [deg C]
} servo_report_t;

typedef enum { REPLY_NONE, REPLY_OK, REPLY_FAULT, REPLY_BROKEN } reply_t;

// One protocol with the registers of its MX-64. Requests are written to the line and their length
// is returned; `receive` takes one byte and says whether the reply of servo `id` is complete.
typedef struct {
  uint8_t (*ping)(uint8_t *out, uint8_t id);
  uint8_t (*set_torque)(uint8_t *out, uint8_t id, bool on);
  // For position and velocity, or for all of a report.
  uint8_t (*ask)(uint8_t *out, uint8_t id, bool all);
  // `goals` of servos 1 to 6, those in `mask`; 0 when there are none.
  uint8_t (*set_goals)(uint8_t *out, uint8_t mask, const uint16_t *goals);
  reply_t (*receive)(uint8_t byte, uint8_t id);
  // Fills in what the reply to `ask` says; false when it is none.
  bool (*report)(servo_report_t *report);
  void (*listen)(void);  // Forgets what came before.
} protocol_t;

extern const protocol_t PROTOCOL_1, PROTOCOL_2;

#endif
