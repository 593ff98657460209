// Random bytes, frames and damaged frames for the firmware's decisions: what must hold, holds.
//
//   frames_fuzz COUNT SEED
//
// A model written from the protocol alone says after every byte whether the board may answer and
// with what, and after every tick within which bounds its outputs lie. Prints what has been tried
// as JSON; what must not be ends the program with status 1, as a sanitizer does.

#include <stdio.h>
#include <stdlib.h>

#include "fuzz_model.h"
#include "mcu.h"
#include "session.h"

void stop_interrupts() {}
void allow_interrupts() {}

namespace {

// SplitMix64 (Steele, Lea and Flood 2014).
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  uint64_t bits() {
    uint64_t z = (state_ += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
  }
  uint32_t below(uint32_t end) { return static_cast<uint32_t>((bits() >> 32) * end >> 32); }
  uint32_t from(uint32_t low, uint32_t high) { return low + below(high - low + 1); }
  bool one_in(uint32_t n) { return below(n) == 0; }
  uint8_t u8() { return static_cast<uint8_t>(bits()); }
  uint16_t u16() { return static_cast<uint16_t>(bits()); }
  // Of any magnitude, the ends of the range included.
  uint32_t magnitude(uint32_t most_bits) {
    const uint32_t ones = most_bits == 32 ? UINT32_MAX : (1u << most_bits) - 1;
    return one_in(16) ? ones : (static_cast<uint32_t>(bits()) & ones) >> below(most_bits);
  }

 private:
  uint64_t state_;
};

class Fuzz {
 public:
  Fuzz(uint64_t count, uint64_t seed) : random_(seed), count_(count), session_(mcu_, 0) {}

  void run() {
    for (uint64_t sent = 0; sent < count_; ++sent) {
      send();
      wait();
    }
    silence();
  }

  void print() const {
    printf("{\"frames\": %llu, \"ticks\": %llu", whole(count_), whole(ticks_));
    for (int kind = 0; kind < KINDS; ++kind) {
      printf(", \"%s\": %llu", NAMES[kind], whole(sent_[kind]));
    }
    printf(", \"bytes\": %llu, \"answered\": %llu, \"dropped\": %llu", whole(bytes_),
           whole(answered_), whole(model_.all_dropped));
    printf(", \"flights\": %llu, \"latched\": %llu}\n", whole(model_.flights),
           whole(model_.latches));
  }

 private:
  enum Kind {
    HELLOS, ARMS, DISARMS, COMMANDS, EXTREME, STALE, DAMAGED, CUT, MISSHAPEN, NOISE, KINDS
  };
  static const char *const NAMES[KINDS];

  static unsigned long long whole(uint64_t count) { return count; }

  void send() {
    const Kind kind = any_kind();
    ++sent_[kind];
    Wire wire;
    if (kind == NOISE) {
      noise(wire);
    } else {
      wire = wire_of(body(kind));
      if (kind == DAMAGED) damage(wire);
      if (kind == CUT) wire.length = static_cast<int>(random_.below(wire.length));
    }
    for (int i = 0; i < wire.length; ++i) hear(wire.bytes[i]);
  }

  Kind any_kind() {
    if (!model_.flying() && random_.one_in(2)) return random_.one_in(2) ? HELLOS : ARMS;
    const uint32_t one = random_.below(256);
    if (one < 4) return HELLOS;
    if (one < 8) return ARMS;
    if (one < 9) return DISARMS;
    if (one < 110) return COMMANDS;
    if (one < 130) return EXTREME;
    if (one < 145) return STALE;
    if (one < 190) return DAMAGED;
    if (one < 205) return CUT;
    return one < 225 ? MISSHAPEN : NOISE;
  }

  Body body(Kind kind) {
    const uint16_t ahead = kind == STALE ? random_.u16() : static_cast<uint16_t>(1);
    Body body;
    const uint8_t type = kind == MISSHAPEN ? misshapen_type() : type_of(kind);
    body.u8(type);
    body.u16(static_cast<uint16_t>(model_.last_sequence + ahead));
    body.u32(static_cast<uint32_t>(random_.bits()));
    switch (kind) {
      case HELLOS: hello(body); break;
      case ARMS: arm(body); break;
      case DISARMS: break;
      case EXTREME: extreme_command(body); break;
      case MISSHAPEN: any_payload(body); break;
      default: usual_command(body);
    }
    return body;
  }

  static uint8_t type_of(Kind kind) {
    if (kind == HELLOS) return 0x01;
    if (kind == ARMS) return 0x02;
    return kind == DISARMS ? 0x03 : 0x04;
  }

  uint8_t misshapen_type() {
    static const uint8_t known[] = {0x01, 0x02, 0x03, 0x04, 0x81, 0x84};
    return random_.one_in(4) ? random_.u8() : known[random_.below(sizeof known)];
  }

  void hello(Body &body) {
    const bool usual = !random_.one_in(4);
    body.u8(usual ? 2 : random_.u8());
    body.u8(usual ? 2 : random_.u8());
  }

