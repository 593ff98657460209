/* avr_host PROGRAM.elf MCU: cycles of the second step, the lowest stack pointer, and the forces' bytes. */
#include <simavr/avr_ioport.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>

#define GPIOR0 0x3e
#define GPIOR1 0x4a
#define SPL 0x5d
#define LIMIT 2000000000ull

static avr_cycle_count_t began, took;
static int is_over;
static unsigned char bytes[64];
static int count;

static void on_mark(avr_t *avr, avr_io_addr_t address, uint8_t value, void *none)
{
    (void)address;
    (void)none;
    if (value == 1) {
        began = avr->cycle;
    } else if (value == 2) {
        took = avr->cycle - began;
    } else {
        is_over = 1;
    }
}

static void on_byte(avr_t *avr, avr_io_addr_t address, uint8_t value, void *none)
{
    (void)avr;
    (void)address;
    (void)none;
    if (count < (int)sizeof bytes) {
        bytes[count++] = value;
    }
}

int main(int argc, char **argv)
{
    elf_firmware_t firmware = {0};
    if (argc != 3 || elf_read_firmware(argv[1], &firmware) != 0) {
        return 2;
    }
    avr_t *avr = avr_make_mcu_by_name(argv[2]);
    if (avr == NULL || avr_init(avr) != 0) {
        return 2;
    }
    avr->log = LOG_NONE;
    firmware.frequency = 16000000;
    avr_load_firmware(avr, &firmware);
    avr_register_io_write(avr, GPIOR0, on_mark, NULL);
    avr_register_io_write(avr, GPIOR1, on_byte, NULL);
    unsigned lowest = 0xffff;
    while (!is_over && avr->cycle < LIMIT) {
        const int state = avr_run(avr);
        const unsigned stack = avr->data[SPL] | (unsigned)avr->data[SPL + 1] << 8;
        lowest = stack != 0 && stack < lowest ? stack : lowest;
        if (state == cpu_Done || state == cpu_Crashed) {
            break;
        }
    }
    printf("over %d cycles %llu lowest %u bytes", is_over, (unsigned long long)took, lowest);
    for (int i = 0; i < count; ++i) {
        printf(" %02x", bytes[i]);
    }
    printf("\n");
    return 0;
}
