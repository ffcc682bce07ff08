/* Runs a program for the ATmega328P in simavr, and writes down when its pins change.
 *
 *   avr_trace PROGRAM.hex SECONDS TRACE.vcd EEPROM.bin BAUD [SECONDS:HEX …]
 *
 * TRACE.vcd: the pins of ports B, C and D, in steps of 100 ps (a clock cycle is 62.5 ns). EEPROM.bin: read before the
 * start where it is there, written at the end. SECONDS:HEX: bytes that arrive on the serial line from then on, at BAUD.
 * What the program sends goes to standard output.
 *
 * simavr looks for what is due only between two instructions, so up to 3 cycles late. An edge that the program makes is
 * noted when it is made; one that Timer1 makes by itself is noted at the cycle that it was due, as hardware would do it.
 */
#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_hex.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CLOCK_HZ 16000000.0
#define EEPROM_BYTES 1024
#define TICKS_PER_CYCLE 625 /* in 100 ps */

static avr_t *avr;
static avr_timer_t *timer1;
static avr_uart_t *uart;
static FILE *trace;
static avr_cycle_count_t late; /* lateness of simavr's match of Timer1 that it is about to show on a pin */
static unsigned char level[3][8];

static char signal_of(int port, int pin) { return (char)('!' + 8 * port + pin); }

/* A match of Timer1 with OCR1A or OCR1B (0, 1) that moves OC1A or OC1B. simavr calls this first, then `on_pin`. */
static void on_match(struct avr_irq_t *irq, uint32_t value, void *comparator)
{
    (void)irq, (void)value;
    late = (uint16_t)(avr->cycle - timer1->tov_base - timer1->comp[(intptr_t)comparator].comp_cycles);
}

static void on_pin(struct avr_irq_t *irq, uint32_t value, void *port_index)
{
    const int port = (int)(intptr_t)port_index, pin = irq->irq;
    if (level[port][pin] == (value & 1))
        return;
    level[port][pin] = value & 1;
    const unsigned long long cycle = avr->cycle - late;
    late = 0;
    fprintf(trace, "#%llu\n%u%c\n", cycle * TICKS_PER_CYCLE, value & 1, signal_of(port, pin));
}

static void on_serial_out(struct avr_irq_t *irq, uint32_t value, void *unused)
{
    (void)irq, (void)unused;
    putchar((int)value);
}

static void fail(const char *what, const char *name)
{
    fprintf(stderr, "avr_trace: %s: %s\n", name, what);
    exit(2);
}

static struct {
    char **waiting; /* SECONDS:HEX each, in order of time */
    int count;
    const char *hex; /* the rest of the one that has begun */
    avr_cycle_count_t cycles_per_byte;
} arrivals;

/* Takes the next one; the cycle at which it begins. */
static avr_cycle_count_t next_arrival(void)
{
    char *colon;
    const double seconds = strtod(*arrivals.waiting++, &colon);
    arrivals.count--;
    arrivals.hex = colon + 1;
    return (avr_cycle_count_t)(seconds * CLOCK_HZ);
}

static avr_cycle_count_t on_arrival(avr_t *to, avr_cycle_count_t when, void *unused)
{
    unsigned byte;
    (void)unused;
    if (sscanf(arrivals.hex, "%2x", &byte) != 1)
        fail("must be SECONDS:HEX", "arrivals");
    uart->cycles_per_byte = arrivals.cycles_per_byte; /* simavr 1.6 takes longer: it counts a parity bit that is not there */
    avr_raise_irq(avr_io_getirq(to, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT), byte);
    arrivals.hex += 2;
    const avr_cycle_count_t line_free = when + arrivals.cycles_per_byte;
    if (*arrivals.hex)
        return line_free;
    const avr_cycle_count_t next = arrivals.count ? next_arrival() : 0;
    return next && next < line_free ? line_free : next;
}

static void no_waiting(avr_t *of, avr_cycle_count_t cycles) { (void)of, (void)cycles; }

