// Implementation of hal.h on the RP2040 at 48 MHz. README.md lists the pins.
#include "../hal.h"

#include "../main.h"
#include "../crc16.h"
#include "../esc.h"
#include "../watchdog.h"
#include "flash.h"
#include "registers.h"

#define PIN_BUS_DIRECTION 6u
#define PIN_WHEEL 13u     // To 15.
#define PIN_RECEIVER 16u  // To 21.
#define PIN_RADIO 22u
#define PIN_LIGHT 25u
#define PIN_ADC 26u  // Battery, drive, reference.
static const uint8_t PINS_UART[] = {0, 1, 4, 5};
static const uint8_t PINS_ESC[] = {8, 10, 12};  // Output A of slices 4, 5, 6.
#define SLICE_ESC 4u
#define SLICE_CLOCK 3u
#define ESC_PERIOD 40000u

#define HZ 48000000u
#define DIVISOR(baud) ((HZ * 4u + (baud) / 2u) / (baud))  // In 1/64.
#define DIVISOR_FITS(baud)                                   \
  (DIVISOR(baud) >= 64u && (HZ * 4u) / DIVISOR(baud) * 40u > (baud)*39u && \
   (HZ * 4u) / DIVISOR(baud) * 40u < (baud)*41u)
_Static_assert(DIVISOR_FITS(HOST_BAUD), "HOST_BAUD cannot be made of 48 MHz");
_Static_assert(DIVISOR_FITS(SERVO_BAUD), "SERVO_BAUD cannot be made of 48 MHz");
#define BUS_BYTE_US (10000000u / SERVO_BAUD)

static void use_pin(uint32_t pin, uint32_t function, uint32_t pulls) {
  REGISTER(PAD(pin)) = PAD_INPUT | PAD_SCHMITT | BIT(4) | pulls;
  REGISTER(PIN_CTRL(pin)) = function;
}

uint32_t hal_lock(void) {
  uint32_t before;
  __asm volatile("mrs %0, primask\n cpsid i" : "=r"(before)::"memory");
  return before;
}

void hal_unlock(uint32_t before) { __asm volatile("msr primask, %0" ::"r"(before) : "memory"); }

void hal_clock_start(void) {
  REGISTER(PWM(SLICE_CLOCK) + PWM_DIV) = HZ / 2000000u << 4;
  REGISTER(PWM(SLICE_CLOCK) + PWM_TOP) = 0xffff;
  REGISTER(PWM(SLICE_CLOCK)) = 1;
  // Edges of the receiver are timed when their interrupt runs, and the bus is released by the timer's:
  // neither waits for the UARTs, which fill a buffer in 30 us. The wheel sensors wait for these, and the
  // tick, which serves the flash, for all.
  REGISTER(NVIC_PRIORITY(IRQ_UART0)) = 0x4040u;
  REGISTER(NVIC_PRIORITY(IRQ_TIMER1)) = 0x8000u;
  REGISTER(SYSTICK_PRIORITY) = 3u << 30;
  REGISTER(SYSTICK + 4u) = HZ / 1000u - 1u;
  REGISTER(SYSTICK + 8u) = 0;
  REGISTER(SYSTICK) = 7;
}

uint16_t hal_half_us(void) { return REGISTER(PWM(SLICE_CLOCK) + PWM_CTR); }

void hal_interrupts_start(void) { __asm volatile("cpsie i" ::: "memory"); }

static volatile bool awake;

void hal_wake(void) { awake = true; }

void hal_sleep(void) {
  uint32_t before = hal_lock();
  if (!awake) __asm volatile("wfi" ::: "memory");  // A pending interrupt ends it, and runs below.
  awake = false;
  hal_unlock(before);
}

static void start_uart(uint32_t uart, uint32_t divisor) {
  REGISTER(uart + UART_IBRD) = divisor >> 6;
  REGISTER(uart + UART_FBRD) = divisor & 63u;
  REGISTER(uart + UART_LCR) = 3u << 5 | BIT(4);  // 8 bits, with buffers of 32 bytes.
  REGISTER(uart + UART_IFLS) = 0;
  REGISTER(uart + UART_CR) = BIT(9) | BIT(8) | BIT(0);
}

// The line to the PC. The transmit interrupt reports that the buffer has drained, not that it is
// empty, so the first byte needs a call.
static volatile bool host_sending;
static uint32_t host_received;

void hal_host_start(void) {
  use_pin(PINS_UART[0], FUNCTION_UART, 0);
  use_pin(PINS_UART[1], FUNCTION_UART, PAD_PULL_UP);
  start_uart(UART0, DIVISOR(HOST_BAUD));
  REGISTER(UART0 + UART_IMSC) = INT_RX;
  REGISTER(NVIC_ENABLE) = BIT(IRQ_UART0);
}

