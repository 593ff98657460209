// A C interface to the decision code, for ctypes.

#include <string.h>

#include "deadman.h"
#include "frames.h"
#include "mcu.h"
#include "session.h"

namespace {

int interrupts_stopped = 0;
int most_stopped = 0;

}  // namespace

void stop_interrupts() {
  ++interrupts_stopped;
  if (interrupts_stopped > most_stopped) most_stopped = interrupts_stopped;
}
void allow_interrupts() { --interrupts_stopped; }

extern "C" {

// 0 when every stop had its end and none was nested.
int unbalanced_interrupts() { return interrupts_stopped != 0 || most_stopped > 1; }

struct Board {
  Board(uint8_t reset_faults) : mcu(), session(mcu, reset_faults) {}
  Mcu mcu;
  Session session;
  Surroundings around = {1, true, 0};
  uint32_t tick = 0;
};

struct Trace {  // one row a tick
  uint16_t source_half_us;
  uint16_t sufferer_half_us;
  int8_t step;
};

Board *board_new(uint8_t reset_faults) { return new Board(reset_faults); }
void board_delete(Board *board) { delete board; }
void board_place(Board *board, uint16_t boot, int homed, uint16_t battery_mv) {
  board->around = Surroundings{boot, homed != 0, battery_mv};
}

int board_hear(Board *board, const uint8_t *bytes, int length, uint32_t now_us, uint8_t *answers) {
  int written = 0;
  for (int i = 0; i < length; ++i) {
    uint8_t wire[MAX_FRAME_BYTES];
    const uint8_t answer = board->session.hear(bytes[i], now_us, board->around, wire);
    memcpy(answers + written, wire, answer);
    written += answer;
  }
  return written;
}

// A servo frame begins with every `frame_ticks`-th tick. `trace` may be null.
void board_run(Board *board, uint32_t ticks, uint32_t frame_ticks, Trace *trace) {
  for (uint32_t i = 0; i < ticks; ++i) {
    if (board->tick % frame_ticks == 0) board->mcu.frame_began(board->tick * 100);
    const int8_t step = board->mcu.tick();
    ++board->tick;
    if (trace != nullptr) {
      const Mcu &mcu = board->mcu;
      trace[i] = Trace{mcu.offered_half_us(SOURCE), mcu.offered_half_us(SUFFERER), step};
    }
  }
}

int board_is_flying(const Board *board) { return board->mcu.is_flying(); }

MainLoopWatch *loop_watch_new() { return new MainLoopWatch; }
void loop_watch_delete(MainLoopWatch *watch) { delete watch; }
void loop_watch_turned(MainLoopWatch *watch) { watch->turned(); }
int loop_watch_may_feed(MainLoopWatch *watch, int is_flying) {
  return watch->may_feed(is_flying != 0);
}

void fault_bits(uint8_t *into) {
  into[0] = FAULT_NONE, into[1] = FAULT_DEADMAN, into[2] = FAULT_WATCHDOG, into[3] = FAULT_BROWNOUT;
}

uint16_t crc16_of(const uint8_t *bytes, int length) {
  return crc16(bytes, static_cast<uint8_t>(length));
}

FrameDecoder *decoder_new() { return new FrameDecoder; }
void decoder_delete(FrameDecoder *decoder) { delete decoder; }
uint16_t decoder_dropped(const FrameDecoder *decoder) { return decoder->dropped; }
int decoder_take(FrameDecoder *decoder, uint8_t byte, Frame *frame) {
  return decoder->take(byte, *frame);
}

int encode_hello_reply(uint16_t sequence, uint32_t time_us, const HelloReply *reply,
                       uint8_t *wire) {
  return encode(sequence, time_us, *reply, wire);
}
int encode_status(uint16_t sequence, uint32_t time_us, const Status *status, uint8_t *wire) {
  return encode(sequence, time_us, *status, wire);
}

}  // extern "C"
