/* What a Cortex-M needs before main: vectors, the FPU switched on, data and zeros in place. Output and
   the exit status go through semihosting, the debugger's interface that QEMU answers. */
#include <stdint.h>

extern uint32_t __stack, __data_load, __data_start__, __data_end__, __bss_start__, __bss_end__;
extern int main(void);
extern void initialise_monitor_handles(void);
extern void exit(int);

void Reset_Handler(void);
void Fault_Handler(void);
void _init(void) {}
void _fini(void) {}

__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &__stack,             (const void *)Reset_Handler, (const void *)Fault_Handler,
    (const void *)Fault_Handler, (const void *)Fault_Handler, (const void *)Fault_Handler,
    (const void *)Fault_Handler};

void Fault_Handler(void)
{
    exit(3);
}

__attribute__((noreturn)) void Reset_Handler(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* CPACR: the FPU for everyone */
    __asm__ volatile("dsb\n isb");
    const uint32_t *from = &__data_load;
    for (uint32_t *to = &__data_start__; to < &__data_end__; ++to, ++from) {
        *to = *from;
    }
    for (uint32_t *to = &__bss_start__; to < &__bss_end__; ++to) {
        *to = 0;
    }
    initialise_monitor_handles();
    exit(main());
}
