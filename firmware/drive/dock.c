/* Docks before panel 7, with the camera half a metre before it. The panel is the map; nothing is measured:
 *
 *     panels: {7: {position_m: [0, 0, 0.45], yaw_deg: 180, deviations: {position_m: 0, angle_deg: 0}}}
 */
#include "board.h"

static const steer_robot robot = {.base_m = .30f, .fastest_m_s = .35f, .slowest_m_s = .045f, .settles_s = .18f};
static steer_dock dock = {.goal = {-.60f, 0, 0}, .panel_m = .60f, .within_m = .003f, .within_rad = .005f, .tries = 5};
static steer_state state;

int main(void)
{
    board_begin();
    for (;;)
        if (board_turn(&state))
            board_drive(&robot, steer_dock_step(&robot, &dock, &state, board_now_us()));
}
