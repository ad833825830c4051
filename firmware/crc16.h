// CRC of Protocol 2.0: polynomial 0x8005, most significant bit first, start 0.
#ifndef CRC16_H
#define CRC16_H

#include <stdint.h>

void crc16_start(void);
uint16_t crc16(uint16_t sum, const uint8_t *data, uint8_t length);

#endif
