// Made by `python -m tsd_twin.dynamixel` from src/tsd_twin/dynamixel/control_table.py; do not edit.
// The control table: little endian, packed. Error 4: a value beyond its limits; error 7:
// not writable, or not now.
#ifndef CONTROL_TABLE_H
#define CONTROL_TABLE_H

#include <stdint.h>

#define CT_MODEL 2014
#define CT_FW_VERSION 5
#define CT_BOARD_ID 200
#define CT_TABLE_VERSION 5
#define CT_SERVOS 6
#define CT_ESCS 3
#define CT_RC_CHANNELS 6
#define CT_RECEIVER_CHANNELS 16
#define CT_STICKS 4
#define CT_ZERO_THROTTLE 2000
#define CT_FULL_THROTTLE 4000
#define CT_SIZE 305

typedef enum {  // Source of the joint commands.
  BOARD_DISARMED = 0,
  BOARD_ARMED = 1,
  BOARD_RC = 2,
} board_code_t;

typedef enum {  // Why the board last disarmed itself; stays until it is armed again.
  TRIP_NONE = 0,
  TRIP_HEARTBEAT = 1,
  TRIP_KILL = 2,
  TRIP_RC_LOST = 3,
  TRIP_RC_TOOK_OVER = 4,
  TRIP_SERVO = 5,
  TRIP_WATCHDOG = 6,
  TRIP_DRIVE = 7,
  TRIP_BATTERY = 8,
  TRIP_TORQUE = 9,
  TRIP_FOLLOWING = 10,
  TRIP_HOT = 12,
  TRIP_LINE = 13,
  TRIP_STOPPED = 14,
} trip_code_t;

typedef enum {  // Why arming was last refused; 0 once it succeeds.
  REFUSAL_NONE = 0,
  REFUSAL_ESC_HOLD = 1,
  REFUSAL_THROTTLE = 2,
  REFUSAL_GOAL = 3,
  REFUSAL_SERVO = 4,
  REFUSAL_NOT_NEUTRAL = 5,
  REFUSAL_KILL = 6,
  REFUSAL_RC = 7,
  REFUSAL_SETUP = 8,
  REFUSAL_DRIVE = 9,
  REFUSAL_BATTERY = 10,
  REFUSAL_RECEIVER = 11,
  REFUSAL_SETTING = 12,
  REFUSAL_TORQUE = 13,
  REFUSAL_STOP_NOT_PROVEN = 14,
  REFUSAL_RC_WITHOUT_SERVOS = 15,
  REFUSAL_NEUTRAL = 17,
  REFUSAL_HOT = 18,
  REFUSAL_STOPPED = 19,
} refusal_code_t;

typedef enum {  // What the receiver of the radio control sends.
  RECEIVER_PULSES = 0,
  RECEIVER_SBUS = 1,
} receiver_code_t;

// Identity of the board, and fixed parameters.
#define CT_IDENTITY 0
#define CT_IDENTITY_SIZE 22

// Parameters of the robot; kept without power. Written as a whole, 2 s after a throttle.
#define CT_SETUP 22
#define CT_SETUP_SIZE 79

// Joint commands: one WRITE of the whole block in each cycle; a partial one is error 5.
#define CT_COMMAND 101
#define CT_COMMAND_SIZE 26

// Measurements and states: one READ in each cycle.
#define CT_TELEMETRY 127
#define CT_TELEMETRY_SIZE 134

// All that receivers of either kind send: for their set-up.
#define CT_RADIO 261
#define CT_RADIO_SIZE 44

