// Reports and required settings of servos, independent of the protocol.
#ifndef SERVO_H
#define SERVO_H

#include <stdbool.h>
#include <stdint.h>

typedef struct {
  int32_t position;  // [step], 4096 per turn.
  int32_t velocity;  // [step/s]
  int16_t current;   // [mA]
  uint8_t voltage;   // [0.1 V]
  uint8_t temperature;  // [deg C]
  bool shut_down;    // The servo has switched off its torque.
} servo_report_t;

// Register with its allowed values; with others, the servo would not move straight to its goal.
// Adjacent registers are read together, with the first of them.
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

// Returns NULL if the number is unknown.
const servo_model_t *servo_model(uint16_t number);

typedef enum { REPLY_NONE, REPLY_OK, REPLY_FAULT, REPLY_BROKEN } reply_t;

// Adjacent registers without reserved ones, whose response is not documented.
typedef struct {
  uint8_t address, size;
} registers_t;

// A protocol with the registers of its MX-64. Requests are written to a buffer, and their length is
// returned; `receive` takes a byte and returns whether the reply of servo `id` is complete.
typedef struct {
  uint8_t (*ping)(uint8_t *out, uint8_t id);
  uint8_t (*set_torque)(uint8_t *out, uint8_t id, bool on);
  uint8_t (*read)(uint8_t *out, uint8_t id, registers_t registers);
  // Goals of the servos in `mask`, with the ids of the table; 0 if `mask` is empty.
  uint8_t (*set_goals)(uint8_t *out, uint8_t mask, const uint16_t *goals);
  reply_t (*receive)(uint8_t byte, uint8_t id);
  // Registers in the reply to a `read` of `size`, or NULL if its size differs.
  const uint8_t *(*data)(uint8_t size);
  // Fill in the values of the registers `moving` and `state`.
  void (*report_moving)(const uint8_t *data, servo_report_t *report);
  void (*report_state)(const uint8_t *data, uint16_t current_unit, servo_report_t *report);
  void (*listen)(void);  // Discards previous bytes.
  registers_t moving;    // Read in each cycle.
  registers_t state;     // Read occasionally.
  registers_t torque;
} protocol_t;

extern const protocol_t PROTOCOL_1, PROTOCOL_2;

#endif