  void arm(Body &body) {
    const bool usual = !random_.one_in(4);
    const bool at_the_ends = random_.one_in(4);
    const uint32_t low = at_the_ends ? random_.from(999, 1001) : random_.from(1000, 4999);
    const uint32_t high = at_the_ends ? random_.from(4999, 5001) : random_.from(low + 1, 5000);
    body.u16(usual ? static_cast<uint16_t>(low) : random_.u16());
    body.u16(usual ? static_cast<uint16_t>(high) : random_.u16());
    body.u32(random_.magnitude(32));
    body.u16(duration_ms());
    body.u16(duration_ms());
    body.u16(static_cast<uint16_t>(random_.magnitude(16)));
    body.u32(random_.magnitude(32));
    body.u16(duration_ms());
    body.u16(duration_ms());
    body.u16(static_cast<uint16_t>(random_.magnitude(16)));
  }

  uint16_t duration_ms() {
    return static_cast<uint16_t>(random_.one_in(64) ? random_.magnitude(16) : random_.below(300));
  }

  void usual_command(Body &body) {
    body.u16(static_cast<uint16_t>(random_.from(1900, 4100)));
    body.u16(static_cast<uint16_t>(random_.from(1900, 4100)));
    body.u16(static_cast<uint16_t>(random_.from(0, 5000) - 2500));
    body.u16(static_cast<uint16_t>(random_.from(1900, 4100)));
    body.u16(static_cast<uint16_t>(random_.from(1900, 4100)));
  }

  void extreme_command(Body &body) {
    for (int field = 0; field < 5; ++field) body.u16(static_cast<uint16_t>(random_.magnitude(16)));
  }

  void any_payload(Body &body) {
    for (uint32_t left = random_.below(32); left > 0; --left) body.u8(random_.u8());
  }

  void noise(Wire &wire) {
    wire.length = static_cast<int>(random_.below(80));
    for (int i = 0; i < wire.length; ++i) wire.bytes[i] = random_.u8();
  }

  // What a cable does: bits turn, bytes get lost, come twice or change.
  void damage(Wire &wire) {
    for (uint32_t left = random_.from(1, 3); left > 0; --left) {
      const int at = static_cast<int>(random_.below(wire.length));
      switch (random_.below(4)) {
        case 0: wire.bytes[at] ^= static_cast<uint8_t>(1u << random_.below(8)); break;
        case 1: wire.bytes[at] = random_.u8(); break;
        case 2: wire.remove(at); break;
        default: wire.repeat(at);
      }
    }
  }

  void hear(uint8_t byte) {
    ++bytes_;
    uint8_t answer[MAX_FRAME_BYTES];
    const uint32_t now_us = static_cast<uint32_t>(ticks_ * 100);
    const Surroundings around = {7, true, 0};
    const int length = session_.hear(byte, now_us, around, answer);
    const bool may = model_.hear(byte);
    require((length > 0) == may, may ? "no answer" : "an answer to what is no frame of a host");
    if (length > 0) {
      ++answered_;
      model_.check_answer(answer, length);
    }
  }

  void wait() {
    const uint32_t one = random_.below(256);
    if (one < 160) return;
    if (one < 224) return run_ticks(random_.from(1, 8));
    if (one < 248) return run_ticks(random_.from(300, 330));
    if (one < 254) return run_ticks(random_.from(600, 1400));
    if (one < 255) return run_ticks(random_.from(1, 4000));
    if (random_.one_in(16)) silence();
  }

  // For longer than any ladder of the present limits takes.
  void silence() {
    run_ticks(model_.ladder_ticks() + 2);
    require(!mcu_.is_flying(), "silence did not latch the board");
  }

  void run_ticks(uint32_t ticks) {
    for (; ticks > 0; --ticks) tick();
  }

  void tick() {
    if (ticks_ % 200 == 0) {
      model_.frame_began();
      mcu_.frame_began(static_cast<uint32_t>(ticks_ * 100));
    }
    ++ticks_;
    const int step = mcu_.tick();
    model_.tick(step, mcu_.offered_half_us(SOURCE), mcu_.offered_half_us(SUFFERER));
    require(mcu_.is_flying() == model_.flying(), "it flies when it should not, or the reverse");
  }

  Random random_;
  uint64_t count_;
  Mcu mcu_;
  Session session_;
  Model model_;
  uint64_t ticks_ = 0, bytes_ = 0, answered_ = 0;
  uint64_t sent_[KINDS] = {};
};

const char *const Fuzz::NAMES[KINDS] = {"hellos",  "arms",  "disarms", "commands",  "extreme",
                                        "stale",   "damaged", "cut",   "misshapen", "noise"};

}  // namespace

int main(int arguments, char **words) {
  if (arguments != 3) {
    fprintf(stderr, "usage: frames_fuzz COUNT SEED\n");
    return 2;
  }
  Fuzz fuzz(strtoull(words[1], nullptr, 10), strtoull(words[2], nullptr, 10));
  fuzz.run();
  fuzz.print();
  return 0;
}
