// Registers of the RP2040 (datasheet, chapters 2 and 4) and of its Cortex-M0+, as far as used.
#ifndef RP2040_REGISTERS_H
#define RP2040_REGISTERS_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
// Aliases that set or clear bits.
#define SET(address) REGISTER((address) + 0x2000u)
#define CLEAR(address) REGISTER((address) + 0x3000u)
#define BIT(n) ((uint32_t)1 << (n))

#define SSI 0x18000000u
#define CLOCKS 0x40008000u
#define CLK_REF_CTRL (CLOCKS + 0x30u)
#define CLK_REF_SELECTED (CLOCKS + 0x38u)
#define CLK_SYS_CTRL (CLOCKS + 0x3cu)
#define CLK_SYS_SELECTED (CLOCKS + 0x44u)
#define CLK_PERI_CTRL (CLOCKS + 0x48u)
#define CLK_ADC_CTRL (CLOCKS + 0x60u)
#define RESETS 0x4000c000u
#define RESET_DONE (RESETS + 0x08u)
#define PSM_WDSEL (0x40010000u + 0x08u)
#define IO_BANK0 0x40014000u
#define PIN_CTRL(pin) (IO_BANK0 + 0x04u + 8u * (pin))
#define EDGES_8_TO_15 (IO_BANK0 + 0xf4u)
#define EDGES_16_TO_23 (IO_BANK0 + 0xf8u)
#define EDGE_INTERRUPTS_16_TO_23 (IO_BANK0 + 0x108u)
#define FUNCTION_UART 2u
#define FUNCTION_PWM 4u
#define FUNCTION_SIO 5u
#define FUNCTION_PIO0 6u
#define INVERT_INPUT BIT(16)
#define IO_QSPI_SS_CTRL (0x40018000u + 0x0cu)
#define PAD(pin) (0x4001c000u + 0x04u + 4u * (pin))
#define PAD_INPUT BIT(6)
#define PAD_NO_OUTPUT BIT(7)
#define PAD_PULL_UP BIT(3)
#define PAD_PULL_DOWN BIT(2)
#define PAD_SCHMITT BIT(1)
#define XOSC 0x40024000u
#define PLL_USB 0x4002c000u
#define UART0 0x40034000u
#define UART1 0x40038000u
#define UART_DR 0x00u
#define UART_FR 0x18u
#define UART_IBRD 0x24u
#define UART_FBRD 0x28u
#define UART_LCR 0x2cu
#define UART_CR 0x30u
#define UART_IFLS 0x34u
#define UART_IMSC 0x38u
#define UART_ICR 0x44u
#define FR_BUSY BIT(3)
#define FR_RX_EMPTY BIT(4)
#define FR_TX_FULL BIT(5)
#define DR_OVERRUN BIT(11)
#define INT_RX (BIT(4) | BIT(6))  // A part of the buffer is full, or bytes have ceased.
#define INT_TX BIT(5)
#define ADC 0x4004c000u
#define ADC_RESULT (ADC + 0x04u)
#define PWM(slice) (0x40050000u + 0x14u * (slice))
#define PWM_DIV 0x04u
#define PWM_CTR 0x08u
#define PWM_CC 0x0cu
#define PWM_TOP 0x10u
#define TIMER 0x40054000u
#define TIMER_ALARM0 (TIMER + 0x10u)
#define TIMER_ALARM1 (TIMER + 0x14u)
#define TIMER_RAW (TIMER + 0x28u)
#define TIMER_INTR (TIMER + 0x34u)
#define TIMER_INTE (TIMER + 0x38u)
#define WATCHDOG 0x40058000u
#define WATCHDOG_LOAD (WATCHDOG + 0x04u)
#define WATCHDOG_REASON (WATCHDOG + 0x08u)
#define WATCHDOG_TICK (WATCHDOG + 0x2cu)
#define CHIP_RESET (0x40064000u + 0x08u)
#define PIO0 0x50200000u
#define PIO_FSTAT (PIO0 + 0x04u)
#define PIO_RXF(machine) (PIO0 + 0x20u + 4u * (machine))
#define PIO_MEMORY(i) (PIO0 + 0x48u + 4u * (i))
#define PIO_SM(machine) (PIO0 + 0xc8u + 0x18u * (machine))
#define PIO_INTE (PIO0 + 0x12cu)
#define SIO 0xd0000000u
#define SIO_IN (SIO + 0x04u)
#define SIO_OUT_SET (SIO + 0x14u)
#define SIO_OUT_CLEAR (SIO + 0x18u)
#define SIO_ENABLE_SET (SIO + 0x24u)

#define SYSTICK 0xe000e010u
#define NVIC_ENABLE 0xe000e100u
#define NVIC_PEND 0xe000e200u
#define NVIC_PRIORITY(irq) (0xe000e400u + ((irq) & ~3u))  // One byte for each of four.
#define SYSTICK_PRIORITY 0xe000ed20u
enum { IRQ_TIMER0 = 0, IRQ_TIMER1 = 1, IRQ_PIO0 = 7, IRQ_PINS = 13, IRQ_UART0 = 20, IRQ_UART1 = 21 };

#endif
