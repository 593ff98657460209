#include "deadman.h"

#include "frames.h"

void Deadman::start() {
  missed_ = 0;
  heard();
}

void Deadman::heard() {
  silent_ticks_ = 0;
  // Half a period of grace: a command that is merely late has not been missed.
  expected_in_quarters_ = PERIOD_QUARTERS + PERIOD_QUARTERS / 2;
}

Rung Deadman::watch(const Ladder &ladder) {
  const uint32_t silent_ticks = silent_ticks_++;
  if (expected_in_quarters_ <= 0) {
    count(missed_);
    expected_in_quarters_ += PERIOD_QUARTERS;
  }
  expected_in_quarters_ -= 4;
  if (silent_ticks <= HOLD_AFTER_TICKS) {
    return FOLLOW;  // as most of the time
  }
  if (silent_ticks <= BRAKE_AFTER_TICKS) {
    return HOLD;
  }
  if (silent_ticks <= ladder.sink_after_ticks) {
    return BRAKE;
  }
  if (silent_ticks <= ladder.ramp_after_ticks) {
    return SINK;
  }
  return silent_ticks <= ladder.latch_after_ticks ? RAMP : LATCH;
}

bool MainLoopWatch::may_feed(bool is_flying) {
  if (has_turned_) {
    has_turned_ = 0;
    quiet_ticks_ = 0;
  } else if (quiet_ticks_ < HUNG_AFTER_TICKS) {
    ++quiet_ticks_;
  }
  return is_flying || quiet_ticks_ < HUNG_AFTER_TICKS;
}
