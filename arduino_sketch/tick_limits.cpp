#include "tick_limits.h"

namespace {

const uint16_t SHORTEST_HALF_US = 2 * 500;
const uint16_t LONGEST_HALF_US = 2 * 2500;

// At these a tick covers the whole range, a carriage's from full speed to full speed back. Beyond
// them the products below would not fit 32 bits.
const uint32_t FASTEST_SLEW_US_PER_S = 2500UL * TICKS_PER_S;
const uint32_t FASTEST_ACCEL_STEPS_PER_S2 = 2UL * MOST_STEPS_PER_S * TICKS_PER_S;

uint32_t smaller(uint32_t one, uint32_t other) { return one < other ? one : other; }
uint32_t larger(uint32_t one, uint32_t other) { return one < other ? other : one; }

uint32_t ticks(uint16_t ms) { return static_cast<uint32_t>(ms) * TICKS_PER_MS; }

// value * 2^bits / 625, rounded down: 10 000 ticks are 2^4 times 625.
int32_t over_625(uint32_t value, uint8_t bits) {
  return static_cast<int32_t>(((value / 625) << bits) + ((value % 625) << bits) / 625);
}

int32_t descent(uint32_t range_q16, uint32_t ticks) {
  return static_cast<int32_t>((range_q16 + ticks - 1) / ticks);  // rather early than late
}

// The longest takes 1,967,300 ticks: of 16 bits each, no time on the wire overflows here.
Ladder ladder(const Arm &arm) {
  Ladder ladder;
  ladder.sink_after_ticks = BRAKE_AFTER_TICKS + ticks(arm.brake_ms);
  ladder.ramp_after_ticks = ladder.sink_after_ticks + ticks(arm.sink_ms);
  ladder.latch_after_ticks = larger(ladder.ramp_after_ticks + ticks(arm.sufferer_descent_ms),
                                    BRAKE_AFTER_TICKS + ticks(arm.source_descent_ms));
  return ladder;
}

}  // namespace

bool is_usable(const Arm &arm) {
  return SHORTEST_HALF_US <= arm.low_half_us && arm.low_half_us < arm.high_half_us &&
         arm.high_half_us <= LONGEST_HALF_US && arm.source_descent_ms > 0 &&
         arm.sufferer_descent_ms > 0;
}

Limits limits_of(const Arm &arm) {
  Limits limits;
  const uint16_t range_half_us = arm.high_half_us - arm.low_half_us;
  const uint32_t range_q16 = static_cast<uint32_t>(range_half_us) << 16;
  limits.low_q16 = static_cast<int32_t>(arm.low_half_us) << 16;
  limits.high_q16 = static_cast<int32_t>(arm.high_half_us) << 16;
  limits.slew_q16 = over_625(smaller(arm.slew_us_per_s, FASTEST_SLEW_US_PER_S), 13);
  limits.descent_q16[SOURCE] = descent(range_q16, ticks(arm.source_descent_ms));
  limits.descent_q16[SUFFERER] = descent(range_q16, ticks(arm.sufferer_descent_ms));
  limits.sink_q16 = over_625(arm.sink_rate_us_per_s, 13);
  limits.ladder = ladder(arm);
  limits.max_speed_q16 =
      static_cast<int32_t>(smaller(arm.max_speed_steps_per_s, MOST_STEPS_PER_S) << 16);
  limits.accel_q16 =
      over_625(smaller(arm.max_accel_steps_per_s2, FASTEST_ACCEL_STEPS_PER_S2), 12);
  return limits;
}

int32_t clamped(int32_t value, int32_t low, int32_t high) {
  if (value < low) {
    return low;
  }
  return value > high ? high : value;
}

int32_t towards(int32_t now, int32_t target, int32_t most) {
  if (now == target) {
    return now;  // as most of the time, and the interrupt is the shorter for it
  }
  return clamped(target, now - most, now + most);
}
