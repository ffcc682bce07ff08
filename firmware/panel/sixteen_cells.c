/* Panel driver with one output for each of 4 × 4 cells, for an ATmega328P at 16 MHz (Arduino Uno, Nano).
 *
 *   cells 0 to 5     D2 to D7     (PD2 to PD7)     row by row from the top left, as the marker is seen from the front
 *   cells 6 to 11    D8 to D13    (PB0 to PB5)
 *   cells 12 to 15   A0 to A3     (PC0 to PC3)
 *   D0, D1           serial line, 9600 baud 8N1
 *
 * Timer1 matches OCR1A (class black) and OCR1B (class white) every half period, as in two_outputs.c, but here it is the
 * interrupt that toggles the class's pins: a one written to PINx toggles PORTx. An edge is late by the interrupt's own
 * way, always the same, and now and then by the other class's interrupt. The serial line has no interrupt: it is looked
 * at after each edge.
 *
 * Lines on the serial line, each answered by one line; wait for the answer before the next:
 *   id         which ID is shown             → ok id 7
 *   id 10      show it, and keep it          → ok id 10
 *   any other                                → error: …
 */
#include <avr/cpufunc.h>
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/pgmspace.h>
#include <avr/sleep.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <util/atomic.h>

#include "settings.h"

#define BAUD 9600UL
#define NO_ID 0xFFFFu /* all cells dark */

/* The cells of each port, by its bits. */
#define CELLS_D 0xFC
#define CELLS_B 0x3F
#define CELLS_C 0x0F
#define RX_PULL_UP _BV(PORTD0)

static const uint16_t words[ID_COUNT] PROGMEM = WORDS; /* bit k: cell k is of class white */

struct pins {
    uint8_t d, b, c;
};

static volatile struct pins black, white; /* each class's pins */
static volatile uint8_t black_on, white_on; /* 0xFF while the class is lit, else 0 */

ISR(TIMER1_COMPA_vect)
{
    PIND = black.d;
    PINB = black.b;
    PINC = black.c;
    OCR1A += BLACK_HALF_PERIOD_CYCLES;
    sei(); /* the rest is not urgent: the other class's edge need not wait for it */
    black_on = ~black_on;
}

ISR(TIMER1_COMPB_vect)
{
    PIND = white.d;
    PINB = white.b;
    PINC = white.c;
    OCR1B += WHITE_HALF_PERIOD_CYCLES;
    sei(); /* the rest is not urgent: the other class's edge need not wait for it */
    white_on = ~white_on;
}

/* Gives a port's pins to their classes, each at the level that its class has just now. A port at a time, so that no edge
 * waits long. */
#define SWITCH(port, of, classes_black, classes_white, other_bits)                                                     \
    ATOMIC_BLOCK(ATOMIC_FORCEON)                                                                                       \
    {                                                                                                                  \
        port = (uint8_t)((black_on & (classes_black)) | (white_on & (classes_white)) | (other_bits));                  \
        black.of = (classes_black);                                                                                    \
        white.of = (classes_white);                                                                                    \
    }                                                                                                                  \
    _NOP(); /* the instruction after a sei runs before any interrupt: must not be the next cli */

static void show(uint16_t id)
{
    const uint16_t word = pgm_read_word(&words[id]);
    const struct pins to_white = {(word << 2) & CELLS_D, (word >> 6) & CELLS_B, (word >> 12) & CELLS_C};
    const struct pins to_black = {to_white.d ^ CELLS_D, to_white.b ^ CELLS_B, to_white.c ^ CELLS_C};
    SWITCH(PORTD, d, to_black.d, to_white.d, RX_PULL_UP)
    SWITCH(PORTB, b, to_black.b, to_white.b, 0)
    SWITCH(PORTC, c, to_black.c, to_white.c, 0)
}

/* The ID that is kept. `build` is BUILD_KEY of the program that wrote it: a program built for another ID or dictionary
 * starts with its own. An erased EEPROM, all ones, has a right `check` and a `build` that no program has. */
struct record {
    uint16_t build, id, check;
};

static struct record kept EEMEM;

