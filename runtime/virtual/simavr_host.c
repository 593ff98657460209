/* An UNO on a simulated ATmega328P, driven in virtual time through the functions at the end.

   One simulator per process: simavr and this file keep theirs in global variables. Two defects of
   simavr 1.6 are repaired here while it runs: its ATmega328P does not know Timer1's mode 14, and a
   write to OCR1 acts at once instead of with the next frame. Not to be relied on: it takes twelve
   bits of time for a byte on the UART, knows no receive overrun, and keeps PWM going through a
   watchdog's reset. */

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_extint.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_io.h>

enum { BYTE_CYCLES = 12 * 64, QUEUE = 1 << 16, EDGES = 1 << 16 };
enum { OCR1AL = 0x88, OCR1BL = 0x8A, TIMER2_COMPA = 7 };
enum { SOURCE_BIT = 1, SUFFERER_BIT = 2, STEP_BIT = 2, DIRECTION_BIT = 3, HOME_BIT = 4 };

typedef struct {
  uint64_t cycle;
  uint8_t pin; /* of the UNO: 9, 10, 2, 3 */
  uint8_t level;
} Edge;

static avr_t *avr;
static avr_timer_t *timer1;
static avr_irq_t *uart_input;
static avr_cycle_count_t boots_until;

static uint8_t to_board[QUEUE], from_board[QUEUE];
static uint32_t to_head, to_tail, from_length;

static Edge edges[EDGES];
static uint32_t edge_count, edges_lost;
static uint8_t levels[20];
static int64_t steps;
static uint64_t tick_began, longest_tick;

/* Timer1 */

static struct {
  avr_io_write_t write; /* simavr's own */
  void *param;
  uint8_t low, high, waits;
} compare[2];

static void apply_compare(int channel) {
  const avr_io_addr_t address = channel ? OCR1BL : OCR1AL;
  compare[channel].waits = 0;
  avr->data[address + 1] = compare[channel].high;
  avr->data[address] = (uint8_t)~compare[channel].low; /* simavr looks whether it changed */
  compare[channel].write(avr, address, compare[channel].low, compare[channel].param);
}

static avr_cycle_count_t frame_began(avr_t *unused, avr_cycle_count_t when, void *param) {
  (void)unused, (void)when, (void)param;
  for (int channel = 0; channel < 2; ++channel)
    if (compare[channel].waits) apply_compare(channel);
  return 0;
}

static void write_compare(avr_t *unused, avr_io_addr_t address, uint8_t low, void *param) {
  const int channel = address == OCR1BL;
  (void)unused, (void)param;
  compare[channel].low = low;
  compare[channel].high = avr->data[address + 1];
  compare[channel].waits = 1;
  if (timer1->mode.kind != avr_timer_wgm_fast_pwm) apply_compare(channel);
}

static void repair_timer1(void) {
  for (avr_io_t *io = avr->io_port; io; io = io->next)
    if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1') timer1 = (avr_timer_t *)io;
  timer1->wgm_op[14] = (avr_timer_wgm_t)AVR_TIMER_WGM_ICFASTPWM();
  for (int channel = 0; channel < 2; ++channel) {
    const avr_io_addr_t index = AVR_DATA_TO_IO(channel ? OCR1BL : OCR1AL);
    compare[channel].write = avr->io[index].w.c;
    compare[channel].param = avr->io[index].w.param;
    avr->io[index].w.c = write_compare;
  }
}

/* Pins */

static void note_edge(uint8_t pin, uint8_t level) {
  if (levels[pin] == level) return;
  levels[pin] = level;
  if (edge_count < EDGES)
    edges[edge_count++] = (Edge){avr->cycle, pin, level};
  else
    ++edges_lost;
}

