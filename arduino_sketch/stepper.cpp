#include "stepper.h"

#include "tick_limits.h"

namespace {

const int32_t ONE_STEP = TICKS_PER_S << 16;  // one step/s for a second of ticks, in units of q16

}  // namespace

void Stepper::stop() {
  speed_q16_ = 0;
  target_q16_ = 0;
}

int8_t Stepper::tick(int32_t accel_q16) {
  speed_q16_ = towards(speed_q16_, target_q16_, accel_q16);
  phase_ += speed_q16_;
  if (phase_ >= ONE_STEP) {
    phase_ -= ONE_STEP;
    ++steps_;
    return 1;
  }
  if (phase_ < 0) {
    phase_ += ONE_STEP;
    --steps_;
    return -1;
  }
  return 0;
}
