#include <stddef.h>

#include "servo.h"
#include "servo_models.h"

const servo_model_t *servo_model(uint16_t number) {
  for (uint8_t i = 0; i < sizeof MODELS / sizeof MODELS[0]; i++) {
    if (MODELS[i].number == number) return &MODELS[i];
  }
  return NULL;
}
