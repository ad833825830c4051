// The RP2040 and its environment in virtual time, for simulator/rp2040_board.py: commands as lines
// of JSON on standard input; each answer is the state of the board. rp2040js executes the
// program and has the peripherals; here are the boot ROM's work, the flash chip, the timing of the
// UARTs, resets, and the devices at the pins.
//
//   node board.js IMAGE MODE_ADDRESS HOST_BAUD SERVO_BAUD
import { readFileSync, readSync, writeSync } from "node:fs";
import { RP2040 } from "rp2040js";

const [IMAGE, MODE_ADDRESS, HOST_BAUD, SERVO_BAUD] = [
  readFileSync(process.argv[2]),
  ...process.argv.slice(3, 6).map(Number),
];
const RAM = 0x20000000;
const SECOND_STAGE = 0x20041f00;
const FLASH_SIZE = 2 << 20;
const POWER_ON = 1;
const BROWN_OUT = 4;
const WATCHDOG = 8;
const DIRECTION = 6;
const ESCS = [8, 10, 12];
const WHEELS = 13;
const WIRES = 16;
const RADIO = 22;
const LIGHT = 25;
const TIMER_NS = 2 ** 31 * 1e3 - 1e9; // The chip's timer passes half its range after a second.
const US = 1e3;
const MS = 1e6;
const FRAME = 20 * MS;
const SBUS_FRAME = 14 * MS;
const RADIO_BIT = 10 * US;
const TELEMETRY_BIT = 1e9 / 115200;
const BIT_CYCLES = 8;
const REFERENCE_V = 1.1;
const TX_ROOM = 32;
const TX_LEVEL = 4;

/** Flash chip behind the serial interface: read, program, erase a sector, status. */
class Flash {
  bytes = new Uint8Array(FLASH_SIZE).fill(0xff);
  #busyUntil = 0;
  #enabled = false;
  #sent = [];
  #answers = [];
  #selected = false;