static uint16_t check_of(uint16_t build, uint16_t id)
{
    return ~(build ^ id);
}

static void keep(uint16_t id)
{
    eeprom_update_word(&kept.check, 0); /* right for no ID: half a record, should the power fail now, is no record */
    eeprom_update_word(&kept.build, BUILD_KEY);
    eeprom_update_word(&kept.id, id);
    eeprom_update_word(&kept.check, check_of(BUILD_KEY, id));
}

/* A broken record shows no ID at all: dark is better than wrong. */
static uint16_t kept_id(void)
{
    const uint16_t build = eeprom_read_word(&kept.build), id = eeprom_read_word(&kept.id);
    if (eeprom_read_word(&kept.check) != check_of(build, id))
        return NO_ID;
    return build == BUILD_KEY && id < ID_COUNT ? id : DEFAULT_ID;
}

static void say(const char *text)
{
    for (; *text; text++) {
        loop_until_bit_is_set(UCSR0A, UDRE0);
        UDR0 = (uint8_t)*text;
    }
}

static void say_number(uint16_t number)
{
    char digits[6];
    say(utoa(number, digits, 10));
}

static void say_id(uint16_t id)
{
    if (id == NO_ID) {
        say("error: no id kept; say id N\n");
        return;
    }
    say("ok id ");
    say_number(id);
    say("\n");
}

/* 0 to ID_COUNT − 1 in decimal digits and nothing else, else NO_ID. */
static uint16_t parsed_id(const char *text)
{
    uint16_t id = 0;
    if (!*text)
        return NO_ID;
    for (; *text; text++) {
        if (*text < '0' || *text > '9')
            return NO_ID;
        id = id * 10 + (uint16_t)(*text - '0');
        if (id >= ID_COUNT)
            return NO_ID;
    }
    return id;
}

/* Obeys a line; the ID that is shown from then on. */
static uint16_t obey(const char *line, uint16_t shown)
{
    if (!strcmp(line, "id")) {
        say_id(shown);
        return shown;
    }
    if (strncmp(line, "id ", 3)) {
        say("error: say id or id N\n");
        return shown;
    }
    const uint16_t id = parsed_id(line + 3);
    if (id == NO_ID) {
        say("error: ids are 0 to ");
        say_number(ID_COUNT - 1);
        say("\n");
        return shown;
    }
    show(id);
    keep(id);
    say_id(id);
    return id;
}

/* The next whole line, or NULL while there is none. A line that is too long is cut to one that no command has. */
static const char *received(void)
{
    static char line[12];
    static uint8_t length;
    if (bit_is_clear(UCSR0A, RXC0))
        return NULL;
    const char got = (char)UDR0;
    if (got == '\n' || got == '\r') {
        line[length] = '\0';
        const bool empty = !length;
        length = 0;
        return empty ? NULL : line;
    }
    if (length < sizeof line - 1)
        line[length++] = got;
    return NULL;
}

static void start_serial_line(void)
{
    PORTD |= RX_PULL_UP; /* with nothing connected there is nothing to hear */
    UBRR0 = (F_CPU + 8 * BAUD) / (16 * BAUD) - 1; /* 0.2 % off */
    UCSR0B = _BV(RXEN0) | _BV(TXEN0);
}

static void start_timer(void)
{
    OCR1A = BLACK_HALF_PERIOD_CYCLES;
    OCR1B = WHITE_HALF_PERIOD_CYCLES + WHITE_DELAY_CYCLES; /* in antiphase half a period later */
    TIMSK1 = _BV(OCIE1A) | _BV(OCIE1B);
    TCCR1B = _BV(CS10); /* undivided clock, counts to 65535 and on */
}

int main(void)
{
    DDRD = CELLS_D;
    DDRB = CELLS_B;
    DDRC = CELLS_C;
    uint16_t shown = kept_id();
    if (shown != NO_ID)
        show(shown);
    start_serial_line();
    start_timer();
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    for (;;) {
        sleep_mode(); /* until the next edge: several times a character */
        const char *line = received();
        if (line)
            shown = obey(line, shown);
    }
}
