// What a board may do, written from the protocol alone: nothing here is the firmware's own code.

#ifndef FUZZ_MODEL_H
#define FUZZ_MODEL_H

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

inline void require(bool holds, const char *otherwise) {
  if (!holds) {
    fprintf(stderr, "frames_fuzz: %s\n", otherwise);
    exit(1);
  }
}

// CRC-16/CCITT by a table, one byte at a time.
inline uint16_t crc_of(const uint8_t *bytes, int length) {
  static uint16_t table[256];
  if (table[1] == 0) {
    for (int byte = 0; byte < 256; ++byte) {
      int crc = byte << 8;
      for (int bit = 0; bit < 8; ++bit) crc = (crc << 1) ^ (crc & 0x8000 ? 0x1021 : 0);
      table[byte] = static_cast<uint16_t>(crc);
    }
  }
  unsigned crc = 0xFFFF;
  for (int i = 0; i < length; ++i) crc = (crc << 8 & 0xFF00) ^ table[crc >> 8 ^ bytes[i]];
  return static_cast<uint16_t>(crc);
}

inline uint32_t u16_at(const uint8_t *at) { return at[0] | static_cast<uint32_t>(at[1]) << 8; }
inline uint32_t u32_at(const uint8_t *at) { return u16_at(at) | u16_at(at + 2) << 16; }

struct Body {
  uint8_t bytes[64];
  int length = 0;
  void u8(uint8_t value) { bytes[length++] = value; }
  void u16(uint16_t value) {
    u8(static_cast<uint8_t>(value));
    u8(static_cast<uint8_t>(value >> 8));
  }
  void u32(uint32_t value) {
    u16(static_cast<uint16_t>(value));
    u16(static_cast<uint16_t>(value >> 16));
  }
};

struct Wire {
  uint8_t bytes[96];
  int length = 0;
  void remove(int at) {
    if (length > 1) memmove(bytes + at, bytes + at + 1, static_cast<size_t>(--length - at));
  }
  void repeat(int at) {
    memmove(bytes + at + 1, bytes + at, static_cast<size_t>(length++ - at));
  }
};

// The frame of a body: checksum, byte stuffing, ending zero.
inline Wire wire_of(Body body) {
  body.u16(crc_of(body.bytes, body.length));
  Wire wire;
  int block = wire.length++;
  for (int i = 0; i < body.length; ++i) {
    if (body.bytes[i] == 0) {
      wire.bytes[block] = static_cast<uint8_t>(wire.length - block);
      block = wire.length++;
    } else {
      wire.bytes[wire.length++] = body.bytes[i];
    }
  }
  wire.bytes[block] = static_cast<uint8_t>(wire.length - block);
  wire.bytes[wire.length++] = 0;
  return wire;
}

// The body of a frame without its ending zero, checksum cut off; false when it is none.
inline bool body_of(const uint8_t *stuffed, int length, Body &body) {
  body.length = 0;
  for (int at = 0; at < length;) {
    const int end = at + stuffed[at];
    if (end > length) return false;
    for (++at; at < end; ++at) body.u8(stuffed[at]);
    if (end < length) body.u8(0);
  }
  body.length -= 2;
  return body.length >= 7 &&
         crc_of(body.bytes, body.length) == u16_at(body.bytes + body.length);
}

class Model {
 public:
  uint16_t last_sequence = 0;
  uint64_t all_dropped = 0, flights = 0, latches = 0;

  bool flying() const { return armed_ && !latched_; }
  uint32_t ladder_ticks() const { return latch_after_; }

  // Whether the board has to answer this byte.
  bool hear(uint8_t byte) {
    if (byte != 0) {
      if (pending_ == sizeof stuffed_) too_long_ = true;
      else stuffed_[pending_++] = byte;
      return false;
    }
    const int length = pending_;
    const bool fits = !too_long_;
    pending_ = 0;
    too_long_ = false;
    if (length == 0) return false;  // zeros in a row separate nothing
    if (!fits || !body_of(stuffed_, length, heard_) || !is_a_hosts(heard_)) return drop();
    return take();
  }

