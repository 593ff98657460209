#include "session.h"

uint8_t Session::hear(uint8_t byte, uint32_t now_us, const Surroundings &around, uint8_t *wire) {
  Frame frame;
  if (!decoder_.take(byte, frame)) {
    return 0;
  }
  if (frame.type == HELLO && !mcu_.is_flying()) {
    return encode(frame.sequence, now_us, greet(frame, around), wire);
  }
  // Duplicated or overtaken on the way, or before any handshake. A HELLO in flight is an old one:
  // who opens the port anew resets the board. It would take the motors away.
  if (frame.type == HELLO || !is_new(frame.sequence)) {
    count(decoder_.dropped);
    return 0;
  }
  last_sequence_ = frame.sequence;
  act(frame);
  return encode(frame.sequence, now_us, status(around), wire);
}

HelloReply Session::greet(const Frame &frame, const Surroundings &around) {
  stop_interrupts();
  mcu_.disarm();
  allow_interrupts();
  last_sequence_ = frame.sequence;
  has_met_ = true;
  may_arm_ = frame.hello.oldest <= PROTOCOL_VERSION && PROTOCOL_VERSION <= frame.hello.newest;
  const uint8_t version = may_arm_ ? PROTOCOL_VERSION : 0;
  return HelloReply{version, BOARD_UNO, around.boot, FIRMWARE};
}

bool Session::is_new(uint16_t sequence) const {
  const uint16_t ahead = sequence - last_sequence_;
  return has_met_ && 0 < ahead && ahead < 0x8000;
}

void Session::act(const Frame &frame) {
  if (frame.type == ARM) {
    arm(frame.arm);
    return;
  }
  stop_interrupts();
  if (frame.type == COMMAND) {
    mcu_.command(frame.command);
  } else {
    mcu_.disarm();
  }
  allow_interrupts();
}

void Session::arm(const Arm &arm) {
  if (!may_arm_ || !is_usable(arm)) {
    return;
  }
  const Limits limits = limits_of(arm);  // divides, so not while interrupts are stopped
  stop_interrupts();
  mcu_.arm(limits);
  allow_interrupts();
  may_arm_ = false;
  reset_faults_ = FAULT_NONE;
}

Status Session::status(const Surroundings &around) const {
  Status status;
  stop_interrupts();
  mcu_.fill(status);
  allow_interrupts();
  status.sequence = last_sequence_;
  status.boot = around.boot;
  status.faults |= reset_faults_;
  status.homed = around.homed;
  status.malformed = decoder_.dropped;
  status.battery_mv = around.battery_mv;
  return status;
}
