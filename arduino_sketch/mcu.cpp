#include "mcu.h"

namespace {

// Idle until a host says otherwise: 1 ms, as ESCs expect.
const int32_t IDLE_AT_BOOT_HALF_US = 2 * 1000;

// Before these a motor moves with the rig's slew, from then on within its descent time.
const Rung RAMPS_FROM[MOTORS] = {BRAKE, RAMP};

}  // namespace

Mcu::Mcu() : limits_() {
  limits_.low_q16 = IDLE_AT_BOOT_HALF_US << 16;
  disarm();
  frame_began(0);
}

void Mcu::arm(const Limits &limits) {
  limits_ = limits;
  disarm();
  armed_ = true;
  latched_ = false;
  deadman_.start();
}

void Mcu::disarm() {
  armed_ = false;
  for (uint8_t motor = 0; motor < MOTORS; ++motor) {
    pulse_q16_[motor] = limits_.low_q16;
    target_q16_[motor] = limits_.low_q16;
  }
  brake_q16_ = limits_.low_q16;
  sink_q16_ = limits_.low_q16;
  stepper_.stop();
}

void Mcu::command(const Command &command) {
  if (!is_flying()) {
    return;
  }
  deadman_.heard();
  target_q16_[SOURCE] = limited_q16(command.source_half_us);
  target_q16_[SUFFERER] = limited_q16(command.sufferer_half_us);
  brake_q16_ = limited_q16(command.brake_half_us);
  sink_q16_ = limited_q16(command.sink_half_us);
  const int32_t asked_q16 = static_cast<int32_t>(command.carriage_steps_per_s) * 65536;
  stepper_.aim(clamped(asked_q16, -limits_.max_speed_q16, limits_.max_speed_q16));
}

int32_t Mcu::limited_q16(uint16_t half_us) const {
  // Clamped before the shift: a wire's 16 bits with 16 places do not fit a signed number.
  return clamped(half_us, limits_.low_q16 >> 16, limits_.high_q16 >> 16) << 16;
}

int8_t Mcu::tick() {
  const Rung rung = is_flying() ? watch() : FOLLOW;
  for (uint8_t motor = 0; motor < MOTORS; ++motor) {
    const bool ramps = rung >= RAMPS_FROM[motor];
    const int32_t most = ramps ? limits_.descent_q16[motor] : limits_.slew_q16;
    pulse_q16_[motor] = towards(pulse_q16_[motor], target_q16_[motor], most);
  }
  return stepper_.tick(limits_.accel_q16);
}

Rung Mcu::watch() {
  const Rung rung = deadman_.watch(limits_.ladder);
  if (rung != FOLLOW) {
    stepper_.aim(0);
  }
  if (rung >= BRAKE) {
    descend(rung);
  }
  latched_ = rung == LATCH;
  return rung;
}

void Mcu::descend(Rung rung) {
  target_q16_[SOURCE] = limits_.low_q16;
  if (rung == BRAKE) {
    target_q16_[SUFFERER] = brake_q16_;
  } else if (rung == SINK) {
    sink_q16_ = towards(sink_q16_, limits_.low_q16, limits_.sink_q16);
    target_q16_[SUFFERER] = sink_q16_;
  } else {
    target_q16_[SUFFERER] = limits_.low_q16;
  }
}

void Mcu::frame_began(uint32_t now_us) {
  applied_time_us_ = now_us;
  applied_half_us_[SOURCE] = offered_half_us(SOURCE);
  applied_half_us_[SUFFERER] = offered_half_us(SUFFERER);
}

uint16_t Mcu::offered_half_us(Motor motor) const {
  return static_cast<uint16_t>((pulse_q16_[motor] + 0x8000) >> 16);
}

void Mcu::fill(Status &status) const {
  status.faults = latched_ ? FAULT_DEADMAN : FAULT_NONE;
  status.armed = is_flying();
  status.source_half_us = applied_half_us_[SOURCE];
  status.sufferer_half_us = applied_half_us_[SUFFERER];
  status.steps = stepper_.steps();
  status.missed = deadman_.missed();
  status.applied_time_us = applied_time_us_;
}