uint8_t hal_host_flags(void) {
  host_received = REGISTER(UART0 + UART_DR);
  return (host_received & DR_OVERRUN) ? HAL_OVERRUN : 0;
}

uint8_t hal_host_receive(void) { return host_received; }
void hal_host_send(uint8_t byte) { REGISTER(UART0 + UART_DR) = byte; }

void hal_host_sending(bool on) {
  host_sending = on;
  REGISTER(UART0 + UART_IMSC) = on ? INT_RX | INT_TX : INT_RX;
  if (on) REGISTER(NVIC_PEND) = BIT(IRQ_UART0);
}

static void on_uart0(void) {
  while (!(REGISTER(UART0 + UART_FR) & FR_RX_EMPTY)) hal_interrupt_host_byte();
  while (host_sending && !(REGISTER(UART0 + UART_FR) & FR_TX_FULL)) hal_interrupt_host_empty();
}

// The servo bus. The UART has no interrupt for the end of the last byte: a timer looks at it from
// the moment when it is due.
static volatile bool bus_sending, bus_ending;
static uint32_t bus_end_us;

void hal_bus_drive(bool on) {
  REGISTER(on ? SIO_OUT_SET : SIO_OUT_CLEAR) = BIT(PIN_BUS_DIRECTION);
}

static void look_at_bus(uint32_t at_us) {
  uint32_t soon_us = REGISTER(TIMER_RAW) + 3u;
  REGISTER(TIMER_ALARM0) = (int32_t)(at_us - soon_us) > 0 ? at_us : soon_us;
}

void hal_bus_mode(hal_bus_t mode) {
  if (mode == BUS_SENDING) {
    CLEAR(UART1 + UART_CR) = BIT(9);
    bus_end_us = REGISTER(TIMER_RAW);
    bus_sending = true;
    REGISTER(UART1 + UART_ICR) = INT_TX;  // From the previous request.
    REGISTER(UART1 + UART_IMSC) = INT_TX;
    REGISTER(NVIC_PEND) = BIT(IRQ_UART1);
  }
  if (mode == BUS_ENDING) bus_ending = true;
  if (mode == BUS_LISTENING) {
    while (!(REGISTER(UART1 + UART_FR) & FR_RX_EMPTY)) (void)REGISTER(UART1 + UART_DR);
    SET(UART1 + UART_CR) = BIT(9);
    REGISTER(UART1 + UART_IMSC) = INT_RX;
  }
}

void hal_bus_start(void) {
  use_pin(PIN_BUS_DIRECTION, FUNCTION_SIO, PAD_PULL_DOWN);
  REGISTER(SIO_OUT_CLEAR) = BIT(PIN_BUS_DIRECTION);
  REGISTER(SIO_ENABLE_SET) = BIT(PIN_BUS_DIRECTION);
  use_pin(PINS_UART[2], FUNCTION_UART, 0);
  use_pin(PINS_UART[3], FUNCTION_UART, PAD_PULL_UP);
  start_uart(UART1, DIVISOR(SERVO_BAUD));
  hal_bus_mode(BUS_LISTENING);
  SET(TIMER_INTE) = BIT(0);
  REGISTER(NVIC_ENABLE) = BIT(IRQ_UART1) | BIT(IRQ_TIMER0);
}

uint8_t hal_bus_receive(void) { return REGISTER(UART1 + UART_DR); }

void hal_bus_send(uint8_t byte) {
  uint32_t now_us = REGISTER(TIMER_RAW);
  REGISTER(UART1 + UART_DR) = byte;
  if ((int32_t)(now_us - bus_end_us) > 0) bus_end_us = now_us;
  bus_end_us += BUS_BYTE_US;
  if (!bus_ending) return;
  bus_sending = bus_ending = false;
  REGISTER(UART1 + UART_IMSC) = 0;
  look_at_bus(bus_end_us);
}

static void on_uart1(void) {
  if (bus_sending) {
    while (bus_sending && !(REGISTER(UART1 + UART_FR) & FR_TX_FULL)) hal_interrupt_bus_empty();
  } else {
    while (!(REGISTER(UART1 + UART_FR) & FR_RX_EMPTY)) hal_interrupt_bus_byte();
  }
}

static void on_timer0(void) {
  REGISTER(TIMER_INTR) = BIT(0);
  if (REGISTER(UART1 + UART_FR) & FR_BUSY) {
    look_at_bus(REGISTER(TIMER_RAW));
  } else {
    hal_interrupt_bus_sent();
  }
}