typedef struct __attribute__((packed)) {
  // identity: read only
  uint16_t model;  // 0: Kind of board.
  uint8_t fw;  // 2: Version of the firmware, as a ping answers it.
  uint8_t table_version;  // 3: Version of this table.
  uint8_t id;  // 4: Id on the wire.
  uint32_t host_baud;  // 5: Rate of the line to the PC. [Bd]
  uint32_t servo_baud;  // 9: Rate of the servo bus. [Bd]
  uint16_t heartbeat_timeout_ms;  // 13: Trips after this without a beat. [ms]
  uint16_t watchdog_ms;  // 15: A hung firmware is reset after this. [ms]
  uint16_t esc_hold_ms;  // 17: Zero throttle before arming. [ms]
  uint16_t neutral_band;  // 19: Neutral is within this. [step]
  uint8_t servo_hot_c;  // 21: A servo this hot does not arm, and trips. [deg C]
  // setup: read; write while disarmed
  uint8_t servo_id[6];  // 22: Id of each servo, all different: alpha and beta of module 1, then 2, then 3.
  uint16_t neutral[6];  // 28: Servo position of neutral. [step]
  uint8_t reverse;  // 40: Bit i: servo i turns the other way.
  uint16_t goal_limit;  // 41: Goals are held within ± this. [step]
  uint8_t servos_expected;  // 43: Bit i: servo i must answer to arm and to stay armed; 0 when others drive the servos.
  uint16_t battery_arm_mv;  // 44: No arming below this. [mV]
  uint16_t battery_stop_mv;  // 46: Trips below this for 1 s. [mV]
  uint16_t bandgap_mv;  // 48: Of the chip's bandgap, which its supply is measured against. [mV]
  uint8_t receiver_expected;  // 50: 1: a receiver must be there to arm and stay armed, though none was seen since power came.
  uint16_t stick_low[4];  // 51: Pulse at the low end of forward, left, turn, speed. [us]
  uint16_t stick_centre[4];  // 59: At rest; of the speed unused. [us]
  uint16_t stick_high[4];  // 67: At the high end. [us]
  uint8_t stick_dead;  // 75: Dead band at the centre, and at both ends. [us]
  uint8_t receiver_kind;  // 76: What the receiver sends: `ReceiverKind`.
  uint32_t receiver_map;  // 77: Channel of forward, left, turn, speed, kill, manual: 4 bits each, from the lowest.
  uint16_t pulse_low[3];  // 81: Pulse of zero throttle of each speed controller; another only without power at them. [0.5 us]
  uint16_t pulse_high[3];  // 87: Of full throttle. [0.5 us]
  uint16_t throttle_limit[3];  // 93: No throttle exceeds this, whatever the source.
  uint16_t throttle_rise;  // 99: Most by which a throttle rises in 10 ms; it falls at once.
  // command: read and write
  uint16_t heartbeat;  // 101: A change is a beat; arming needs one. While armed, a block that is behind is error 7.
  uint8_t arm;  // 103: Going from 0 to 1 arms, unless there is a reason to refuse; 0 disarms. After a trip it has to be written 0 first: 1 again and again never arms again. 2 is STOP, for the radio control too: until a 0 of this session no source gets the robot.
  uint8_t torque;  // 104: 0 switches servo torque off, while disarmed only.
  uint16_t throttle[3];  // 105: Of each speed controller, from `pulse_low` at 2000 to `pulse_high` at 4000; put out while armed.
  int16_t goal[6];  // 111: Gimbals from neutral: alpha and beta of module 1, then 2, then 3; obeyed while armed. [step]
  uint16_t session[2];  // 123: As `nonce`, or the block only disarms or stops: with `arm` 1 it is error 7.
  // telemetry: read only
  uint32_t millis;  // 127: Since the reset. [ms]
  uint8_t mode;  // 131: Source of the joint commands: `BoardMode`.
  uint8_t trip;  // 132: Why the board last disarmed itself, until it arms: `Trip`.
  uint8_t refusal;  // 133: Why arming was last refused: `Refusal`.
  uint8_t reset_cause;  // 134: Why the board started: `ResetCause`.
  uint16_t beat;  // 135: Echo of the heartbeat that was written last.
  uint16_t nonce[2];  // 137: Number of this session; another after each start, each disarming, and each 1 in `arm` that does not arm.
  uint8_t setup_known;  // 141: 1: the setup was written, now or before.
  uint8_t drive_on;  // 142: 1: the speed controllers have power, behind the contactor.
  uint8_t esc_ready;  // 143: 1: zero throttle was put out for `esc_hold_ms`, since the speed controllers got power and since the last disarming.
  uint8_t servo_found;  // 144: Bit i: servo i answered a ping.
  uint8_t servo_alive;  // 145: Bit i: servo i answered within the last 50 ms.
  uint8_t servo_protocol;  // 146: Bit i: servo i speaks Protocol 2.0, else 1.0.
  uint8_t servo_fault;  // 147: Bit i: servo i reports a hardware error.
  uint8_t servo_torque;  // 148: Bit i: servo i said within the last 150 ms that it holds.
  uint8_t servo_checked;  // 149: Bit i: the settings of servo i have the required values.
  uint8_t wrong_servo;  // 150: Number, from 1, of a servo with a wrong setting, which the next two name; 0: none.
  uint8_t wrong_register;  // 151: Its address in the table of the servo; 0: its model.
  uint32_t wrong_value;  // 152: What it is there.
  uint16_t throttle_out[3];  // 156: Throttle that is put out.
  int16_t position[6];  // 162: Gimbals from neutral. [step]
  int16_t velocity[6];  // 174: Gimbals. [step/s]
  int16_t current[6];  // 186: Of the servos. [mA]
  uint8_t voltage[6];  // 198: At the servos. [0.1 V]
  uint8_t temperature[6];  // 204: Of the servos. [deg C]
  uint16_t rc[6];  // 210: Pulses of the receiver: forward, left, turn, speed, kill, manual; 0: no pulses. [us]
  uint16_t battery_mv;  // 222: Of the battery. [mV]
  uint16_t drive_mv;  // 224: Of the speed controllers, behind the contactor. [mV]
  uint16_t supply_mv;  // 226: Of the board; the reference of the other two. [mV]
  uint16_t crc_errors;  // 228: Packets from the PC with a wrong sum.
  uint16_t rx_errors;  // 230: Bytes from the PC lost, or cut packets given up.
  uint16_t servo_errors;  // 232: Answers of servos that were missing or wrong.
  uint16_t overruns;  // 234: Cycles that took longer than 10 ms.
  uint16_t trips;  // 236: Times that the board disarmed itself since power came.
  uint16_t resets;  // 238: Resets since power came.
  uint8_t stop_proven;  // 240: 1: the stop circuit was seen open since power came.
  uint8_t servo_far;  // 241: Bit i: servo i was not within 100 steps of its `neutral` yet, since power came or `neutral` changed: it gets no torque.
  uint8_t servo_stuck;  // 242: Bit i: servo i did not follow its goal, at the last trip.
  uint16_t servo_model[6];  // 243: Model numbers of the servos; 0: not read.
  uint8_t servo_missed[6];  // 255: Missing or wrong answers of each servo; from 255 on to 0.
  // radio: read only
  uint16_t channel[22];  // 261: The channels of a frame, then the pulses of the wires; 0: none. [us]
} control_table_t;