  select(on) {
    if (this.#selected && !on) this.#execute();
    if (on) this.#sent = [];
    this.#selected = on;
  }

  exchange(byte) {
    const at = this.#sent.push(byte) - 1;
    const [command, ...rest] = this.#sent;
    const address = (rest[0] << 16) | (rest[1] << 8) | rest[2];
    let answer = 0xff;
    if (command === 0x05 && at > 0) answer = now() < this.#busyUntil ? 1 : 0;
    if (command === 0x03 && at > 3 && now() >= this.#busyUntil) {
      answer = this.bytes[(address + at - 4) % FLASH_SIZE];
    }
    this.#answers.push(answer);
  }

  read() {
    return this.#answers.shift() ?? 0;
  }

  get waiting() {
    return this.#answers.length;
  }

  #execute() {
    const [command, ...rest] = this.#sent;
    const address = (rest[0] << 16) | (rest[1] << 8) | rest[2];
    if (now() < this.#busyUntil) return;
    if (command === 0x06) this.#enabled = true;
    if (!this.#enabled) return;
    if (command === 0x02) {
      const page = address & ~0xff;
      rest.slice(3).forEach((byte, i) => (this.bytes[page | ((address + i) & 0xff)] &= byte));
      this.#busyUntil = now() + 0.7 * MS;
    }
    if (command === 0x20) {
      this.bytes.fill(0xff, address & ~0xfff, (address & ~0xfff) + 4096);
      this.#busyUntil = now() + 45 * MS;
    }
    if (command !== 0x06) this.#enabled = false;
  }
}

class Logger {
  debug() {}
  info() {}
  warn() {}
  error(name, text) {
    throw new Error(`${name}: ${text}`);
  }
}

const flash = new Flash();
flash.bytes.set(IMAGE);
let rp = null; // The chip, or null without power.
let start = 0; // Time of its last reset. [ns]
let idle = 0; // Time without a chip. [ns]
let resets = 0;
let hung = false;
let wantsReset = false;
let memory = new Uint8Array(264 << 10).fill(0xa5);
const escs = ESCS.map(() => ({ count: 0, width: 0, widest: 0, first: 0, rise: 0, fall: -1e12 }));
const faults = [0, 0, 0, 0]; // Stray bytes, cut requests, collisions, bytes the board did not hear.
let turnAround = 0;
const toHost = [];
let fromHost = [];
let fromHostFree = 0;
let supply = 1;
let inputs = [0, 0];
let pulses = [0, 0, 0, 0, 0, 0];
let parallel = false;
const wheels = ESCS.map(() => ({ period: 0, due: 0 })); // Period, and time of the next pulse [ns]
let sbus = false;
let sbusFlags = 0;
let request = [];
let onBus = { until: 0, count: 0 };
let radioFree = 0;
let telemetryFree = [0, 0, 0];

function now() {
  return rp ? start + rp.clock.nanos - TIMER_NS : idle;
}

function chipClock() {
  const { clock } = new RP2040();
  clock.nextAlarm = null;
  clock.nanosCounter = TIMER_NS;
  return clock;
}

function after(nanos, call) {
  rp.clock.createAlarm(call).schedule(Math.max(0, nanos));
}

/** As the boot ROM: check the second stage, copy it to memory, run it. */
function boot() {
  let crc = 0xffffffff;
  for (const byte of flash.bytes.subarray(0, 252)) {
    crc ^= byte << 24;
    for (let i = 0; i < 8; i++) crc = (crc << 1) ^ (crc < 0 ? 0x04c11db7 : 0);
  }
  const stage = new DataView(flash.bytes.buffer, 0, 256);
  if (crc >>> 0 !== stage.getUint32(252, true)) throw new Error("boot: the checksum is wrong");
  rp.sram.set(flash.bytes.subarray(0, 256), SECOND_STAGE - RAM);
  rp.core.SP = SECOND_STAGE;
  rp.core.PC = SECOND_STAGE;
}

function power(cause) {
  start = now();
  if (rp) memory = rp.sram;
  rp = new RP2040(chipClock());
  rp.logger = new Logger();
  rp.sram.set(memory);
  rp.flash.set(flash.bytes);
  hung = wantsReset = false;
  const quiet = { readUint32: () => 0, writeUint32() {}, writeUint32Atomic() {} };
  const flags = cause & (POWER_ON | BROWN_OUT) ? 1 << 8 : cause === WATCHDOG ? 0 : 1 << 16;
  rp.peripherals[0x40064] = { ...quiet, readUint32: (at) => (at === 8 ? flags : 0) };
  rp.peripherals[0x40018] = {
    ...quiet,
    writeUint32Atomic: (at, value) => at === 0x0c && flash.select(((value >> 8) & 3) === 2),
  };
  rp.peripherals[0x18000] = {
    ...quiet,
    readUint32: (at) => (at === 0x60 ? flash.read() : at === 0x28 && flash.waiting ? 8 : 0),
    writeUint32Atomic: (at, value) => at === 0x60 && flash.exchange(value & 0xff),
  };
  const watchdog = rp.peripherals[0x40058];
  watchdog.reason = cause === WATCHDOG ? 1 : 0;
  watchdog.onWatchdogTrigger = () => {
    watchdog.alarm.enable = false; // It would expire again at the same time.
    wantsReset = true;
  };
  connectUart(rp.uart[0], HOST_BAUD, (byte, end) => toHost.push({ byte, end }));
  connectUart(rp.uart[1], SERVO_BAUD, sendOnBus);
  rp.gpio[DIRECTION].addListener((value) => turnBus(value === 1));
  ESCS.forEach((pin, i) => rp.gpio[pin].addListener((value) => onPulse(escs[i], value === 1)));
  rp.pio[0].run = () => {};
  // As the chip with the bit that joins both buffers of a machine, which rp2040js ignores.
  for (const machine of rp.pio[0].machines) machine.rxFIFO = new machine.rxFIFO.constructor(8);
  correctInterrupts();
  request = [];
  onBus = { until: 0, count: 0 };
  fromHost = [];
  radioFree = 0;
  telemetryFree = [0, 0, 0];
  ESCS.forEach((_, i) => after(0, () => rp.gpio[WHEELS + i].setInputValue(true)));
  for (let i = 0; i < 6; i++) after(0, () => rp.gpio[WIRES + i].setInputValue(pulses[i] === 0));
  putVoltages();
  const chip = rp;
  const frames = () => {
    if (chip !== rp) return;
    sendPulses();
    after(FRAME, frames);
  };
  const sbusFrames = () => {
    if (chip !== rp) return;
    if (sbus && pulses.some(Boolean)) sendRadio(sbusFrame(), 0);
    after(SBUS_FRAME, sbusFrames);
  };
  wheels.forEach(planWheel);
  after(FRAME, frames);
  after(SBUS_FRAME, sbusFrames);
  boot();
}

/**
 * As the processor: an interrupt that the program pends is pending until it is taken; and with
 * interrupts disabled, one that ends a sleep waits until they are enabled.
 */
function correctInterrupts() {
  const { core, ppb } = rp;
  const [write, enter] = [ppb.writeUint32.bind(ppb), core.exceptionEntry.bind(core)];
  let pended = 0;
  ppb.writeUint32 = (offset, value) => {
    if (offset === 0x200) pended |= value;
    write(offset, value);
  };
  core.exceptionEntry = (number) => {
    const bit = number < 16 ? 0 : 1 << (number - 16);
    if (pended & bit) {
      pended &= ~bit;
      core.pendingInterrupts &= ~bit;
      rp.uart.forEach((uart) => uart.checkInterrupts());
    }
    enter(number);
  };
  const check = core.checkForInterrupts.bind(core);
  core.checkForInterrupts = () => {
    if (!core.waiting || !core.PM) return check();
    if (core.pendingSystick || core.pendingInterrupts & core.enabledInterrupts) {
      core.waiting = false;
      core.interruptsUpdated = true;
    }
    return false;
  };
}

/** Time on the line, buffer and flags of a UART, which rp2040js sends without time. */
function connectUart(uart, baud, sent) {
  const byteNs = 1e10 / baud;
  let until = 0;
  const level = () => Math.max(0, Math.ceil((until - rp.clock.nanos) / byteNs - 1e-6) - 1);
  uart.lineFree = () => start + until - TIMER_NS;
  Object.defineProperty(uart, "flags", {
    get() {
      const { empty, full } = uart.rxFIFO;
      const busy = until > rp.clock.nanos ? 8 : 0;
      const tx = level() >= TX_ROOM ? 0x20 : level() === 0 ? 0x80 : 0;
      return (empty ? 0x10 : 0) | (full ? 0x40 : 0) | tx | busy;
    },
  });
  uart.checkInterrupts = () =>
    rp.setInterrupt(uart.irq, !!(uart.interruptStatus & uart.interruptMask));
  // The chip reports that the buffer drains through a level, not that it is below.
  let before = 0;
  const drain = () => {
    if (before > TX_LEVEL && level() <= TX_LEVEL) uart.interruptStatus |= 0x20;
    before = level();
    uart.checkInterrupts();
  };
  uart.onByte = (byte) => {
    if (level() >= TX_ROOM) throw new Error("a byte is written to a full buffer");
    const begin = Math.max(until, rp.clock.nanos);
    until = begin + byteNs;
    sent(byte, start + until - TIMER_NS);
    before = level();
    if (before > TX_LEVEL) uart.interruptStatus &= ~0x20;
    uart.checkInterrupts();
    after(until - rp.clock.nanos, drain);
  };
  uart.hear = (byte) => {
    if (uart.enabled && uart.rxEnabled) uart.feedByte(byte);
  };
}

function hearHost() {
  while (fromHost.length && fromHost[0].end <= now()) rp.uart[0].hear(fromHost.shift().byte);
  if (fromHost.length) after(fromHost[0].end - now(), hearHost);
}

function sendOnBus(byte) {
  if (!driven()) faults[0]++;
  if (onBus.until > now()) faults[2]++;
  request.push(byte);
}

const driven = () => rp.gpio[DIRECTION].value === 1;

/** The direction pin has changed: when it falls, a request is complete. */
function turnBus(on) {
  if (on || !request.length) return;
  const end = rp.uart[1].lineFree();
  if (end > now() + 1) faults[1]++;
  turnAround = Math.max(turnAround, now() - end);
  const asked = Buffer.from(request).toString("hex");
  request = [];
  answer({ request: asked });
  while (command(readLine()));
}

function reply(bytes, delayUs) {
  const byteNs = 1e10 / SERVO_BAUD;
  const first = delayUs * US;
  onBus.until = now() + first + bytes.length * byteNs;
  bytes.forEach((byte, i) =>
    after(first + (i + 1) * byteNs, () => {
      if (driven() || !rp.uart[1].rxEnabled) faults[3]++;
      else rp.uart[1].hear(byte);
    }),
  );
}

function onPulse(esc, high) {
  if (high) {
    esc.first ||= now();
    esc.rise = now();
    esc.before = esc.wanted;
    esc.wanted = rp.sram[MODE_ADDRESS - RAM] !== 0;
    return;
  }
  if (!esc.rise) return;
  Object.assign(esc, { width: now() - esc.rise, rise: 0, fall: now(), count: esc.count + 1 });
  // A pulse that began within 20 ms of disarming may have been in progress.
  if (!esc.wanted && !esc.before) esc.widest = Math.max(esc.widest, esc.width);
}

function sendPulses() {
  let begin = 0;
  pulses.forEach((us, i) => {
    if (!us || sbus) return;
    const pin = rp.gpio[WIRES + i];
    after(begin, () => pin.setInputValue(true));
    after(begin + us * US, () => pin.setInputValue(false));
    if (!parallel) begin += us * US;
  });
}

/** Plan the next pulse of a wheel sensor; a new period replaces the plan. */
function planWheel(wheel, i) {
  const chip = rp;
  const { period, due } = wheel;
  if (!rp || !period) return;
  after(due - now(), () => {
    if (chip !== rp || wheel.period !== period || wheel.due !== due) return;
    rp.gpio[WHEELS + i].setInputValue(false);
    rp.gpio[WHEELS + i].setInputValue(true);
    wheel.due += period;
    planWheel(wheel, i);
  });
}

function setWheel(i, period) {
  const wheel = wheels[i];
  const left = Math.max(0, wheel.due - now());
  wheel.due = now() + (wheel.period ? (left * period) / wheel.period : period);
  wheel.period = period;
  planWheel(wheel, i);
}

function sbusFrame() {
  let bits = 0n;
  for (let i = 0; i < 16; i++) {
    const us = i < 6 ? pulses[i] : 1500;
    bits |= BigInt(Math.max(0, Math.floor(((us - 880) * 8) / 5))) << BigInt(11 * i);
  }
  const data = Array.from({ length: 22 }, (_, i) => Number((bits >> BigInt(8 * i)) & 0xffn));
  return [0x0f, ...data, sbusFlags, 0];
}

/** Send frames of bits from a time, to a pin that a state machine reads; return the time of their end. */
function sendBits(pin, machine, frames, bitNs, from) {
  let base = 0;
  const advance = () => {
    while (
      machine.enabled &&
      !machine.waiting &&
      base + (machine.cycles * bitNs) / BIT_CYCLES < now()
    ) {
      machine.step();
    }
  };
  const put = (level) => {
    advance();
    const waiting = machine.waiting;
    pin.setInputValue(level);
    if (waiting && !machine.waiting) base = now() - (machine.cycles * bitNs) / BIT_CYCLES;
  };
  let at = Math.max(from, now());
  for (const bits of frames) {
    bits.forEach((bit, i) => after(at + i * bitNs - now(), () => put(!!bit)));
    after(at + (bits.length - 0.1) * bitNs - now(), advance);
    at += bits.length * bitNs;
  }
  return at;
}

const bitsOf = (byte) => Array.from({ length: 8 }, (_, i) => (byte >> i) & 1);

/** Send bytes on the inverted line: start bit, 8 bits, even parity, two stop bits. */
function sendRadio(bytes, errors) {
  const frames = bytes.map((byte) => {
    const ones = [...byte.toString(2)].filter((bit) => bit === "1").length;
    const parity = (ones + (errors & 0x04 ? 1 : 0)) & 1;
    const stop = errors & 0x10 ? 0 : 1;
    return [0, ...bitsOf(byte), parity, stop, 1].map((bit) => 1 - bit);
  });
  radioFree = sendBits(rp.gpio[RADIO], rp.pio[0].machines[0], frames, RADIO_BIT, radioFree);
}

/** Send bytes on the telemetry wire of a speed controller: start bit, 8 bits, stop bit. */
function sendTelemetry(i, bytes, broken) {
  const frames = bytes.map((byte) => [0, ...bitsOf(byte), broken ? 0 : 1]);
  if (broken) frames.push([1, 1, 1]);
  const [pin, machine] = [rp.gpio[WHEELS + i], rp.pio[0].machines[1 + i]];
  telemetryFree[i] = sendBits(pin, machine, frames, TELEMETRY_BIT, telemetryFree[i]);
}

function putVoltages() {
  if (!rp) return;
  const counts = (volts) => Math.min(4095, Math.round((volts / (3.3 * supply)) * 4095));
  inputs.forEach((volts, i) => (rp.adc.channelValues[i] = counts(volts)));
  rp.adc.channelValues[2] = counts(REFERENCE_V);
}

function run(until) {
  while (now() < until) {
    if (!rp) {
      idle = until;
      return;
    }
    const { core, clock } = rp;
    if (core.waiting && core.checkForInterrupts()) core.waiting = false;
    if (hung || core.waiting) {
      const next = clock.nextAlarm ? Math.max(0, clock.nanosToNextAlarm) : Infinity;
      clock.tick(Math.min(next, until - now()));
    } else {
      clock.tick((core.executeInstruction() * 1e9) / rp.clkSys);
    }
    if (wantsReset) {
      resets++;
      power(WATCHDOG);
    }
  }
}

function state() {
  const out = [];
  while (toHost.length && toHost[0].end <= now()) out.push(toHost.shift().byte);
  return {
    now: now(),
    host: Buffer.from(out).toString("hex"),
    resets,
    faults,
    turnAround,
    light: rp !== null && rp.gpio[LIGHT].value === 1,
    pulses: escs.map((esc) => [
      esc.count,
      now() - esc.fall < 25 * MS ? esc.width : 0,
      esc.widest,
      esc.first,
    ]),
  };
}

let line = Buffer.alloc(0);
function readLine() {
  const chunk = Buffer.alloc(65536);
  while (!line.includes(10)) {
    const count = readSync(0, chunk);
    if (!count) process.exit(0);
    line = Buffer.concat([line, chunk.subarray(0, count)]);
  }
  const end = line.indexOf(10);
  const text = line.subarray(0, end).toString();
  line = line.subarray(end + 1);
  return text;
}

function answer(extra = {}) {
  writeSync(1, `${JSON.stringify({ ...state(), ...extra })}\n`);
}

const COMMANDS = {
  go: () => false,
  run: (until) => {
    run(until);
    answer();
  },
  send: (hex) => {
    if (!rp) return;
    const byteNs = 1e10 / HOST_BAUD;
    for (const byte of Buffer.from(hex, "hex")) {
      fromHostFree = Math.max(fromHostFree, now()) + byteNs;
      fromHost.push({ byte, end: fromHostFree });
    }
    hearHost();
  },
  reply: ([hex, delayUs]) => reply([...Buffer.from(hex, "hex")], delayUs),
  adc: ([channel, volts]) => {
    inputs[channel] = volts;
    putVoltages();
  },
  supply: (share) => {
    supply = share;
    putVoltages();
  },
  receiver: (us) => {
    us.forEach((width, i) => {
      // A wire that is off is pulled up; one with a receiver is low between pulses.
      if (rp && !width !== !pulses[i]) rp.gpio[WIRES + i].setInputValue(!width);
    });
    pulses = us;
  },
  parallel: (seconds) => {
    parallel = true;
    if (rp) after(seconds * 1e9, sendPulses);
  },
  wheel: ([i, period]) => setWheel(i, period),
  telemetry: ([i, hex, broken]) => rp && sendTelemetry(i, [...Buffer.from(hex, "hex")], broken),
  sbus: ([on, flags]) => ([sbus, sbusFlags] = [on, flags]),
  radio: ([hex, errors]) => sendRadio([...Buffer.from(hex, "hex")], errors),
  peek: (address) => answer({ byte: rp.sram[address - RAM] }),
  flash: (address) => answer({ byte: flash.bytes[address] }),
  write: ([address, hex]) => flash.bytes.set(Buffer.from(hex, "hex"), address),
  hang: () => (hung = true),
  stopTick: () => (rp.ppb.systickAlarm.enable = false),
  off: () => {
    idle = now();
    if (rp) memory = rp.sram;
    rp = null;
    escs.forEach((esc) => (esc.rise = 0));
  },
  on: ([cause, loseMemory]) => {
    if (loseMemory) memory = new Uint8Array(264 << 10).fill(0xa5);
    if (loseMemory && rp) rp.sram.fill(0xa5);
    resets++;
    power(cause);
  },
};

/** Execute a command; return whether more may follow before the chip continues. */
function command(text) {
  const { name, value } = JSON.parse(text);
  return COMMANDS[name](value) !== false;
}

try {
  power(POWER_ON);
  while (true) command(readLine());
} catch (error) {
  writeSync(1, `${JSON.stringify({ error: String(error.stack ?? error) })}\n`);
  process.exit(1);
}
