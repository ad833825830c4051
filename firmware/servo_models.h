// Made by `python -m tsd_twin.dynamixel` from src/tsd_twin/dynamixel/servo_models.py; do not edit.
// {address, size, bytes of the read that begins with it, least, most}
static const setting_t SETTINGS_310[] = {
    {5, 1, 5, 25, 250},  // return delay time
    {6, 2, 0, 0, 0},  // clockwise angle limit
    {8, 2, 0, 4095, 4095},  // counter-clockwise angle limit
    {11, 1, 6, 80, 80},  // temperature limit
    {12, 1, 0, 60, 60},  // lowest voltage limit
    {13, 1, 0, 160, 240},  // highest voltage limit
    {14, 2, 0, 1023, 1023},  // max torque
    {16, 1, 0, 2, 2},  // status return level
    {18, 1, 1, 36, 36},  // shutdown
    {20, 2, 3, 0, 0},  // multi-turn offset
    {22, 1, 0, 1, 1},  // resolution divider
    {26, 1, 3, 0, 0},  // D gain
    {27, 1, 0, 0, 0},  // I gain
    {28, 1, 0, 32, 32},  // P gain
    {32, 2, 4, 0, 0},  // moving speed
    {34, 2, 0, 1023, 1023},  // torque limit
    {48, 2, 2, 0, 0},  // punch
    {70, 1, 4, 0, 0},  // torque control mode
    {71, 2, 0, 0, 0},  // goal torque
    {73, 1, 0, 0, 0},  // goal acceleration
};
static const setting_t SETTINGS_311[] = {
    {9, 1, 5, 25, 250},  // return delay time
    {10, 1, 0, 0, 0},  // drive mode
    {11, 1, 0, 3, 3},  // operating mode
    {12, 1, 0, 255, 255},  // secondary id
    {13, 1, 0, 2, 2},  // protocol type
    {20, 4, 4, 0, 0},  // homing offset
    {31, 1, 21, 80, 80},  // temperature limit
    {32, 2, 0, 160, 160},  // max voltage limit
    {34, 2, 0, 95, 95},  // min voltage limit
    {36, 2, 0, 885, 885},  // PWM limit
    {38, 2, 0, 1941, 1941},  // current limit
    {40, 4, 0, 32767, 32767},  // acceleration limit
    {44, 4, 0, 285, 1023},  // velocity limit
    {48, 4, 0, 4095, 4095},  // largest position
    {52, 4, 4, 0, 0},  // smallest position
    {63, 1, 1, 52, 52},  // shutdown
    {68, 1, 1, 2, 2},  // status return level
    {76, 2, 10, 1920, 1920},  // velocity I gain
    {78, 2, 0, 100, 100},  // velocity P gain
    {80, 2, 0, 0, 0},  // position D gain
    {82, 2, 0, 0, 0},  // position I gain
    {84, 2, 0, 850, 850},  // position P gain
    {88, 2, 4, 0, 0},  // feedforward 2nd gain
    {90, 2, 0, 0, 0},  // feedforward 1st gain
    {98, 1, 1, 0, 0},  // bus watchdog
    {100, 2, 2, 885, 885},  // goal PWM
    {108, 4, 8, 0, 0},  // profile acceleration
    {112, 4, 0, 0, 0},  // profile velocity
};
static const setting_t SETTINGS_1020[] = {
    {9, 1, 5, 25, 250},  // return delay time
    {10, 1, 0, 0, 0},  // drive mode
    {11, 1, 0, 3, 3},  // operating mode
    {12, 1, 0, 255, 255},  // secondary id
    {13, 1, 0, 2, 2},  // protocol type
    {20, 4, 4, 0, 0},  // homing offset
    {31, 1, 9, 80, 80},  // temperature limit
    {32, 2, 0, 160, 160},  // max voltage limit
    {34, 2, 0, 95, 95},  // min voltage limit
    {36, 2, 0, 885, 885},  // PWM limit
    {38, 2, 0, 1193, 1193},  // current limit
    {44, 4, 12, 200, 1023},  // velocity limit
    {48, 4, 0, 4095, 4095},  // largest position
    {52, 4, 0, 0, 0},  // smallest position
    {63, 1, 1, 52, 52},  // shutdown
    {68, 1, 1, 2, 2},  // status return level
    {76, 2, 10, 1920, 1920},  // velocity I gain
    {78, 2, 0, 100, 100},  // velocity P gain
    {80, 2, 0, 0, 0},  // position D gain
    {82, 2, 0, 0, 0},  // position I gain
    {84, 2, 0, 800, 800},  // position P gain
    {88, 2, 4, 0, 0},  // feedforward 2nd gain
    {90, 2, 0, 0, 0},  // feedforward 1st gain
    {98, 1, 1, 0, 0},  // bus watchdog
    {100, 2, 2, 885, 885},  // goal PWM
    {108, 4, 8, 0, 0},  // profile acceleration
    {112, 4, 0, 0, 0},  // profile velocity
};
static const setting_t SETTINGS_1030[] = {
    {9, 1, 5, 25, 250},  // return delay time
    {10, 1, 0, 0, 0},  // drive mode
    {11, 1, 0, 3, 3},  // operating mode
    {12, 1, 0, 255, 255},  // secondary id
    {13, 1, 0, 2, 2},  // protocol type
    {20, 4, 4, 0, 0},  // homing offset
    {31, 1, 9, 80, 80},  // temperature limit
    {32, 2, 0, 160, 160},  // max voltage limit
    {34, 2, 0, 95, 95},  // min voltage limit
    {36, 2, 0, 885, 885},  // PWM limit
    {38, 2, 0, 1193, 1193},  // current limit
    {44, 4, 12, 330, 1023},  // velocity limit
    {48, 4, 0, 4095, 4095},  // largest position
    {52, 4, 0, 0, 0},  // smallest position
    {63, 1, 1, 52, 52},  // shutdown
    {68, 1, 1, 2, 2},  // status return level
    {76, 2, 10, 1920, 1920},  // velocity I gain
    {78, 2, 0, 100, 100},  // velocity P gain
    {80, 2, 0, 0, 0},  // position D gain
    {82, 2, 0, 0, 0},  // position I gain
    {84, 2, 0, 800, 800},  // position P gain
    {88, 2, 4, 0, 0},  // feedforward 2nd gain
    {90, 2, 0, 0, 0},  // feedforward 1st gain
    {98, 1, 1, 0, 0},  // bus watchdog
    {100, 2, 2, 885, 885},  // goal PWM
    {108, 4, 8, 0, 0},  // profile acceleration
    {112, 4, 0, 0, 0},  // profile velocity
};
static const setting_t SETTINGS_1120[] = {
    {9, 1, 5, 25, 250},  // return delay time
    {10, 1, 0, 0, 0},  // drive mode
    {11, 1, 0, 3, 3},  // operating mode
    {12, 1, 0, 255, 255},  // secondary id
    {13, 1, 0, 2, 2},  // protocol type
    {20, 4, 4, 0, 0},  // homing offset
    {31, 1, 9, 80, 80},  // temperature limit
    {32, 2, 0, 160, 160},  // max voltage limit
    {34, 2, 0, 95, 95},  // min voltage limit
    {36, 2, 0, 885, 885},  // PWM limit
    {38, 2, 0, 2047, 2047},  // current limit
    {44, 4, 12, 128, 1023},  // velocity limit
    {48, 4, 0, 4095, 4095},  // largest position
    {52, 4, 0, 0, 0},  // smallest position
    {63, 1, 1, 52, 52},  // shutdown
    {68, 1, 1, 2, 2},  // status return level
    {76, 2, 10, 1920, 1920},  // velocity I gain
    {78, 2, 0, 100, 100},  // velocity P gain
    {80, 2, 0, 0, 0},  // position D gain
    {82, 2, 0, 0, 0},  // position I gain
    {84, 2, 0, 800, 800},  // position P gain
    {88, 2, 4, 0, 0},  // feedforward 2nd gain
    {90, 2, 0, 0, 0},  // feedforward 1st gain
    {98, 1, 1, 0, 0},  // bus watchdog
    {100, 2, 2, 885, 885},  // goal PWM
    {108, 4, 8, 0, 0},  // profile acceleration
    {112, 4, 0, 0, 0},  // profile velocity
};
static const setting_t SETTINGS_1130[] = {
    {9, 1, 5, 25, 250},  // return delay time
    {10, 1, 0, 0, 0},  // drive mode
    {11, 1, 0, 3, 3},  // operating mode
    {12, 1, 0, 255, 255},  // secondary id
    {13, 1, 0, 2, 2},  // protocol type
    {20, 4, 4, 0, 0},  // homing offset
    {31, 1, 9, 80, 80},  // temperature limit
    {32, 2, 0, 160, 160},  // max voltage limit
    {34, 2, 0, 95, 95},  // min voltage limit
    {36, 2, 0, 885, 885},  // PWM limit
    {38, 2, 0, 2047, 2047},  // current limit
    {44, 4, 12, 230, 1023},  // velocity limit
    {48, 4, 0, 4095, 4095},  // largest position
    {52, 4, 0, 0, 0},  // smallest position
    {63, 1, 1, 52, 52},  // shutdown
    {68, 1, 1, 2, 2},  // status return level
    {76, 2, 10, 1920, 1920},  // velocity I gain
    {78, 2, 0, 100, 100},  // velocity P gain
    {80, 2, 0, 0, 0},  // position D gain
    {82, 2, 0, 0, 0},  // position I gain
    {84, 2, 0, 800, 800},  // position P gain
    {88, 2, 4, 0, 0},  // feedforward 2nd gain
    {90, 2, 0, 0, 0},  // feedforward 1st gain
    {98, 1, 1, 0, 0},  // bus watchdog
    {100, 2, 2, 885, 885},  // goal PWM
    {108, 4, 8, 0, 0},  // profile acceleration
    {112, 4, 0, 0, 0},  // profile velocity
};

// {number, current in mA / 256, settings, how many}
static const servo_model_t MODELS[] = {
    {310, 1152, SETTINGS_310, 20},
    {311, 860, SETTINGS_311, 28},
    {1020, 689, SETTINGS_1020, 27},
    {1030, 689, SETTINGS_1030, 27},
    {1120, 689, SETTINGS_1120, 27},
    {1130, 689, SETTINGS_1130, 27},
};