_Static_assert(sizeof(control_table_t) == CT_SIZE, "the table is packed");

// X(name, address, type, count, default, rise from entry to entry): every item.
#define CT_ITEMS(X) \
  X(model, 0, uint16_t, 1, 2014, 0) \
  X(fw, 2, uint8_t, 1, 5, 0) \
  X(table_version, 3, uint8_t, 1, 5, 0) \
  X(id, 4, uint8_t, 1, 200, 0) \
  X(host_baud, 5, uint32_t, 1, 1000000, 0) \
  X(servo_baud, 9, uint32_t, 1, 1000000, 0) \
  X(heartbeat_timeout_ms, 13, uint16_t, 1, 500, 0) \
  X(watchdog_ms, 15, uint16_t, 1, 250, 0) \
  X(esc_hold_ms, 17, uint16_t, 1, 2000, 0) \
  X(neutral_band, 19, uint16_t, 1, 11, 0) \
  X(servo_hot_c, 21, uint8_t, 1, 75, 0) \
  X(servo_id, 22, uint8_t, 6, 1, 1) \
  X(neutral, 28, uint16_t, 6, 2048, 0) \
  X(reverse, 40, uint8_t, 1, 0, 0) \
  X(goal_limit, 41, uint16_t, 1, 341, 0) \
  X(servos_expected, 43, uint8_t, 1, 63, 0) \
  X(battery_arm_mv, 44, uint16_t, 1, 0, 0) \
  X(battery_stop_mv, 46, uint16_t, 1, 0, 0) \
  X(bandgap_mv, 48, uint16_t, 1, 1100, 0) \
  X(receiver_expected, 50, uint8_t, 1, 0, 0) \
  X(stick_low, 51, uint16_t, 4, 1100, 0) \
  X(stick_centre, 59, uint16_t, 4, 1500, 0) \
  X(stick_high, 67, uint16_t, 4, 1900, 0) \
  X(stick_dead, 75, uint8_t, 1, 20, 0) \
  X(receiver_kind, 76, uint8_t, 1, 0, 0) \
  X(receiver_map, 77, uint32_t, 1, 5517840, 0) \
  X(pulse_low, 81, uint16_t, 3, 2000, 0) \
  X(pulse_high, 87, uint16_t, 3, 4000, 0) \
  X(throttle_limit, 93, uint16_t, 3, 4000, 0) \
  X(throttle_rise, 99, uint16_t, 1, 2000, 0) \
  X(heartbeat, 101, uint16_t, 1, 0, 0) \
  X(arm, 103, uint8_t, 1, 0, 0) \
  X(torque, 104, uint8_t, 1, 1, 0) \
  X(throttle, 105, uint16_t, 3, 2000, 0) \
  X(goal, 111, int16_t, 6, 0, 0) \
  X(session, 123, uint16_t, 2, 0, 0) \
  X(millis, 127, uint32_t, 1, 0, 0) \
  X(mode, 131, uint8_t, 1, 0, 0) \
  X(trip, 132, uint8_t, 1, 0, 0) \
  X(refusal, 133, uint8_t, 1, 0, 0) \
  X(reset_cause, 134, uint8_t, 1, 0, 0) \
  X(beat, 135, uint16_t, 1, 0, 0) \
  X(nonce, 137, uint16_t, 2, 0, 0) \
  X(setup_known, 141, uint8_t, 1, 0, 0) \
  X(drive_on, 142, uint8_t, 1, 0, 0) \
  X(esc_ready, 143, uint8_t, 1, 0, 0) \
  X(servo_found, 144, uint8_t, 1, 0, 0) \
  X(servo_alive, 145, uint8_t, 1, 0, 0) \
  X(servo_protocol, 146, uint8_t, 1, 0, 0) \
  X(servo_fault, 147, uint8_t, 1, 0, 0) \
  X(servo_torque, 148, uint8_t, 1, 0, 0) \
  X(servo_checked, 149, uint8_t, 1, 0, 0) \
  X(wrong_servo, 150, uint8_t, 1, 0, 0) \
  X(wrong_register, 151, uint8_t, 1, 0, 0) \
  X(wrong_value, 152, uint32_t, 1, 0, 0) \
  X(throttle_out, 156, uint16_t, 3, 2000, 0) \
  X(position, 162, int16_t, 6, 0, 0) \
  X(velocity, 174, int16_t, 6, 0, 0) \
  X(current, 186, int16_t, 6, 0, 0) \
  X(voltage, 198, uint8_t, 6, 0, 0) \
  X(temperature, 204, uint8_t, 6, 0, 0) \
  X(rc, 210, uint16_t, 6, 0, 0) \
  X(battery_mv, 222, uint16_t, 1, 0, 0) \
  X(drive_mv, 224, uint16_t, 1, 0, 0) \
  X(supply_mv, 226, uint16_t, 1, 0, 0) \
  X(crc_errors, 228, uint16_t, 1, 0, 0) \
  X(rx_errors, 230, uint16_t, 1, 0, 0) \
  X(servo_errors, 232, uint16_t, 1, 0, 0) \
  X(overruns, 234, uint16_t, 1, 0, 0) \
  X(trips, 236, uint16_t, 1, 0, 0) \
  X(resets, 238, uint16_t, 1, 0, 0) \
  X(stop_proven, 240, uint8_t, 1, 0, 0) \
  X(servo_far, 241, uint8_t, 1, 0, 0) \
  X(servo_stuck, 242, uint8_t, 1, 0, 0) \
  X(servo_model, 243, uint16_t, 6, 0, 0) \
  X(servo_missed, 255, uint8_t, 6, 0, 0) \
  X(channel, 261, uint16_t, 22, 0, 0)