static void start(const char *program)
{
    uint32_t size = 0, at = 0;
    uint8_t *code = read_ihex_file(program, &size, &at);
    if (!code)
        fail("cannot be read", program);
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr)
        fail("not known to this simavr", "atmega328p");
    avr_init(avr);
    avr->frequency = (uint32_t)CLOCK_HZ;
    avr->sleep = no_waiting;
    avr_loadcode(avr, code, size, at);
    avr->codeend = at + size;
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1')
            timer1 = (avr_timer_t *)io;
        else if (!strcmp(io->kind, "uart"))
            uart = (avr_uart_t *)io;
}

static void watch_pins(const char *to)
{
    trace = fopen(to, "w");
    if (!trace)
        fail("cannot be written", to);
    fprintf(trace, "$timescale 100 ps $end\n");
    for (int comparator = 0; comparator < 2; comparator++) {
        avr_irq_t *match = timer1->io.irq + TIMER_IRQ_OUT_COMP + comparator;
        avr_irq_register_notify(match, on_match, (void *)(intptr_t)comparator);
    }
    for (int port = 0; port < 3; port++)
        for (int pin = 0; pin < 8; pin++) {
            fprintf(trace, "$var wire 1 %c P%c%d $end\n", signal_of(port, pin), 'B' + port, pin);
            avr_irq_register_notify(
                avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B' + port), pin), on_pin, (void *)(intptr_t)port);
        }
    fprintf(trace, "$enddefinitions $end\n#0\n");
    for (int port = 0; port < 3; port++)
        for (int pin = 0; pin < 8; pin++)
            fprintf(trace, "0%c\n", signal_of(port, pin));
}

static void open_serial_line(char **waiting, int count, double baud)
{
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_serial_out, NULL);
    arrivals.waiting = waiting;
    arrivals.count = count;
    arrivals.cycles_per_byte = (avr_cycle_count_t)(10 * CLOCK_HZ / baud);
    if (count)
        avr_cycle_timer_register(avr, next_arrival(), on_arrival, NULL);
}

static void load_eeprom(const char *from)
{
    uint8_t bytes[EEPROM_BYTES];
    FILE *file = fopen(from, "rb");
    memset(bytes, 0xFF, sizeof bytes);
    if (file && fread(bytes, 1, sizeof bytes, file) != sizeof bytes)
        fail("must have 1024 bytes", from);
    if (file)
        fclose(file);
    avr_eeprom_desc_t all = {.ee = bytes, .offset = 0, .size = sizeof bytes};
    avr_ioctl(avr, AVR_IOCTL_EEPROM_SET, &all);
}

static void save_eeprom(const char *to)
{
    avr_eeprom_desc_t all = {.ee = NULL, .offset = 0, .size = EEPROM_BYTES};
    avr_ioctl(avr, AVR_IOCTL_EEPROM_GET, &all);
    FILE *file = fopen(to, "wb");
    if (!file || fwrite(all.ee, 1, EEPROM_BYTES, file) != EEPROM_BYTES || fclose(file))
        fail("cannot be written", to);
}

int main(int argc, char **argv)
{
    if (argc < 6)
        fail("usage: avr_trace PROGRAM.hex SECONDS TRACE.vcd EEPROM.bin BAUD [SECONDS:HEX ...]", "arguments");
    const avr_cycle_count_t end = (avr_cycle_count_t)(strtod(argv[2], NULL) * CLOCK_HZ);
    start(argv[1]);
    load_eeprom(argv[4]);
    watch_pins(argv[3]);
    open_serial_line(argv + 6, argc - 6, strtod(argv[5], NULL));
    while (avr->cycle < end) {
        const int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed)
            fail("stopped before the end", argv[1]);
    }
    fprintf(trace, "#%llu\n", (unsigned long long)avr->cycle * TICKS_PER_CYCLE);
    if (fclose(trace))
        fail("cannot be written", argv[3]);
    save_eeprom(argv[4]);
    return 0;
}
