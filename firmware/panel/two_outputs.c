/* Panel driver with two outputs, for an ATmega328P at 16 MHz (Arduino Uno, Nano).
 *
 *   D9  (PB1, OC1A)   all cells of class black
 *   D10 (PB2, OC1B)   all cells of class white
 *
 * Timer1 counts clock cycles, round and round. Whenever it equals OCR1A, the hardware itself toggles OC1A; the interrupt
 * only says where the next edge is to be: half a period on. It may come late by almost that half period, and the edge is
 * still exact to the cycle. The same with OCR1B and OC1B: two frequencies that know nothing of each other. Or one, in
 * antiphase: then the half periods are the same, and OC1B begins one of them later.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>

#include "settings.h"

/* Two of simavr 1.6's faults are kept away from, since its traces are all the proof that there is; a chip has neither.
 * It toggles a pin twice if the other output's register is written in the very cycle of its match: the write lets a match
 * that is near go by. And it can miss a match in the first cycles after the counter's wrap: from this start on, most half
 * periods never lead there. */
#define FIRST_MATCH 1006u
#define LET_MATCH_PASS(other)                                                                                          \
    while ((uint16_t)(other + 1 - TCNT1) < 16)                                                                         \
        ;

ISR(TIMER1_COMPA_vect)
{
    const uint16_t next = OCR1A + BLACK_HALF_PERIOD_CYCLES;
    LET_MATCH_PASS(OCR1B)
    OCR1A = next;
}

ISR(TIMER1_COMPB_vect)
{
    const uint16_t next = OCR1B + WHITE_HALF_PERIOD_CYCLES;
    LET_MATCH_PASS(OCR1A)
    OCR1B = next;
}

int main(void)
{
    DDRB = _BV(DDB1) | _BV(DDB2);
    OCR1A = FIRST_MATCH;
    OCR1B = FIRST_MATCH + WHITE_DELAY_CYCLES;
    TCCR1A = _BV(COM1A0) | _BV(COM1B0); /* a match toggles the pin; WGM 0: count to 65535 and on */
    TIMSK1 = _BV(OCIE1A) | _BV(OCIE1B);
    TCCR1B = _BV(CS10); /* undivided clock: now it runs */
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    for (;;)
        sleep_mode();
}
