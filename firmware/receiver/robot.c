/* A robot that drives only while it knows where it is: ledpi's stream on an ATmega328P at 16 MHz (Arduino Uno, Nano).
 *
 *   D0  (PD0, RXD)   the stream, 115200 baud
 *   D1  (PD1, TXD)   one line of text a second, for a person
 *   D9  (PB1)        high: the motors may run. Low 300 ms after the last picture that gave a fix, and the 5 ms
 *                    that its bytes are on the wire and looked at
 *   D13 (PB5)        the board's lamp: changes with each message
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <stdio.h>
#include <util/atomic.h>

#include "ledpi_receiver.h"

#define BAUD 115200UL
#define TIMEOUT_MS 300
#define QUEUE_BYTES 64 /* 5.6 ms at 115200 baud; a frame takes 1 ms to check. A power of 2 */

static volatile uint8_t queue[QUEUE_BYTES];
static volatile uint8_t queue_in, queue_out;
static volatile uint16_t overruns; /* bytes for which there was no room */
static volatile uint32_t ticks_ms;

static ledpi_receiver receiver;
static ledpi_guard guard = {.timeout_ms = TIMEOUT_MS};
static uint16_t fixes;
static int32_t x_mm, y_mm;

ISR(USART_RX_vect)
{
    const bool overrun = UCSR0A & _BV(DOR0);
    const uint8_t byte = UDR0;
    if (overrun || (uint8_t)(queue_in - queue_out) == QUEUE_BYTES)
        overruns++;
    else
        queue[queue_in++ % QUEUE_BYTES] = byte;
}

ISR(TIMER0_COMPA_vect) { ticks_ms++; }

static uint32_t now_ms(void)
{
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) now = ticks_ms;
    return now;
}

/* Here a robot's own steering begins: what to do with the fix, and how to stop. */
static void drive(bool may)
{
    if (may)
        PORTB |= _BV(PORTB1);
    else
        PORTB &= (uint8_t)~_BV(PORTB1);
}

static void take(ledpi_kind kind)
{
    PINB = _BV(PINB5); /* writing a 1 here changes the pin */
    ledpi_guard_take(&guard, &receiver, kind, now_ms());
    if (kind == LEDPI_FIX) {
        fixes++;
        x_mm = receiver.message.fix.pose.position_100um[0] / 10;
        y_mm = receiver.message.fix.pose.position_100um[1] / 10;
    }
}

/* Sends a byte of the line when there is room, and never waits: waiting would cost bytes of the stream. */
static void talk(void)
{
    static char line[72];
    static uint8_t at;
    static uint32_t next_ms = 1000;
    if (line[at]) {
        if (UCSR0A & _BV(UDRE0))
            UDR0 = (uint8_t)line[at++];
    } else if (now_ms() >= next_ms) {
        next_ms += 1000;
        at = 0;
        snprintf(line, sizeof line, "%s x %ld y %ld mm; %lu good %lu lost %u fixes %u overruns\r\n", guard.has_fix ? "go" : "stop", (long)x_mm,
                 (long)y_mm, (unsigned long)receiver.good, (unsigned long)receiver.lost, fixes, overruns);
    }
}

int main(void)
{
    DDRB = _BV(DDB1) | _BV(DDB5);
    OCR0A = F_CPU / 64 / 1000 - 1;
    TCCR0A = _BV(WGM01);
    TCCR0B = _BV(CS01) | _BV(CS00);
    TIMSK0 = _BV(OCIE0A);
    UCSR0A = _BV(U2X0);
    UBRR0 = (F_CPU / 8 + BAUD / 2) / BAUD - 1; /* 117647 baud, 2.1 % fast, as Arduino's own; a UART takes 4 % */
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    sei();
    for (;;) {
        if (queue_out != queue_in) {
            const ledpi_kind kind = ledpi_feed(&receiver, queue[queue_out % QUEUE_BYTES]);
            queue_out++;
            if (kind != LEDPI_NOTHING)
                take(kind);
        }
        drive(ledpi_guard_may_drive(&guard, now_ms()));
        talk();
    }
}
