/* The two-way line on an ATmega328P at 16 MHz: odometry 50 times a second, an answer to each question for the time, and
 * PB1 is high while the newest state is one by odometry. Timer 1 counts half µs. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "ledpi_receiver.h"

static volatile uint8_t queue[64], queue_in, queue_out;
static volatile uint16_t overflows;
static volatile uint32_t byte_us; /* when the newest byte came */

static ledpi_receiver receiver;
static ledpi_sender sender;
static uint8_t buffer[LEDPI_ODOMETRY_BYTES], length, sent;

ISR(TIMER1_OVF_vect) { overflows++; }

static uint32_t now_us(void)
{
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        const uint16_t half_us = TCNT1;
        const uint16_t high = overflows + (TIFR1 & _BV(TOV1) && half_us < 0x8000);
        now = (uint32_t)high << 15 | half_us >> 1;
    }
    return now;
}

ISR(USART_RX_vect)
{
    queue[queue_in++ % sizeof queue] = UDR0;
    byte_us = now_us();
}

int main(void)
{
    ledpi_odometry odometry = {0, 0, 0, LEDPI_NO_TOTAL, true, false, false};
    uint32_t next_us = 20000, arrived_us = 0;
    uint16_t number = 0;
    bool asked = false;
    DDRB = _BV(DDB1);
    TCCR1B = _BV(CS11);
    TIMSK1 = _BV(TOIE1);
    UCSR0A = _BV(U2X0);
    UBRR0 = (F_CPU / 8 + 115200UL / 2) / 115200UL - 1;
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    sei();
    for (;;) {
        if (queue_out != queue_in) {
            const ledpi_kind kind = ledpi_feed(&receiver, queue[queue_out++ % sizeof queue]);
            if (kind == LEDPI_TIME_ASK) {
                ATOMIC_BLOCK(ATOMIC_RESTORESTATE) arrived_us = byte_us;
                number = receiver.message.time_number;
                asked = true;
            } else if (kind == LEDPI_STATE)
                PORTB = receiver.message.state.mode == LEDPI_BY_ODOMETRY ? _BV(PORTB1) : 0;
        }
        if (sent < length) {
            if (UCSR0A & _BV(UDRE0))
                UDR0 = buffer[sent++];
        } else if (asked) {
            length = ledpi_write_time(buffer, &sender, number, arrived_us, now_us());
            sent = 0;
            asked = false;
        } else if ((int32_t)(now_us() - next_us) >= 0) {
            next_us += 20000;
            odometry.clock_us = now_us();
            odometry.left_100um += 50; /* 0.25 and 0.5 m/s */
            odometry.right_100um += 100;
            length = ledpi_write_odometry(buffer, &sender, &odometry);
            sent = 0;
            odometry.restarted = false;
        }
    }
}
