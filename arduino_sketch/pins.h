// What is wired where on the UNO. Changing a pin of the first two lines means another timer.

#ifndef PINS_H
#define PINS_H

#include <stdint.h>

const uint8_t SOURCE_ESC_PIN = 9;     // OC1A
const uint8_t SUFFERER_ESC_PIN = 10;  // OC1B

// Both on port D, so that the interrupt sets them in one instruction each.
const uint8_t STEP_PIN = 2;
const uint8_t DIRECTION_PIN = 3;  // high: towards positive x

const uint8_t HOME_PIN = 4;  // a switch to ground, closed while the carriage is at home

// The battery through a divider of 30 kOhm over 10 kOhm: 20 V at full scale. Below 2 V there is no
// flight battery. Without the divider the pin reads anything; the host's rig file says which it is.
const uint8_t BATTERY_PIN = A0;
const uint16_t BATTERY_FULL_SCALE_MV = 20000;
const uint16_t BATTERY_LEAST_MV = 2000;

#endif
