/* Drives from one point of the map to the next, for ever. */
#include "board.h"

static const steer_robot robot = {.base_m = .30f, .fastest_m_s = .35f, .slowest_m_s = .045f, .settles_s = .18f};
static const float points_m[][2] = {{1, 1}, {3, 1}, {3, 3}, {1, 3}};
static steer_state state;

int main(void)
{
    uint8_t to = 0;
    board_begin();
    for (;;)
        if (board_turn(&state)) {
            const float *point = points_m[to];
            if (steer_is_there(&state, board_now_us(), point[0], point[1], .1f))
                to = (uint8_t)((to + 1) % (sizeof points_m / sizeof *points_m));
            board_drive(&robot, steer_go_to(&robot, &state, board_now_us(), point[0], point[1]));
        }
}
