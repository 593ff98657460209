#include "frames.h"

namespace {

const uint8_t HEADER_BYTES = 7;
const uint8_t CRC_BYTES = 2;
const uint8_t MAX_BODY_BYTES = STATUS_FRAME_BYTES - 2;  // stuffing adds one byte, the end another

uint16_t crc16_with(uint16_t crc, uint8_t byte) {
  crc = static_cast<uint16_t>((crc >> 8) | (crc << 8));
  crc ^= byte;
  crc ^= static_cast<uint16_t>((crc & 0xFF) >> 4);
  crc ^= static_cast<uint16_t>(crc << 12);
  crc ^= static_cast<uint16_t>((crc & 0xFF) << 5);
  return crc;
}

// Reads little-endian numbers one after the other.
class Reader {
 public:
  explicit Reader(const uint8_t *bytes) : at_(bytes) {}

  uint8_t u8() { return *at_++; }
  uint16_t u16() {
    const uint16_t low = u8();
    return static_cast<uint16_t>(low | static_cast<uint16_t>(u8()) << 8);
  }
  uint32_t u32() {
    const uint32_t low = u16();
    return low | static_cast<uint32_t>(u16()) << 16;
  }

 private:
  const uint8_t *at_;
};

// A frame's bytes before stuffing, header first.
class Body {
 public:
  Body(FrameType type, uint16_t sequence, uint32_t time_us) {
    u8(type);
    u16(sequence);
    u32(time_us);
  }

  void u8(uint8_t value) { bytes_[length_++] = value; }
  void u16(uint16_t value) {
    u8(static_cast<uint8_t>(value));
    u8(static_cast<uint8_t>(value >> 8));
  }
  void u32(uint32_t value) {
    u16(static_cast<uint16_t>(value));
    u16(static_cast<uint16_t>(value >> 16));
  }

  // Appends the checksum, stuffs, ends with a zero.
  uint8_t to_wire(uint8_t *wire) {
    u16(crc16(bytes_, length_));
    uint8_t code_at = 0;
    uint8_t end = 1;
    for (uint8_t i = 0; i < length_; ++i) {
      if (bytes_[i] != 0) {
        wire[end++] = bytes_[i];
      } else {
        wire[code_at] = static_cast<uint8_t>(end - code_at);
        code_at = end++;
      }
    }
    wire[code_at] = static_cast<uint8_t>(end - code_at);
    wire[end++] = 0;
    return end;
  }

 private:
  uint8_t bytes_[MAX_BODY_BYTES];
  uint8_t length_ = 0;
};

// Undoes byte stuffing in place; the length of what it held, 0 when a block runs past the end.
// No block of 254 bytes fits into a frame, so that a zero follows every block but the last.
uint8_t unstuff(uint8_t *bytes, uint8_t length) {
  uint8_t from = 0;
  uint8_t to = 0;
  while (from < length) {
    uint8_t code = bytes[from];
    if (code > length - from) {
      return 0;
    }
    for (++from; code > 1; --code) {
      bytes[to++] = bytes[from++];
    }
    if (from < length) {
      bytes[to++] = 0;
    }
  }
  return to;
}

bool read_payload(Reader payload, uint8_t length, Frame &frame) {
  switch (frame.type) {
    case HELLO:
      frame.hello.oldest = payload.u8();
      frame.hello.newest = payload.u8();
      return length == 2;
    case ARM:
      frame.arm.low_half_us = payload.u16();
      frame.arm.high_half_us = payload.u16();
      frame.arm.slew_us_per_s = payload.u32();
      frame.arm.source_descent_ms = payload.u16();
      frame.arm.sufferer_descent_ms = payload.u16();
      frame.arm.max_speed_steps_per_s = payload.u16();
      frame.arm.max_accel_steps_per_s2 = payload.u32();
      frame.arm.brake_ms = payload.u16();
      frame.arm.sink_ms = payload.u16();
      frame.arm.sink_rate_us_per_s = payload.u16();
      return length == 24;
    case DISARM:
      return length == 0;
    case COMMAND:
      frame.command.source_half_us = payload.u16();
      frame.command.sufferer_half_us = payload.u16();
      frame.command.carriage_steps_per_s = static_cast<int16_t>(payload.u16());
      frame.command.brake_half_us = payload.u16();
      frame.command.sink_half_us = payload.u16();
      return length == 10;
    default:
      return false;
  }
}

}  // namespace

void count(uint16_t &counter) {
  if (counter < UINT16_MAX) {
    ++counter;
  }
}

uint16_t crc16(const uint8_t *bytes, uint8_t length) {
  uint16_t crc = 0xFFFF;
  for (uint8_t i = 0; i < length; ++i) {
    crc = crc16_with(crc, bytes[i]);
  }
  return crc;
}

bool FrameDecoder::take(uint8_t byte, Frame &frame) {
  if (byte == 0) {
    const bool is_something = length_ > 0;  // zeros in a row separate nothing
    const bool is_frame = !oversized_ && complete(frame);
    if (is_something && !is_frame) {
      count(dropped);
    }
    length_ = 0;
    oversized_ = false;
    return is_frame;
  }
  if (length_ == sizeof pending_) {
    oversized_ = true;
  } else {
    pending_[length_++] = byte;
  }
  return false;
}

bool FrameDecoder::complete(Frame &frame) {
  const uint8_t length = unstuff(pending_, length_);
  if (length < HEADER_BYTES + CRC_BYTES) {
    return false;
  }
  const uint8_t body = static_cast<uint8_t>(length - CRC_BYTES);
  if (crc16(pending_, body) != Reader(pending_ + body).u16()) {
    return false;
  }
  Reader header(pending_);
  frame.type = static_cast<FrameType>(header.u8());
  frame.sequence = header.u16();
  frame.time_us = header.u32();
  // A payload shorter than its type says is read past its end, within the buffer, and refused.
  return read_payload(header, static_cast<uint8_t>(body - HEADER_BYTES), frame);
}

uint8_t encode(uint16_t sequence, uint32_t time_us, const HelloReply &reply, uint8_t *wire) {
  Body body(HELLO_REPLY, sequence, time_us);
  body.u8(reply.version);
  body.u8(reply.board);
  body.u16(reply.boot);
  body.u16(reply.firmware);
  return body.to_wire(wire);
}

uint8_t encode(uint16_t sequence, uint32_t time_us, const Status &status, uint8_t *wire) {
  Body body(STATUS, sequence, time_us);
  body.u16(status.sequence);
  body.u16(status.boot);
  body.u8(status.faults);
  body.u8(static_cast<uint8_t>((status.armed ? 1 : 0) | (status.homed ? 2 : 0)));
  body.u16(status.source_half_us);
  body.u16(status.sufferer_half_us);
  body.u32(static_cast<uint32_t>(status.steps));
  body.u16(status.missed);
  body.u16(status.malformed);
  body.u32(status.applied_time_us);
  body.u16(status.battery_mv);
  return body.to_wire(wire);
}
