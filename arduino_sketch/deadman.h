// What silence does: the ladder of a flight without commands, and of a main loop that hangs.

#ifndef DEADMAN_H
#define DEADMAN_H

#include <stdint.h>

// The host commands 32 times a second: a period is 312.5 ticks, 1250 quarters of a tick.
const int16_t PERIOD_QUARTERS = 1250;
const uint32_t HOLD_AFTER_TICKS = 625;   // 2 periods
const uint32_t BRAKE_AFTER_TICKS = 1250;  // 4 periods, 125 ms
const uint16_t HUNG_AFTER_TICKS = 1000;

enum Rung : uint8_t {
  FOLLOW,  // commands come
  HOLD,    // pulses stay, the carriage stops
  BRAKE,   // the source goes to idle within its descent time, the sufferer to its brake pulse
  SINK,    // the sufferer goes to its sink pulse, which is taken back slowly
  RAMP,    // the sufferer goes to idle within its descent time
  LATCH    // off until armed anew
};

// How many ticks of silence come before each of the last rungs; never falling.
struct Ladder {
  uint32_t sink_after_ticks;
  uint32_t ramp_after_ticks;
  uint32_t latch_after_ticks;
};

// Counts ticks of silence and the periods in which a command was missed.
class Deadman {
 public:
  void start();  // an armed flight begins
  void heard();  // a command came
  Rung watch(const Ladder &ladder);  // once a tick

  uint16_t missed() const { return missed_; }

 private:
  uint32_t silent_ticks_ = 0;
  int16_t expected_in_quarters_ = 0;
  uint16_t missed_ = 0;
};

// Whether the chip's watchdog may be fed. A main loop that hangs in flight must not reset the
// board: without pulses the sufferer falls, while the deadman brings it down. Afterwards it may.
class MainLoopWatch {
 public:
  void turned() { has_turned_ = 1; }  // by the main loop, each time round
  bool may_feed(bool is_flying);      // once a tick

 private:
  volatile uint8_t has_turned_ = 0;
  uint16_t quiet_ticks_ = 0;
};

#endif