static void esc_changed(avr_irq_t *irq, uint32_t value, void *param) {
  const uint8_t pin = (uint8_t)(uintptr_t)param;
  (void)irq;
  /* Both pins rise with the frame; what was written before it acts from here on. */
  if (value && !levels[pin]) avr_cycle_timer_register(avr, 1, frame_began, NULL);
  note_edge(pin, value != 0);
}

static void step_changed(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)param;
  if (value && !levels[2]) steps += levels[3] ? 1 : -1;
  note_edge(2, value != 0);
}

static void direction_changed(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)param;
  note_edge(3, value != 0);
}

static avr_irq_t *pin_irq(char port, int bit) {
  return avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit);
}

static void tick_changed(avr_irq_t *irq, uint32_t is_running, void *param) {
  (void)irq, (void)param;
  if (is_running)
    tick_began = avr->cycle;
  else if (avr->cycle - tick_began > longest_tick)
    longest_tick = avr->cycle - tick_began;
}

/* The step and direction pins are those of two external interrupts, too, which the sketch does not use.
   While one is low, simavr would wake the core in every cycle to see whether it is to interrupt: ten
   times slower, too slow for real time on a slow computer. */
static void ignore_external_interrupts(void) {
  avr_extint_set_strict_lvl_trig(avr, 0, 0);
  avr_extint_set_strict_lvl_trig(avr, 1, 0);
}

static void watch_pins(void) {
  avr_irq_register_notify(avr_get_interrupt_irq(avr, TIMER2_COMPA) + AVR_INT_IRQ_RUNNING,
                          tick_changed, NULL);
  avr_irq_register_notify(pin_irq('B', SOURCE_BIT), esc_changed, (void *)9);
  avr_irq_register_notify(pin_irq('B', SUFFERER_BIT), esc_changed, (void *)10);
  avr_irq_register_notify(pin_irq('D', STEP_BIT), step_changed, NULL);
  avr_irq_register_notify(pin_irq('D', DIRECTION_BIT), direction_changed, NULL);
}

/* Serial port */

static void byte_came(avr_irq_t *irq, uint32_t value, void *param) {
  (void)irq, (void)param;
  if (from_length < QUEUE) from_board[from_length++] = (uint8_t)value;
}

static avr_cycle_count_t send_byte(avr_t *unused, avr_cycle_count_t when, void *param) {
  (void)unused, (void)param;
  avr_raise_irq(uart_input, to_board[to_head++ % QUEUE]);
  return to_head == to_tail ? 0 : when + BYTE_CYCLES;
}

static void connect_uart(void) {
  uint32_t flags = 0; /* no echo to this process' output, no sleeping */
  avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
  uart_input = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT),
                          byte_came, NULL);
}

static void sleep_in_virtual_time(avr_t *unused, avr_cycle_count_t cycles) {
  (void)unused, (void)cycles;
}

static avr_cycle_count_t stop_here(avr_t *unused, avr_cycle_count_t when, void *param) {
  (void)unused, (void)when, (void)param;
  return 0; /* the core runs, or sleeps, up to the next of these */
}

static void tell_errors(avr_t *unused, const int level, const char *format, va_list arguments) {
  (void)unused;
  if (level <= LOG_ERROR) vfprintf(stderr, format, arguments);
}

/* What Python calls */

int sim_start(const char *elf) {
  elf_firmware_t firmware;
  memset(&firmware, 0, sizeof firmware);
  avr_global_logger_set(tell_errors);
  if (avr || elf_read_firmware(elf, &firmware)) return -1;
  avr = avr_make_mcu_by_name("atmega328p");
  if (!avr) return -1;
  avr_init(avr);
  firmware.frequency = 16000000;
  avr_load_firmware(avr, &firmware);
  avr->frequency = 16000000;
  avr->vcc = avr->avcc = avr->aref = 5000;
  avr->sleep = sleep_in_virtual_time;
  repair_timer1();
  ignore_external_interrupts();
  watch_pins();
  connect_uart();
  return 0;
}

uint64_t sim_cycle(void) { return avr->cycle; }

