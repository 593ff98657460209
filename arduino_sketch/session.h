// The conversation with the host: handshake, sequence numbers, what may be done when, answers.

#ifndef SESSION_H
#define SESSION_H

#include <stdint.h>

#include "frames.h"
#include "mcu.h"

const uint8_t BOARD_UNO = 1;
const uint16_t FIRMWARE = 4;  // as in runtime/io/protocol.py; counts changes of what the sketch does

// Given by whoever runs a session: the sketch stops the 10 kHz interrupt, the tests have none.
void stop_interrupts();
void allow_interrupts();

// What the session cannot know by itself.
struct Surroundings {
  uint16_t boot;
  bool homed;
  uint16_t battery_mv;  // 0: not measured
};

class Session {
 public:
  // `reset_faults`: what the last reset was, kept in every status until the host arms.
  Session(Mcu &mcu, uint8_t reset_faults) : mcu_(mcu), reset_faults_(reset_faults) {}

  // Takes a byte; the length of the answer that it caused, in `wire`, which has MAX_FRAME_BYTES.
  uint8_t hear(uint8_t byte, uint32_t now_us, const Surroundings &around, uint8_t *wire);

 private:
  HelloReply greet(const Frame &frame, const Surroundings &around);
  bool is_new(uint16_t sequence) const;
  void act(const Frame &frame);
  void arm(const Arm &arm);
  Status status(const Surroundings &around) const;

  Mcu &mcu_;
  FrameDecoder decoder_;
  uint16_t last_sequence_ = 0;
  uint8_t reset_faults_;
  bool has_met_ = false;  // a host has said hello since boot
  bool may_arm_ = false;
};

#endif
