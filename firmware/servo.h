// What a servo reports, whatever it speaks, and how it must be set.
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
  bool shut_down;    // It has taken its torque away.
} servo_report_t;

// A register with the values that it may have: with another the servo does not go where its goal
// is, as soon as it can. Neighbours are read together, with the first of them.
typedef struct {
  uint8_t address, size, read;
  int16_t least, most;
} setting_t;

typedef struct {
  uint16_t number;
  uint16_t current_unit;  // [mA / 256]
  const setting_t *settings;
  uint8_t count;
} servo_model_t;

// NULL when there is none of this number.
const servo_model_t *servo_model(uint16_t number);

typedef enum { REPLY_NONE, REPLY_OK, REPLY_FAULT, REPLY_BROKEN } reply_t;

// Neighbouring registers, none of them reserved: what a servo answers for those is not documented.
typedef struct {
  uint8_t address, size;
} registers_t;

// One protocol with the registers of its MX-64. Requests are written to the line and their length
// is returned; `receive` takes one byte and says whether the reply of servo `id` is complete.
typedef struct {
  uint8_t (*ping)(uint8_t *out, uint8_t id);
  uint8_t (*set_torque)(uint8_t *out, uint8_t id, bool on);
  uint8_t (*read)(uint8_t *out, uint8_t id, registers_t registers);
  // `goals` of the servos with the ids of the table, those in `mask`; 0 when there are none.
  uint8_t (*set_goals)(uint8_t *out, uint8_t mask, const uint16_t *goals);
  reply_t (*receive)(uint8_t byte, uint8_t id);
  // The registers in the reply to a `read` of `size`; NULL when it has another size.
  const uint8_t *(*data)(uint8_t size);
  // Fill in what the registers `moving` and `state` say.
  void (*report_moving)(const uint8_t *data, servo_report_t *report);
  void (*report_state)(const uint8_t *data, uint16_t current_unit, servo_report_t *report);
  void (*listen)(void);  // Forgets what came before.
  registers_t moving;    // Read in each cycle.
  registers_t state;     // Read now and then.
  registers_t torque;
} protocol_t;

extern const protocol_t PROTOCOL_1, PROTOCOL_2;

#endif