  void check_answer(const uint8_t *wire, int length) {
    Body said;
    require(wire[length - 1] == 0 && body_of(wire, length - 1, said), "an answer that is no frame");
    const bool to_hello = heard_.bytes[0] == 0x01;
    require(said.bytes[0] == (to_hello ? 0x81 : 0x84), "an answer of another type");
    require(u16_at(said.bytes + 1) == u16_at(heard_.bytes + 1), "an answer to another frame");
    if (!to_hello) return check_status(said.bytes + 7);
    require(said.bytes[7] == (may_arm_ ? 2 : 0), "another version chosen");
  }

  // The pulses that were offered go to the pins.
  void frame_began() { memcpy(applied_, offered_, sizeof applied_); }

  void tick(int step, uint32_t source, uint32_t sufferer) {
    const bool was_flying = flying();
    const uint32_t silent = was_flying ? silent_++ : 0;
    if (was_flying) watch(silent);
    offered_[0] = source;
    offered_[1] = sufferer;
    for (int motor = 0; motor < 2; ++motor) check_pulse(motor, was_flying, silent);
    check_step(step, was_flying, silent);
    if (++since_anchor_ == 256) anchor();
  }

 private:
  static bool is_a_hosts(const Body &body) {
    static const int payloads[] = {-1, 2, 24, 0, 10};  // by type
    return body.bytes[0] < 5 && body.length - 7 == payloads[body.bytes[0]];
  }

  bool drop() {
    ++all_dropped;
    return false;
  }

  bool take() {
    const uint8_t type = heard_.bytes[0], *payload = heard_.bytes + 7;
    const uint16_t sequence = static_cast<uint16_t>(u16_at(heard_.bytes + 1));
    const uint16_t ahead = static_cast<uint16_t>(sequence - last_sequence);
    if (type == 0x01 && !flying()) {
      met_ = true;
      may_arm_ = payload[0] <= 2 && 2 <= payload[1];
      disarm();
    } else if (type == 0x01 || !met_ || ahead == 0 || ahead >= 0x8000) {
      return drop();
    } else if (type == 0x02) {
      arm(payload);
    } else if (type == 0x03) {
      disarm();
    } else if (flying()) {
      silent_ = missed_now_ = 0;
    }
    last_sequence = sequence;
    return true;
  }

  void disarm() {
    armed_ = false;
    may_step_ = false;
    offered_[0] = offered_[1] = low_;
    anchor();
  }

  void arm(const uint8_t *at) {
    const uint32_t low = u16_at(at), high = u16_at(at + 2);
    const bool usable = 1000 <= low && low < high && high <= 5000 && u16_at(at + 8) > 0 &&
                        u16_at(at + 10) > 0;
    if (!may_arm_ || !usable) return;
    ++flights;
    low_ = low;
    high_ = high;
    set_rates(at);
    disarm();
    armed_ = may_step_ = true;
    latched_ = may_arm_ = false;
    silent_ = missed_ = missed_now_ = 0;
  }

  // Allowed changes a tick, in half microseconds and steps; the ladder in ticks of silence.
  void set_rates(const uint8_t *at) {
    const uint32_t source_ms = u16_at(at + 8), sufferer_ms = u16_at(at + 10);
    const double range = high_ - low_, accel = u32_at(at + 14);
    slew_ = 2.0 * fmin(u32_at(at + 4), 2.5e7) / 1e4;
    ramps_[0] = range / (10.0 * source_ms);
    ramps_[1] = range / (10.0 * sufferer_ms);
    fastest_ = fmin(u16_at(at + 12), 1e4) / 1e4;
    braked_after_ = accel < 625.0 ? 1e12 : 625.0 + 1.02e8 * fastest_ / fmin(accel, 2e8) + 4.0;
    ramp_after_[0] = 1250;
    ramp_after_[1] = 1250 + 10 * (u16_at(at + 18) + u16_at(at + 20));
    const uint32_t source_after = 1250 + 10 * source_ms;
    const uint32_t sufferer_after = ramp_after_[1] + 10 * sufferer_ms;
    latch_after_ = source_after > sufferer_after ? source_after : sufferer_after;
  }

