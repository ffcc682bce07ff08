/* An ATmega328P at 16 MHz (Arduino Uno, Nano) with two motors: the line both ways, the clock, wheels. Run in an emulator
 * only; the pins fit a TB6612 and encoders with two channels.
 *
 *   D0, D1    the line, 115200 baud
 *   D2, D4    left encoder, channels A and B; D3, D7: the right one
 *   D5, D6    left and right motor: duty; D8, D12: its direction, high is ahead
 *   D9        high while the motors may run (the driver's standby)
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "steer.h"

#define BOARD_STEP_100UM 5 /* a wheel's way from one rising edge of channel A to the next */
#define BOARD_PERIOD_US 20000UL
#define BOARD_GAIN 100 /* duty, of 255, a period for each m/s that a wheel is too slow */

static volatile uint8_t board_queue[64], board_in, board_out;
static volatile uint32_t board_overflows; /* each 2^15 µs: the clock has all 32 bits */
static volatile uint32_t board_byte_us; /* when the newest byte came */
static volatile int32_t board_steps[2];

static ledpi_receiver board_receiver;
static ledpi_sender board_sender;
static uint8_t board_line[LEDPI_ODOMETRY_BYTES], board_length, board_sent;
static ledpi_odometry board_odometry = {.yaw_100urad = LEDPI_NO_TOTAL, .restarted = true};

ISR(TIMER1_OVF_vect) { board_overflows++; }
ISR(INT0_vect) { board_steps[0] += PIND & _BV(PD4) ? 1 : -1; }
ISR(INT1_vect) { board_steps[1] += PIND & _BV(PD7) ? 1 : -1; }

static uint32_t board_now_us(void)
{
    uint32_t now;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        const uint16_t half_us = TCNT1;
        const uint32_t high = board_overflows + (TIFR1 & _BV(TOV1) && half_us < 0x8000);
        now = high << 15 | half_us >> 1;
    }
    return now;
}

ISR(USART_RX_vect)
{
    board_queue[board_in++ % sizeof board_queue] = UDR0;
    board_byte_us = board_now_us();
}

static void board_begin(void)
{
    DDRB = _BV(DDB0) | _BV(DDB1) | _BV(DDB4);
    DDRD = _BV(DDD5) | _BV(DDD6);
    EICRA = _BV(ISC01) | _BV(ISC00) | _BV(ISC11) | _BV(ISC10);
    EIMSK = _BV(INT0) | _BV(INT1);
    TCCR0A = _BV(COM0A1) | _BV(COM0B1) | _BV(WGM00); /* 3.9 kHz */
    TCCR0B = _BV(CS01);
    TCCR1B = _BV(CS11);
    TIMSK1 = _BV(TOIE1);
    UCSR0A = _BV(U2X0);
    UBRR0 = (F_CPU / 8 + 115200UL / 2) / 115200UL - 1;
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    sei();
}

/* Takes what came and says what is due, without waiting. True once in each period: it is time to steer. */
static bool board_turn(steer_state *state)
{
    static uint32_t next_us, arrived_us;
    static uint16_t number;
    static bool asked;
    if (board_out != board_in) {
        const ledpi_kind kind = ledpi_feed(&board_receiver, board_queue[board_out++ % sizeof board_queue]);
        if (kind == LEDPI_STATE)
            steer_take(state, &board_receiver.message.state, board_now_us());
        else if (kind == LEDPI_TIME_ASK) {
            ATOMIC_BLOCK(ATOMIC_RESTORESTATE) arrived_us = board_byte_us;
            number = board_receiver.message.time_number;
            asked = true;
        }
    }
    if (board_sent < board_length) {
        if (UCSR0A & _BV(UDRE0))
            UDR0 = board_line[board_sent++];
    } else if (asked) {
        board_length = ledpi_write_time(board_line, &board_sender, number, arrived_us, board_now_us());
        board_sent = 0;
        asked = false;
    } else if ((int32_t)(board_now_us() - next_us) >= 0) {
        next_us += BOARD_PERIOD_US;
        ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
        {
            board_odometry.clock_us = board_now_us();
            board_odometry.left_100um = board_steps[0] * BOARD_STEP_100UM;
            board_odometry.right_100um = board_steps[1] * BOARD_STEP_100UM;
        }
        board_length = ledpi_write_odometry(board_line, &board_sender, &board_odometry);
        board_sent = 0;
        board_odometry.restarted = false;
        return true;
    }
    return false;
}

/* Once in each period: the duty follows what a wheel is too slow by, so a dead band delays it and no more. */
static int16_t board_duty(uint8_t wheel, int32_t total_100um, float wanted_m_s)
{
    static int32_t before_100um[2];
    static float duty[2];
    const float moved_m_s = (float)(total_100um - before_100um[wheel]) * (100.0f / BOARD_PERIOD_US);
    before_100um[wheel] = total_100um;
    duty[wheel] = wanted_m_s == 0 ? 0 : steer_clip(duty[wheel] + BOARD_GAIN * (wanted_m_s - moved_m_s), -255, 255);
    return (int16_t)duty[wheel];
}

static void board_drive(const steer_robot *robot, steer_motion motion)
{
    const float aside = motion.turn_rad_s * robot->base_m / 2;
    const int16_t left = board_duty(0, board_odometry.left_100um, motion.speed_m_s - aside);
    const int16_t right = board_duty(1, board_odometry.right_100um, motion.speed_m_s + aside);
    const bool may = motion.speed_m_s != 0 || motion.turn_rad_s != 0;
    OCR0B = (uint8_t)(left < 0 ? -left : left);
    OCR0A = (uint8_t)(right < 0 ? -right : right);
    PORTB = (uint8_t)((may ? _BV(PORTB1) : 0) | (left > 0 ? _BV(PORTB0) : 0) | (right > 0 ? _BV(PORTB4) : 0));
}
