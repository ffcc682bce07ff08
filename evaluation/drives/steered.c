/* firmware/drive/steer.h as plant.py calls it: bytes of the line in and out; speed and turn rate out. */
#include "steer.h"

static ledpi_receiver receiver;
static ledpi_sender sender;
static uint16_t number; /* of a question for the clock */
static uint32_t arrived_us;
static bool is_asked;
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
    while (count--) {
        const ledpi_kind kind = ledpi_feed(&receiver, *bytes++);
        if (kind == LEDPI_STATE)
            steer_take(&state, &receiver.message.state, now_us);
        else if (kind == LEDPI_TIME_ASK) {
            number = receiver.message.time_number;
            arrived_us = now_us;
            is_asked = true;
        }
    }
}

/* Writes odometry, and an answer for the clock if one is due; returns how many bytes. */
unsigned say(uint8_t *bytes, uint32_t now_us, int32_t left_100um, int32_t right_100um, int32_t yaw_100urad)
{
    const ledpi_odometry odometry = {now_us, left_100um, right_100um, yaw_100urad, false, false, false};
    unsigned length = ledpi_write_odometry(bytes, &sender, &odometry);
    if (is_asked)
        length += ledpi_write_time(bytes + length, &sender, number, arrived_us, now_us);
    is_asked = false;
    return length;
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