  void watch(uint32_t silent) {
    if (8 * static_cast<uint64_t>(silent) >= 3750 + 2500 * static_cast<uint64_t>(missed_now_)) {
      ++missed_now_;
      ++missed_;
    }
    if (silent > latch_after_) {
      latched_ = true;
      ++latches;
    }
  }

  void check_pulse(int motor, bool was_flying, uint32_t silent) {
    const uint32_t pulse = offered_[motor];
    require(low_ <= pulse && pulse <= high_, "a pulse beyond the limits");
    if (!flying()) require(pulse == low_, "a pulse above idle, and nothing flies");
    if (!was_flying) return;
    allowed_[motor] += silent > ramp_after_[motor] ? ramps_[motor] + 1.0 / 65536 : slew_;
    const double moved = fabs(static_cast<double>(pulse) - anchor_[motor]);
    require(moved <= allowed_[motor] + 1.0, "a pulse that outran its slew");
  }

  void check_step(int step, bool was_flying, uint32_t silent) {
    require(-1 <= step && step <= 1, "more than a step in a tick");
    require(step == 0 || may_step_, "a step, and nothing is armed");
    require(!was_flying || step == 0 || silent < braked_after_, "a carriage that never stops");
    steps_ += step;
    travelled_ += step;
    allowed_steps_ += fastest_;
    require(abs(travelled_) <= allowed_steps_ + 1.0, "steps faster than the host allows");
  }

  void check_status(const uint8_t *at) {
    require(u16_at(at) == last_sequence, "another frame told as the last accepted");
    require((at[4] & 1) == latched_, "a latch that is not told, or told wrongly");
    require((at[5] & 1) == flying(), "a status that says armed wrongly");
    require(u16_at(at + 6) == applied_[0] && u16_at(at + 8) == applied_[1], "other pulses told");
    require(u32_at(at + 10) == static_cast<uint32_t>(steps_), "another count of steps");
    require(u16_at(at + 14) == ended(missed_), "another count of missed commands");
    require(u16_at(at + 16) == ended(all_dropped), "another count of dropped frames");
  }

  static uint32_t ended(uint64_t count) {
    return count < 0xFFFF ? static_cast<uint32_t>(count) : 0xFFFF;
  }

  void anchor() {
    since_anchor_ = travelled_ = 0;
    allowed_steps_ = 0.0;
    for (int motor = 0; motor < 2; ++motor) {
      anchor_[motor] = offered_[motor];
      allowed_[motor] = 0.0;
    }
  }

  uint8_t stuffed_[63];
  int pending_ = 0;
  bool too_long_ = false;
  Body heard_;
  bool met_ = false, may_arm_ = false, armed_ = false, latched_ = false, may_step_ = false;
  uint32_t low_ = 2000, high_ = 2000;
  uint32_t offered_[2] = {2000, 2000}, applied_[2] = {2000, 2000}, anchor_[2] = {2000, 2000};
  uint32_t ramp_after_[2] = {0, 0}, latch_after_ = 0, silent_ = 0;
  uint32_t missed_ = 0, missed_now_ = 0;
  double slew_ = 0.0, ramps_[2] = {0.0, 0.0}, allowed_[2] = {0.0, 0.0};
  double fastest_ = 0.0, allowed_steps_ = 0.0, braked_after_ = 0.0;
  int since_anchor_ = 0, travelled_ = 0;
  int64_t steps_ = 0;
};

#endif
