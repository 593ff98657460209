// The carriage's step planner: speed with limited acceleration, position in whole steps.

#ifndef STEPPER_H
#define STEPPER_H

#include <stdint.h>

// Each tick adds the speed to a phase that wraps at one step. Both are whole numbers and a step is
// an exact multiple of the speed's unit: v steps/s are v steps in every second, without drift.
class Stepper {
 public:
  void aim(int32_t speed_q16) { target_q16_ = speed_q16; }
  void stop();  // at once
  int8_t tick(int32_t accel_q16);  // the step to take now: -1, 0 or 1

  int32_t steps() const { return steps_; }  // since boot
  int32_t speed_q16() const { return speed_q16_; }

 private:
  int32_t speed_q16_ = 0;
  int32_t target_q16_ = 0;
  int32_t phase_ = 0;  // 0 <= phase < one step
  int32_t steps_ = 0;
};

#endif
