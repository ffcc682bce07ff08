/* firmware/drive/steer.h for evaluation/drives/docking.py: bytes of the line in, speed and turn rate out. */
#include "steer.h"

static ledpi_receiver receiver;
static steer_state state;
static steer_dock dock;
static steer_robot robot;

void begin(steer_robot of, steer_dock to)
{
    receiver = (ledpi_receiver){.length = 0};
    state = (steer_state){.known = false};
    robot = of;
    dock = to;
}

void hear(const uint8_t *bytes, unsigned count, uint32_t now_us)
{
    while (count--)
        if (ledpi_feed(&receiver, *bytes++) == LEDPI_STATE)
            steer_take(&state, &receiver.message.state, now_us);
}

steer_motion step_to_dock(uint32_t now_us, uint8_t *phase)
{
    const steer_motion motion = steer_dock_step(&robot, &dock, &state, now_us);
    *phase = (uint8_t)dock.phase;
    return motion;
}

steer_motion step_to(uint32_t now_us, float x_m, float y_m)
{
    return steer_go_to(&robot, &state, now_us, x_m, y_m);
}

bool is_there(uint32_t now_us, float x_m, float y_m, float within_m)
{
    return steer_is_there(&state, now_us, x_m, y_m, within_m);
}
