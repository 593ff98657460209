// The board's decisions: limits, slew, carriage, deadman. runtime/virtual/mcu.py is the same in Python.
//
// `tick` runs in the 10 kHz interrupt, everything else in the main loop with interrupts stopped.

#ifndef MCU_H
#define MCU_H

#include <stdint.h>

#include "deadman.h"
#include "frames.h"
#include "tick_limits.h"
#include "stepper.h"

class Mcu {
 public:
  Mcu();

  void arm(const Limits &limits);  // start anew from idle; clears the latch
  void disarm();                   // motors idle and carriage stopped at once
  void command(const Command &command);  // ignored unless flying

  int8_t tick();  // the carriage's step to take now: -1, 0 or 1

  // A servo frame began: what was offered last is on the pins from now on.
  void frame_began(uint32_t now_us);

  // The pulse width for the next servo frame.
  uint16_t offered_half_us(Motor motor) const;

  bool is_flying() const { return armed_ && !latched_; }
  void fill(Status &status) const;  // all that is the MCU's to tell

 private:
  int32_t limited_q16(uint16_t half_us) const;
  Rung watch();
  void descend(Rung rung);

  Limits limits_;
  Deadman deadman_;
  Stepper stepper_;
  int32_t pulse_q16_[MOTORS];
  int32_t target_q16_[MOTORS];
  int32_t brake_q16_;  // the sufferer's targets, should no other command come
  int32_t sink_q16_;
  uint16_t applied_half_us_[MOTORS];
  uint32_t applied_time_us_ = 0;
  bool armed_ = false;
  bool latched_ = false;
};

#endif
