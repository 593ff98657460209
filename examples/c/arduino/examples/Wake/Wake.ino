// Steps the predictor at its rate and prints the force and how long a step took.
// An observation comes as one line of numbers over the serial port, in the order and the units of
// wake.h; without one, the last stays.
#include <wake.h>

static wake_state state;
static float observation[WAKE_INPUTS];
static float force[WAKE_OUTPUTS];
static unsigned long next_us;
static unsigned long steps;

static const unsigned long PERIOD_US = (unsigned long)(1e6f / WAKE_RATE_HZ);

static void readObservation() {
  if (Serial.available() == 0) {
    return;
  }
  for (int i = 0; i < WAKE_INPUTS; ++i) {
    observation[i] = Serial.parseFloat();
  }
}

void setup() {
  Serial.begin(115200);
  Serial.setTimeout(5);
  wake_reset(&state);
  next_us = micros();
}

void loop() {
  if ((long)(micros() - next_us) < 0) {
    return;
  }
  next_us += PERIOD_US;
  readObservation();
  const unsigned long began_us = micros();
  wake_step(&state, observation, force);
  const unsigned long took_us = micros() - began_us;
  ++steps;
  if (steps < WAKE_WARM_UP_STEPS) {
    return;  // its memory is not full
  }
  for (int i = 0; i < WAKE_OUTPUTS; ++i) {
    Serial.print(force[i], 6);
    Serial.print(' ');
  }
  Serial.println(took_us);
}
