// Second stage of the boot: the boot ROM copies these 256 bytes to the end of memory, checks the
// CRC in the last four, and runs them. They make the flash readable with the plain read command
// (03h), which every chip has, copy the program to memory, and start it.
//
// The program runs in memory only, so that the flash can store the setup without stopping it.
// Registers: RP2040 datasheet, 4.10.13; no part of the Pico SDK.
  .syntax unified
  .cpu cortex-m0plus
  .thumb
  .section .boot2, "ax"

#define SSI 0x18000000
#define CTRLR0 0x00
#define CTRLR1 0x04
#define SSIENR 0x08
#define BAUDR 0x14

  .global boot2
  .type boot2, %function
boot2:
  ldr r3, =SSI
  movs r1, #0
  str r1, [r3, #SSIENR]
  movs r1, #2
  str r1, [r3, #BAUDR]  // Half the system clock.
  ldr r1, =(31 << 16) | (3 << 8)  // Frames of 32 bits; send a command, then receive.
  str r1, [r3, #CTRLR0]
  movs r1, #0
  str r1, [r3, #CTRLR1]
  ldr r1, =(0x03 << 24) | (2 << 8) | (6 << 2)  // Command of 8 bits, address of 24, no pause.
  ldr r2, =SSI + 0xf4  // SPI_CTRLR0
  str r1, [r2]
  movs r1, #1
  str r1, [r3, #SSIENR]

  ldr r0, =__program_in_flash
  ldr r1, =__program
  ldr r2, =__program_end
copy:
  ldmia r0!, {r3}
  stmia r1!, {r3}
  cmp r1, r2
  blo copy

  ldr r0, =__program  // The vector table: stack, then start.
  ldr r1, =0xe000ed08  // VTOR
  str r0, [r1]
  ldmia r0!, {r1, r2}
  msr msp, r1
  bx r2
  .pool