void hal_esc_start(uint16_t half_us) {
  for (uint32_t i = 0; i < 3; i++) {
    uint32_t slice = PWM(SLICE_ESC + i);
    REGISTER(slice + PWM_DIV) = HZ / 2000000u << 4;
    REGISTER(slice + PWM_TOP) = ESC_PERIOD - 1u;
    REGISTER(slice + PWM_CC) = half_us;
    use_pin(PINS_ESC[i], FUNCTION_PWM, PAD_PULL_DOWN);
  }
  for (uint32_t i = 0; i < 3; i++) {
    REGISTER(PWM(SLICE_ESC + i) + PWM_CTR) = ESC_PERIOD - 1u;  // The first pulse starts at once.
    REGISTER(PWM(SLICE_ESC + i)) = 1;
  }
}

uint16_t hal_esc_phase(void) { return REGISTER(PWM(SLICE_ESC) + PWM_CTR); }

void hal_esc_put(uint8_t i, uint16_t half_us) {
  REGISTER(PWM(SLICE_ESC + i) + PWM_CC) = half_us;
}

// Receiver: six wires with pulses, or SBUS, whose inverted line a state machine of PIO0 reads: from
// the start bit, ten bits in the middle of each: data, parity, first stop bit.
static const uint16_t RADIO_PROGRAM[] = {
    0x2020,  // wait 0 pin 0
    0xea29,  // set x, 9 [10]
    0x4001,  // in pins, 1
    0x0642,  // jmp x-- 2 [6]
    0x8000,  // push noblock
};
#define RADIO_BIT_CYCLES 8u
#define RADIO_BAUD 100000u
static uint32_t radio_received;

void hal_receiver_start(void) {
  for (uint32_t i = 0; i < 6; i++) use_pin(PIN_RECEIVER + i, FUNCTION_SIO, PAD_PULL_UP);
  REGISTER(EDGES_16_TO_23) = 0xccccccu;
  REGISTER(EDGE_INTERRUPTS_16_TO_23) = 0xccccccu;
  use_pin(PIN_RADIO, FUNCTION_PIO0 | INVERT_INPUT, PAD_PULL_DOWN);
  for (uint32_t i = 0; i < sizeof RADIO_PROGRAM / 2u; i++) REGISTER(PIO_MEMORY(i)) = RADIO_PROGRAM[i];
  REGISTER(PIO_SM(0u)) = HZ / (RADIO_BAUD * RADIO_BIT_CYCLES) << 16;
  REGISTER(PIO_SM(0u) + 0x04u) = 4u << 12;             // Wrap after the fifth instruction.
  REGISTER(PIO_SM(0u) + 0x08u) = BIT(31) | BIT(18);    // Buffer of eight, shift right.
  REGISTER(PIO_SM(0u) + 0x14u) = PIN_RADIO << 15;
  REGISTER(PIO_INTE) = BIT(0);
  SET(PIO0) = BIT(0);
  REGISTER(NVIC_ENABLE) = BIT(IRQ_PINS) | BIT(IRQ_PIO0);
}

uint8_t hal_receiver_pins(void) { return REGISTER(SIO_IN) >> PIN_RECEIVER & HAL_RECEIVER_PINS; }

static void on_pins(void) {
  REGISTER(EDGES_16_TO_23) = 0xccccccu;
  hal_interrupt_receiver();
}

// Falling edges of the wheel sensors, which the chip keeps.
#define EDGE_DOWN(i) BIT(4u * (PIN_WHEEL - 8u + (i)) + 2u)
#define WHEEL_EDGES (EDGE_DOWN(0u) | EDGE_DOWN(1u) | EDGE_DOWN(2u))

uint16_t hal_wheels_next(void) {
  REGISTER(TIMER_ALARM1) = REGISTER(TIMER_RAW) + HAL_WHEEL_US;
  return hal_half_us();
}

uint8_t hal_wheels_take(void) {
  uint32_t edges = REGISTER(EDGES_8_TO_15) & WHEEL_EDGES;
  REGISTER(EDGES_8_TO_15) = edges;
  uint8_t wheels = 0;
  for (uint32_t i = 0; i < 3u; i++) {
    if (edges & EDGE_DOWN(i)) wheels |= BIT(i);
  }
  return wheels;
}

