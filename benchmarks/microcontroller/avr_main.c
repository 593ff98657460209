/* Two steps on an AVR, each between two writes to GPIOR0, which the simulator's host watches. */
#include MODEL_HEADER

#include <avr/io.h>

#define JOINED(a, b) a##b
#define NAMED(a, b) JOINED(a, b)

static NAMED(MODEL, _state) state;
static float observation[INPUTS], force[OUTPUTS];

int main(void)
{
    for (int i = 0; i < INPUTS; ++i) {
        observation[i] = 0.1f;
    }
    NAMED(MODEL, _reset)(&state);
    for (uint8_t i = 0; i < 2; ++i) {
        GPIOR0 = 1;
        NAMED(MODEL, _step)(&state, observation, force);
        GPIOR0 = 2;
    }
    for (int i = 0; i < OUTPUTS; ++i) { /* the bytes of the forces, so that they can be compared */
        const uint8_t *bytes = (const uint8_t *)&force[i];
        for (uint8_t j = 0; j < 4; ++j) {
            GPIOR1 = bytes[j];
        }
    }
    GPIOR0 = 3;
    for (;;) {
    }
}
