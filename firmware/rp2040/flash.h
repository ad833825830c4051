// Non-volatile memory of 252 bytes in the last two sectors of a flash of 2 MB.
#ifndef RP2040_FLASH_H
#define RP2040_FLASH_H

// Reads the memory.
void flash_start(void);

// Call every millisecond: stores changes in the background.
void flash_tick(void);

#endif