void hal_wheels_start(void) {
  for (uint32_t i = 0; i < 3u; i++) use_pin(PIN_WHEEL + i, FUNCTION_SIO, PAD_PULL_UP);
  (void)hal_wheels_take();
  SET(TIMER_INTE) = BIT(1);
  REGISTER(NVIC_ENABLE) = BIT(IRQ_TIMER1);
  (void)hal_wheels_next();
}

void hal_wheels_stop(void) { CLEAR(TIMER_INTE) = BIT(1); }

// Telemetry of the speed controllers, at the same pins, without a pause between bytes: state machines 1 to 3
// of PIO0 wait for the next start bit a quarter of a bit after the middle of the stop bit. Their buffers
// hold eight bytes, 690 us, until they are taken.
static const uint16_t TELEMETRY_PROGRAM[] = {
    0x2020,  // wait 0 pin 0
    0xe927,  // set x, 7 [9]
    0x4001,  // in pins, 1
    0x0647,  // jmp x-- 7 [6]
    0x4001,  // in pins, 1
    0x8000,  // push noblock
};
#define TELEMETRY_AT 5u  // Behind the program for SBUS.
#define TELEMETRY_CYCLES (115200u * 8u)
#define TELEMETRY_MACHINES (BIT(1) | BIT(2) | BIT(3))

void hal_telemetry_start(void) {
  for (uint32_t i = 0; i < sizeof TELEMETRY_PROGRAM / 2u; i++) {
    REGISTER(PIO_MEMORY(TELEMETRY_AT + i)) = TELEMETRY_PROGRAM[i];
  }
  for (uint32_t i = 0; i < 3u; i++) {
    uint32_t machine = PIO_SM(1u + i);
    use_pin(PIN_WHEEL + i, FUNCTION_SIO, PAD_PULL_UP);
    REGISTER(machine) = HZ / TELEMETRY_CYCLES << 16 | (HZ % TELEMETRY_CYCLES * 256u / TELEMETRY_CYCLES) << 8;
    REGISTER(machine + 0x04u) = (TELEMETRY_AT + 5u) << 12 | TELEMETRY_AT << 7;
    REGISTER(machine + 0x08u) = BIT(31) | BIT(18);  // Buffer of eight, shift right.
    REGISTER(machine + 0x14u) = (PIN_WHEEL + i) << 15;
    REGISTER(machine + 0x10u) = TELEMETRY_AT;  // Jump there.
    while (hal_telemetry_take(i) >= 0) {
    }
  }
  SET(PIO0) = TELEMETRY_MACHINES;
  SET(TIMER_INTE) = BIT(1);
  REGISTER(NVIC_ENABLE) = BIT(IRQ_TIMER1);
  (void)hal_wheels_next();
}

void hal_telemetry_stop(void) {
  CLEAR(TIMER_INTE) = BIT(1);
  CLEAR(PIO0) = TELEMETRY_MACHINES;
}

int16_t hal_telemetry_take(uint8_t i) {
  if (REGISTER(PIO_FSTAT) & BIT(9u + i)) return -1;
  uint32_t bits = REGISTER(PIO_RXF(1u + i)) >> 23;
  bool stop = bits & BIT(8);
  return (bits & 0xffu) | (stop ? 0u : HAL_TELEMETRY_BROKEN);
}

static void on_timer1(void) {
  REGISTER(TIMER_INTR) = BIT(1);
  hal_interrupt_wheels();
}

uint8_t hal_radio_flags(void) {
  radio_received = REGISTER(PIO_RXF(0u)) >> 22;
  uint32_t ones = radio_received & 0x1ffu;
  ones ^= ones >> 4 ^ ones >> 8;
  bool odd = 0x6996u >> (ones & 0xfu) & 1u;
  bool stop = radio_received & BIT(9);
  return (odd ? 0x04 : 0) | (stop ? 0 : 0x10);
}

uint8_t hal_radio_receive(void) { return radio_received; }

static void on_pio0(void) {
  while (!(REGISTER(PIO_FSTAT) & BIT(8))) hal_interrupt_radio_byte();
}

// The converter has no input for ground: while ADC_GROUND is selected, for a millisecond, resistors
// in the chip pull the others down.
void hal_adc_start(void) {
  for (uint32_t i = 0; i < 3; i++) REGISTER(PAD(PIN_ADC + i)) = PAD_NO_OUTPUT;
  REGISTER(ADC) = BIT(0);
}

void hal_adc_convert(hal_adc_t input) {
  uint32_t pulls = PAD_NO_OUTPUT | (input == ADC_GROUND ? PAD_PULL_DOWN : 0u);
  REGISTER(PAD(PIN_ADC)) = REGISTER(PAD(PIN_ADC + 1u)) = pulls;
  uint32_t channel = input == ADC_DRIVE ? 1u : input == ADC_BANDGAP ? 2u : 0u;
  REGISTER(ADC) = channel << 12 | BIT(2) | BIT(0);
}

