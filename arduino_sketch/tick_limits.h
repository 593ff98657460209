// The host's limits in the units of the 10 kHz tick, converted once, when the host arms.
//
// Pulse widths are half microseconds, speeds steps per second; both carry 16 binary places, so that
// a slow ramp moves by less than the timer can show in each tick and still arrives in time.

#ifndef TICK_LIMITS_H
#define TICK_LIMITS_H

#include <stdint.h>

#include "deadman.h"
#include "frames.h"

const int32_t TICKS_PER_S = 10000;
const int32_t TICKS_PER_MS = 10;
const uint16_t MOST_STEPS_PER_S = 10000;  // one step a tick

enum Motor : uint8_t { SOURCE = 0, SUFFERER = 1, MOTORS = 2 };

struct Limits {
  int32_t low_q16;  // idle
  int32_t high_q16;
  int32_t slew_q16;             // a tick
  int32_t descent_q16[MOTORS];  // a tick, on the ramp to idle
  int32_t sink_q16;             // a tick, by which the sink pulse is taken back
  Ladder ladder;
  int32_t max_speed_q16;
  int32_t accel_q16;  // a tick
};

// Whether a board may arm with them: a range of pulses that an ESC understands, and descents that
// take time.
bool is_usable(const Arm &arm);

// `arm` must be usable. A speed beyond a step a tick becomes a step a tick.
Limits limits_of(const Arm &arm);

int32_t clamped(int32_t value, int32_t low, int32_t high);

// From `now` towards `target`, by `most` at the most.
int32_t towards(int32_t now, int32_t target, int32_t most);

#endif
