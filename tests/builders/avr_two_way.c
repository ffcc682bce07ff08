/* The two-way line of firmware/drive/board.h on an ATmega328P at 16 MHz: its wheels turn at 0.25 and 0.5 m/s, and PB1 is
 * high while the state is known. */
#include "board.h"

int main(void)
{
    static steer_state state;
    board_begin();
    (void)board_drive;
    for (;;) {
        board_steps[0] += 10;
        board_steps[1] += 20;
        while (!board_turn(&state)) {
        }
        PORTB = state.known ? _BV(PORTB1) : 0;
    }
}