bool hal_adc_busy(void) { return !(REGISTER(ADC) & BIT(8)); }
uint16_t hal_adc_value(void) { return REGISTER(ADC_RESULT) >> 2; }

// The watchdog counts two per microsecond (erratum E1), and resets everything but the oscillators.
#define WATCHDOG_COUNT (HAL_WATCHDOG_MS * 2000u)
void hal_watchdog_start(void) {
  REGISTER(PSM_WDSEL) = 0x1fffcu;
  REGISTER(WATCHDOG_LOAD) = WATCHDOG_COUNT;
  REGISTER(WATCHDOG) = BIT(30);
}

void hal_watchdog_kick(void) { REGISTER(WATCHDOG_LOAD) = WATCHDOG_COUNT; }

// The chip does not tell a brown-out from power-on.
uint8_t hal_reset_cause(void) {
  if (REGISTER(WATCHDOG_REASON)) return HAL_CAUSE_WATCHDOG;
  return (REGISTER(CHIP_RESET) & BIT(8)) ? HAL_CAUSE_POWER : 0x02;
}

void hal_light_start(void) {
  use_pin(PIN_LIGHT, FUNCTION_SIO, 0);
  REGISTER(SIO_ENABLE_SET) = BIT(PIN_LIGHT);
}

void hal_light(bool on) { REGISTER(on ? SIO_OUT_SET : SIO_OUT_CLEAR) = BIT(PIN_LIGHT); }

static void on_tick(void) {
  hal_interrupt_tick();
  flash_tick();
}

// The clock of everything is 48 MHz: 12 MHz times 100, divided by 25.
static void start_clocks(void) {
  REGISTER(XOSC) = 0xaa0;
  REGISTER(XOSC + 0x0cu) = 94;  // Start-up of 2 ms.
  SET(XOSC) = 0xfabu << 12;
  while (!(REGISTER(XOSC + 0x04u) & BIT(31))) {
  }
  REGISTER(CLK_REF_CTRL) = 2;
  while (!(REGISTER(CLK_REF_SELECTED) & BIT(2))) {
  }
  REGISTER(WATCHDOG_TICK) = BIT(9) | 12u;
  uint32_t used = BIT(0) | BIT(5) | BIT(8) | BIT(10) | BIT(13) | BIT(14) | BIT(21) | BIT(22) | BIT(23);
  CLEAR(RESETS) = used;
  while ((REGISTER(RESET_DONE) & used) != used) {
  }
  REGISTER(PLL_USB) = 1;
  REGISTER(PLL_USB + 0x08u) = 100;
  CLEAR(PLL_USB + 0x04u) = BIT(0) | BIT(5);
  while (!(REGISTER(PLL_USB) & BIT(31))) {
  }
  REGISTER(PLL_USB + 0x0cu) = 5u << 16 | 5u << 12;
  CLEAR(PLL_USB + 0x04u) = BIT(3);
  REGISTER(CLK_SYS_CTRL) = 1u << 5;
  REGISTER(CLK_SYS_CTRL) = 1u << 5 | 1u;
  while (!(REGISTER(CLK_SYS_SELECTED) & BIT(1))) {
  }
  REGISTER(CLK_PERI_CTRL) = BIT(11);
  REGISTER(CLK_ADC_CTRL) = BIT(11);
}

extern uint32_t __bss[], __bss_end[], __stack[];

static void start(void) {
  __asm volatile("cpsid i" ::: "memory");
  start_clocks();
  watchdog_start();
  esc_start();
  for (uint32_t *word = __bss; word < __bss_end; word++) *word = 0;
  crc16_start();
  flash_start();
  main_start();
  while (true) main_turn();
}

// Without the safety rules the watchdog resets the chip.
static void hang(void) {
  while (true) {
  }
}

typedef void (*vector_t)(void);
__attribute__((section(".vectors"), used)) static const vector_t VECTORS[16 + 26] = {
    [0] = (vector_t)__stack, [1] = start,  [2] = hang,
    [3] = hang,              [11] = hang,  [14] = hang,
    [15] = on_tick,          [16 + IRQ_TIMER0] = on_timer0,
    [16 + IRQ_TIMER1] = on_timer1,
    [16 + IRQ_PIO0] = on_pio0, [16 + IRQ_PINS] = on_pins,
    [16 + IRQ_UART0] = on_uart0, [16 + IRQ_UART1] = on_uart1,
};
