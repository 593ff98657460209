"""C exports on simulated microcontrollers: do they give the same, and what do they take?

In: a folder of `wakedeploy export --c`, gcc-arm-none-eabi and qemu-system-arm. Out: the self-test's
verdict, instructions counted by the simulator, stack, RAM, and flash from the linker's map. The
simulator counts instructions, not cycles; `cycles` estimates these from the executed instructions.
"""