/* Runs until this cycle, give or take an instruction; -1 when the program crashed. */
int sim_run(uint64_t until) {
  if (avr->cycle < boots_until) avr->cycle = until < boots_until ? until : boots_until;
  if (avr->cycle < until) avr_cycle_timer_register(avr, until - avr->cycle, stop_here, NULL);
  while (avr->cycle < until) {
    if (avr->state != cpu_Running && avr->state != cpu_Sleeping) return -1;
    avr_run(avr);
  }
  return 0;
}

/* Opening the port resets an UNO; its bootloader then takes some time, and loses what comes. What the
   chip's register of resets, at 0x54, says then is `reset_flags`: bootloaders differ in what they leave. */
void sim_open_port(uint64_t boot_cycles, uint8_t reset_flags) {
  avr_reset(avr);
  ignore_external_interrupts(); /* a reset forgets it */
  avr->data[0x54] = reset_flags;
  note_edge(9, 0), note_edge(10, 0), note_edge(2, 0), note_edge(3, 0);
  compare[0].waits = compare[1].waits = 0;
  to_head = to_tail = from_length = 0;
  boots_until = avr->cycle + boot_cycles;
}

static int sim_is_booting(void) { return avr->cycle < boots_until; }

/* The number of bytes taken; none while the bootloader runs. */
int sim_send(const uint8_t *bytes, int length) {
  int taken = 0;
  if (sim_is_booting()) return length;
  while (taken < length && to_tail - to_head < QUEUE) to_board[to_tail++ % QUEUE] = bytes[taken++];
  if (to_head != to_tail && !avr_cycle_timer_status(avr, send_byte, NULL))
    avr_cycle_timer_register(avr, BYTE_CYCLES, send_byte, NULL);
  return taken;
}

int sim_receive(uint8_t *bytes, int room) {
  const uint32_t length = from_length < (uint32_t)room ? from_length : (uint32_t)room;
  memcpy(bytes, from_board, length);
  memmove(from_board, from_board + length, from_length - length);
  from_length -= length;
  return (int)length;
}

/* Edges on the pins since the last call; -1, and none kept, when there were too many. */
int sim_edges(Edge *into, int room) {
  const uint32_t count = edge_count, lost = edges_lost;
  edge_count = edges_lost = 0;
  if (lost || count > (uint32_t)room) return -1;
  memcpy(into, edges, count * sizeof *into);
  return (int)count;
}

/* Bytes on their way to the board. */
int sim_pending(void) { return (int)(to_tail - to_head); }

/* Cycles of the longest run of the 10 kHz interrupt since the last call. */
uint64_t sim_longest_tick(void) {
  const uint64_t longest = longest_tick;
  longest_tick = 0;
  return longest;
}

/* Pulses on the step pin since the start, each counted with its direction. */
int64_t sim_steps(void) { return steps; }

void sim_set_home(int is_closed) {
  const uint8_t mask = 1 << HOME_BIT;
  avr_ioport_external_t outside = {.name = 'D', .mask = mask, .value = is_closed ? 0 : mask};
  avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('D'), &outside); /* stronger than the pull-up */
  avr_raise_irq(pin_irq('D', HOME_BIT), !is_closed);
}

void sim_set_battery_pin(uint32_t millivolts) {
  avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0), millivolts);
}


/* Puts another instruction where the main loop sleeps; -1 unless there is one such place. */
int sim_replace_sleep(uint16_t instruction) {
  enum { SLEEP = 0x9588 };
  static uint32_t place, places;
  for (uint32_t at = 0, end = place ? 0 : avr->codeend; at < end; at += 2)
    if ((avr->flash[at] | avr->flash[at + 1] << 8) == SLEEP) place = at, ++places;
  if (places != 1) return -1;
  avr->flash[place] = (uint8_t)instruction;
  avr->flash[place + 1] = (uint8_t)(instruction >> 8);
  return 0;
}