// X(name, address, type, count, least, most): every item that can be written.
#define CT_WRITABLE(X) \
  X(servo_id, 22, uint8_t, 6, 1, 252) \
  X(neutral, 28, uint16_t, 6, 0, 4095) \
  X(reverse, 40, uint8_t, 1, 0, 63) \
  X(goal_limit, 41, uint16_t, 1, 0, 1023) \
  X(servos_expected, 43, uint8_t, 1, 0, 63) \
  X(battery_arm_mv, 44, uint16_t, 1, 0, 65535) \
  X(battery_stop_mv, 46, uint16_t, 1, 0, 65535) \
  X(bandgap_mv, 48, uint16_t, 1, 1000, 1200) \
  X(receiver_expected, 50, uint8_t, 1, 0, 1) \
  X(stick_low, 51, uint16_t, 4, 800, 2200) \
  X(stick_centre, 59, uint16_t, 4, 800, 2200) \
  X(stick_high, 67, uint16_t, 4, 800, 2200) \
  X(stick_dead, 75, uint8_t, 1, 0, 100) \
  X(receiver_kind, 76, uint8_t, 1, 0, 1) \
  X(receiver_map, 77, uint32_t, 1, 0, 16777215) \
  X(pulse_low, 81, uint16_t, 3, 2000, 2400) \
  X(pulse_high, 87, uint16_t, 3, 3000, 4400) \
  X(throttle_limit, 93, uint16_t, 3, 2000, 4000) \
  X(throttle_rise, 99, uint16_t, 1, 1, 2000) \
  X(heartbeat, 101, uint16_t, 1, 0, 65535) \
  X(arm, 103, uint8_t, 1, 0, 2) \
  X(torque, 104, uint8_t, 1, 0, 1) \
  X(throttle, 105, uint16_t, 3, 2000, 4000) \
  X(goal, 111, int16_t, 6, -1023, 1023) \
  X(session, 123, uint16_t, 2, 0, 65535)

#endif
