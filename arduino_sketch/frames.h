// The wire between Pi and UNO, byte for byte that of runtime/io/protocol.py.
//
// A frame before byte stuffing, little-endian: type u8, sequence u16, sender's time u32 [us],
// payload, CRC-16/CCITT u16 over everything before it. Stuffed (COBS) and ended by a zero byte.
// Pulse widths travel in half microseconds, the resolution of Timer1.

#ifndef FRAMES_H
#define FRAMES_H

#include <stdint.h>

const uint8_t PROTOCOL_VERSION = 2;
const uint8_t MAX_FRAME_BYTES = 64;  // with its ending zero
const uint8_t STATUS_FRAME_BYTES = 35;

enum FrameType : uint8_t {
  HELLO = 0x01,
  ARM = 0x02,
  DISARM = 0x03,
  COMMAND = 0x04,
  HELLO_REPLY = 0x81,
  STATUS = 0x84
};

enum Fault : uint8_t { FAULT_NONE = 0, FAULT_DEADMAN = 1, FAULT_WATCHDOG = 2, FAULT_BROWNOUT = 4 };

struct Hello {
  uint8_t oldest;
  uint8_t newest;
};

struct Arm {
  uint16_t low_half_us;
  uint16_t high_half_us;
  uint32_t slew_us_per_s;
  uint16_t source_descent_ms;
  uint16_t sufferer_descent_ms;
  uint16_t max_speed_steps_per_s;
  uint32_t max_accel_steps_per_s2;
  uint16_t brake_ms;  // how long a descent without commands brakes, then sinks
  uint16_t sink_ms;
  uint16_t sink_rate_us_per_s;  // how fast the sink pulse is taken back
};

struct Command {
  uint16_t source_half_us;
  uint16_t sufferer_half_us;
  int16_t carriage_steps_per_s;
  uint16_t brake_half_us;  // the sufferer's, should no other command come
  uint16_t sink_half_us;
};

// What a host may say. A frame of any other type is malformed here.
struct Frame {
  FrameType type;
  uint16_t sequence;
  uint32_t time_us;
  union {
    Hello hello;
    Arm arm;
    Command command;
  };
};

struct HelloReply {
  uint8_t version;  // 0: none fits
  uint8_t board;
  uint16_t boot;
  uint16_t firmware;
};

struct Status {
  uint16_t sequence;  // of the last frame accepted
  uint16_t boot;
  uint8_t faults;
  bool armed;
  bool homed;
  uint16_t source_half_us;  // pulse widths now on the pins
  uint16_t sufferer_half_us;
  int32_t steps;
  uint16_t missed;     // command periods that passed without a command
  uint16_t malformed;  // frames dropped
  uint32_t applied_time_us;
  uint16_t battery_mv;  // 0: not measured
};

// Adds one to a counter that stays at its end instead of wrapping.
void count(uint16_t &counter);

uint16_t crc16(const uint8_t *bytes, uint8_t length);

// Takes bytes as they arrive, gives whole frames, drops and counts everything else.
class FrameDecoder {
 public:
  // True when this byte completes a frame.
  bool take(uint8_t byte, Frame &frame);

  uint16_t dropped = 0;

 private:
  bool complete(Frame &frame);

  uint8_t pending_[MAX_FRAME_BYTES - 1];
  uint8_t length_ = 0;
  bool oversized_ = false;
};

// The bytes of a frame on the wire, ending zero included; returns how many. `wire` has room for
// MAX_FRAME_BYTES.
uint8_t encode(uint16_t sequence, uint32_t time_us, const HelloReply &reply, uint8_t *wire);
uint8_t encode(uint16_t sequence, uint32_t time_us, const Status &status, uint8_t *wire);

#endif
