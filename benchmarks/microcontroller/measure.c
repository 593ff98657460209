/* Measures a step: instructions by SysTick, which QEMU lets run by counted instructions, and the
   stack by what remains of a pattern below it. The model is named by -DMODEL and -DMODEL_HEADER. */
#include MODEL_HEADER

#include <stdio.h>

#define JOINED(a, b) a##b
#define NAMED(a, b) JOINED(a, b)
#define STATE NAMED(MODEL, _state)
#define RESET NAMED(MODEL, _reset)
#define STEP NAMED(MODEL, _step)

#define WARM_UP 40
#define PAINTED 40000
#define PATTERN 0xA5u

#define SYSTICK_CTRL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_LOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_NOW (*(volatile uint32_t *)0xE000E018u)

static STATE state;
static float observation[INPUTS], force[OUTPUTS];

static uint32_t ticks_of(void (*what)(void))
{
    const uint32_t before = SYSTICK_NOW;
    what();
    return (before - SYSTICK_NOW) & 0xFFFFFFu;
}

static void nothing(void)
{
    __asm__ volatile("");
}

/* 2,000 instructions, for the scale. */
static void known(void)
{
    __asm__ volatile("mov r3, #1000\n1: subs r3, r3, #1\n bne 1b" ::: "r3", "cc");
}

void traced_step(void);

__attribute__((noinline)) void traced_step(void)
{
    STEP(&state, observation, force);
}

__attribute__((noinline)) static unsigned stack_of_a_step(void)
{
    volatile unsigned char *here = (volatile unsigned char *)__builtin_frame_address(0) - 64;
    for (int i = 0; i < PAINTED; ++i) {
        here[-i] = PATTERN;
    }
    traced_step();
    int deepest = PAINTED - 1;
    while (deepest > 0 && here[-deepest] == PATTERN) {
        --deepest;
    }
    return (unsigned)deepest + 64u;
}

int main(void)
{
    SYSTICK_LOAD = 0xFFFFFFu;
    SYSTICK_NOW = 0;
    SYSTICK_CTRL = 5;
    for (int i = 0; i < INPUTS; ++i) {
        observation[i] = SAMPLE;
    }
    RESET(&state);
    for (int i = 0; i < STEPS; ++i) {
        traced_step();
    }
    const uint32_t idle = ticks_of(nothing), scale = ticks_of(known) - idle;
    const uint32_t step = ticks_of(traced_step) - idle;
    printf("ticks %lu scale %lu stack %u state %u\n", (unsigned long)step, (unsigned long)scale,
           stack_of_a_step(), (unsigned)sizeof(STATE));
    return 0;
}
