// The UNO of the gantry: pulses for two ESCs, steps for the carriage, a deadman.
//
// This file is the electronics: timers, pins, serial port, watchdog. What is decided, and when, is
// in the other files, which know of no Arduino and are tested on a PC. Open it in the Arduino IDE,
// choose "Arduino Uno", upload; it needs no library.
//
// Timer1  50 Hz frames of both pulses, made by the hardware alone, in half microseconds.
// Timer2  10 kHz: steps, slew, deadman. It goes on when the main loop hangs.
// Timer0  the core's clock, micros().

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <util/delay.h>

#include "deadman.h"
#include "frames.h"
#include "mcu.h"
#include "pins.h"
#include "session.h"

// 250,000 baud is exact on 16 MHz (115,200 is off by 2 %). A command and its answer take 2.2 ms on
// the wire, of the loop's 31 ms. 500,000 would save half of it, but leave 40 us in which the chip
// holds two bytes for a 10 kHz interrupt that takes up to 47 us; here it is 80 us.
const uint32_t BAUD = 250000;

const uint16_t FRAME_TOP = 39999;     // 20 ms in half microseconds
const uint8_t TICK_TOP = 199;         // 100 us in half microseconds
const uint8_t TICK_PHASE = 100;       // ticks fall midway between two frames' ends, never on one
const uint16_t BATTERY_PERIOD_MS = 100;
const uint16_t STARVED = 0x5A17;
uint16_t *const BOOTS_IN_EEPROM = 0;

// Kept over a reset. Some bootloaders clear MCUSR (by its source Optiboot does, which an UNO comes
// with), hence the second mark: set while the interrupt leaves the watchdog unfed because the main
// loop hangs. A watchdog that bites for want of interrupts, and a brownout, have no such mark: behind
// a bootloader like that the count of boots alone tells of them. Tried on a simulated chip only,
// which has no bootloader.
uint8_t reset_flags __attribute__((section(".noinit")));
uint16_t starved __attribute__((section(".noinit")));

// Before main: the watchdog stays on after its own reset, and would bite again while booting.
void keep_reset_flags() __attribute__((naked, used, section(".init3")));
void keep_reset_flags() {
  reset_flags = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

uint8_t faults_of_the_reset() {
  uint8_t faults = FAULT_NONE;
  if ((reset_flags & _BV(WDRF)) || starved == STARVED) {
    faults |= FAULT_WATCHDOG;
  }
  if ((reset_flags & _BV(BORF)) && !(reset_flags & _BV(PORF))) {
    faults |= FAULT_BROWNOUT;  // switching on passes through low voltages, too
  }
  return faults;
}

Mcu mcu;
MainLoopWatch main_loop;
Session session(mcu, faults_of_the_reset());
Surroundings around = {0, false, 0};

void stop_interrupts() { cli(); }
void allow_interrupts() { sei(); }

void offer_pulses() {
  // A channel is high from 0 to OCR1x, one count more than it says. The timer takes both with its
  // next frame, so a pulse is never cut.
  OCR1A = mcu.offered_half_us(SOURCE) - 1;
  OCR1B = mcu.offered_half_us(SUFFERER) - 1;
}

// Drivers for a NEMA 23 want up to 5 us of direction before a step, and up to 5 us of step. Only a
// reversal waits for the first. The core's delayMicroseconds would be too short by a microsecond.
void move_carriage(int8_t step) {
  if (step == 0) {
    return;
  }
  const uint8_t direction = step > 0 ? _BV(DIRECTION_PIN) : 0;
  if ((PORTD & _BV(DIRECTION_PIN)) != direction) {
    PORTD ^= _BV(DIRECTION_PIN);
    _delay_us(5);
  }
  PORTD |= _BV(STEP_PIN);
  _delay_us(5);
  PORTD &= ~_BV(STEP_PIN);
}

void feed_watchdog() {
  if (main_loop.may_feed(mcu.is_flying())) {
    wdt_reset();
    starved = 0;
  } else {
    starved = STARVED;
  }
}

ISR(TIMER2_COMPA_vect) {
  if (TIFR1 & _BV(TOV1)) {
    TIFR1 = _BV(TOV1);
    mcu.frame_began(micros() - TCNT1 / 2);
  }
  const int8_t step = mcu.tick();
  offer_pulses();
  move_carriage(step);
  feed_watchdog();
}

void start_timers() {
  cli();
  GTCCR = _BV(TSM) | _BV(PSRASY) | _BV(PSRSYNC);  // all prescalers stand until the last line
  TCCR1B = 0;
  TCCR1A = 0;
  offer_pulses();  // at once in this mode; the next one waits for the frame's end
  TCNT1 = 0;
  ICR1 = FRAME_TOP;
  TCCR1A = _BV(COM1A1) | _BV(COM1B1) | _BV(WGM11);  // mode 14: fast PWM up to ICR1
  TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS11);     // 2 MHz
  TCCR2A = _BV(WGM21);                              // clear timer on compare match
  TCCR2B = _BV(CS21);                               // 2 MHz
  OCR2A = TICK_TOP;
  TCNT2 = TICK_PHASE;
  TIMSK2 = _BV(OCIE2A);
  GTCCR = 0;
  sei();
}

void count_boot() {
  around.boot = eeprom_read_word(BOOTS_IN_EEPROM) + 1;
  eeprom_update_word(BOOTS_IN_EEPROM, around.boot);
}

void measure_battery() {
  static uint16_t last_ms = -BATTERY_PERIOD_MS;  // at once, for the first host may arm at once
  const uint16_t now_ms = millis();
  if (static_cast<uint16_t>(now_ms - last_ms) < BATTERY_PERIOD_MS) {
    return;
  }
  last_ms = now_ms;
  const uint32_t reading = analogRead(BATTERY_PIN);
  const uint16_t battery_mv = reading * BATTERY_FULL_SCALE_MV / 1024;
  around.battery_mv = battery_mv < BATTERY_LEAST_MV ? 0 : battery_mv;
}

void listen() {
  while (Serial.available() > 0) {
    uint8_t wire[MAX_FRAME_BYTES];
    around.homed = digitalRead(HOME_PIN) == LOW;
    const uint8_t length = session.hear(Serial.read(), micros(), around, wire);
    Serial.write(wire, length);
  }
}

void setup() {
  count_boot();
  pinMode(SOURCE_ESC_PIN, OUTPUT);
  pinMode(SUFFERER_ESC_PIN, OUTPUT);
  pinMode(STEP_PIN, OUTPUT);
  pinMode(DIRECTION_PIN, OUTPUT);
  pinMode(HOME_PIN, INPUT_PULLUP);
  Serial.begin(BAUD);
  start_timers();
  wdt_enable(WDTO_120MS);
}

void loop() {
  main_loop.turned();
  listen();
  measure_battery();
  set_sleep_mode(SLEEP_MODE_IDLE);
  sleep_mode();  // until the next interrupt, 100 us at most
}
