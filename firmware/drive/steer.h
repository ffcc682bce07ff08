/* Steers a robot with two driven wheels by ledpi's state: to a point, or square to a goal before a panel. C99 with
 * <math.h>, no heap, no clock, no pins: where it is and where it shall be in, speed and turn rate out.
 *
 * It stands still where it must not trust the state: none has come for a while, another pose is possible, or the
 * deviations are too large for how far there is to go.
 */
#ifndef STEER_H
#define STEER_H

#include <math.h>

#include "ledpi_receiver.h"

#define STEER_PI 3.14159265f
#define STEER_STALE_US 150000UL /* an older state is none: the motors stop within 0.3 s of a cut line */

typedef struct {
    float base_m;                   /* between the wheels */
    float fastest_m_s, slowest_m_s; /* a wheel's; below the slowest it does not begin to turn: more than its dead band */
    float settles_s;                /* from a command until it is obeyed: delays, and the motors' lag */
} steer_robot;

typedef struct {
    float x_m, y_m, yaw_rad; /* base_link in the map, left is positive */
} steer_pose;

typedef struct {
    float speed_m_s, turn_rad_s; /* ahead; to the left */
} steer_motion;

/* The newest state. All zero is its start: unknown. */
typedef struct {
    steer_pose pose;
    steer_motion motion;
    float deviation_m;
    uint32_t holds_us;
    bool known;
} steer_state;

static const steer_motion STEER_STAND = {0, 0};

static inline float steer_wrapped(float angle) { return angle - 2 * STEER_PI * floorf(angle / (2 * STEER_PI) + .5f); }

static inline float steer_clip(float value, float least, float most) { return fmaxf(least, fminf(most, value)); }

/* Takes each LEDPI_STATE; `now_us` is the clock of the odometry. */
static inline void steer_take(steer_state *to, const ledpi_state *state, uint32_t now_us)
{
    to->pose = (steer_pose){(float)state->x_100um * 1e-4f, (float)state->y_100um * 1e-4f, state->yaw_100urad * 1e-4f};
    to->motion = (steer_motion){state->speed_mm_s * 1e-3f, state->turn_mrad_s * 1e-3f};
    to->deviation_m = hypotf((float)state->deviations[0], (float)state->deviations[1]) * 1e-4f;
    to->holds_us = state->has_clock ? state->clock_us : now_us;
    to->known = state->mode != LEDPI_NO_STATE && !state->contested;
}

/* Ask before each step: what was once too old stays so until the next state, even when the clock wraps. */
static inline bool steer_is_known(steer_state *state, uint32_t now_us)
{
    const int32_t age_us = (int32_t)(now_us - state->holds_us); /* below zero: it is of a moment ahead */
    if (age_us > (int32_t)STEER_STALE_US || age_us < -(int32_t)STEER_STALE_US)
        state->known = false;
    return state->known;
}

/* The pose that it will have, if it goes on as it moves, so many seconds from now. */
static inline steer_pose steer_ahead(const steer_state *state, uint32_t now_us, float seconds)
{
    const float s = seconds + (float)(int32_t)(now_us - state->holds_us) * 1e-6f;
    const float way = s * state->motion.speed_m_s, turn = s * state->motion.turn_rad_s;
    const float heading = state->pose.yaw_rad + turn / 2;
    return (steer_pose){state->pose.x_m + way * cosf(heading), state->pose.y_m + way * sinf(heading),
                        steer_wrapped(state->pose.yaw_rad + turn)};
}

/* On the spot, by `rad` that are left. */
static inline steer_motion steer_turn(const steer_robot *robot, float rad)
{
    const float least = 2 * robot->slowest_m_s / robot->base_m;
    return (steer_motion){0, copysignf(steer_clip(2 * fabsf(rad), least, fmaxf(least, 1)), rad)};
}

/* A curve on which neither wheel is too slow to turn. */
static inline steer_motion steer_curve(const steer_robot *robot, float speed_m_s, float turn_rad_s)
{
    const float most = fmaxf(0, fabsf(speed_m_s) - robot->slowest_m_s) * 2 / robot->base_m;
    return (steer_motion){speed_m_s, steer_clip(turn_rad_s, -most, most)};
}

/* Is the point so near, as far as it is known? */
static inline bool steer_is_there(steer_state *state, uint32_t now_us, float x_m, float y_m, float within_m)
{
    return steer_is_known(state, now_us) && hypotf(x_m - state->pose.x_m, y_m - state->pose.y_m) < within_m;
}

/* Toward a point, and through it. */
static inline steer_motion steer_go_to(const steer_robot *robot, steer_state *state, uint32_t now_us, float x_m, float y_m)
{
    if (!steer_is_known(state, now_us))
        return STEER_STAND;
    const steer_pose at = steer_ahead(state, now_us, robot->settles_s);
    const float left_m = hypotf(x_m - at.x_m, y_m - at.y_m);
    const float aside = steer_wrapped(atan2f(y_m - at.y_m, x_m - at.x_m) - at.yaw_rad);
    if (state->deviation_m > .2f + .2f * left_m)
        return STEER_STAND;
    if (fabsf(aside) > 1)
        return steer_turn(robot, aside);
    return steer_curve(robot, fmaxf(2 * robot->slowest_m_s, robot->fastest_m_s * cosf(aside)), 2 * aside);
}

/* Docking: along a curve that ends on the goal's axis; then it stands, looks, and mends what is left by short pulses.
 * Wheels cannot mend what is left aside: for that it backs up and comes again. */
typedef enum { STEER_APPROACH, STEER_BACK, STEER_MEND, STEER_DOCKED } steer_phase;

typedef struct {
    steer_pose goal;  /* base_link's */
    float panel_m;    /* distance of the panel ahead of the goal */
    float within_m, within_rad;
    uint8_t tries;    /* so often may it back up */
    steer_phase phase;
    steer_motion pulse;
    uint32_t pulse_ends_us, looks_from_us; /* the pulse's end; when the robot stands and has been seen */
} steer_dock;

#define STEER_BACK_M .45f
#define STEER_VIEW_RAD .26f /* so far aside of the middle of the picture the panel may be */
#define STEER_LOOK_S .25f /* after what the robot takes to stand: for the picture of it */

/* Stands, after `seconds` of a motion. However the motors lag, a pulse moves by speed times time. */
static inline steer_motion steer_pulse(const steer_robot *robot, steer_dock *dock, uint32_t now_us, steer_motion motion, float seconds)
{
    dock->phase = STEER_MEND;
    dock->pulse = motion;
    dock->pulse_ends_us = now_us + (uint32_t)(seconds * 1e6f);
    dock->looks_from_us = dock->pulse_ends_us + (uint32_t)((2 * robot->settles_s + STEER_LOOK_S) * 1e6f);
    return motion;
}

/* It stands before the goal: what is left to do? */
static inline steer_motion steer_mend(const steer_robot *robot, steer_dock *dock, uint32_t now_us, float along, float across, float yaw)
{
    const float slow = robot->slowest_m_s;
    if ((int32_t)(now_us - dock->pulse_ends_us) < 0)
        return dock->pulse;
    if ((int32_t)(now_us - dock->looks_from_us) < 0)
        return STEER_STAND;
    if (fabsf(across) > dock->within_m && dock->tries > 0) {
        dock->tries--;
        dock->phase = STEER_BACK;
    } else if (fabsf(yaw) > dock->within_rad)
        return steer_pulse(robot, dock, now_us, (steer_motion){0, copysignf(2 * slow / robot->base_m, -yaw)}, fabsf(yaw) * robot->base_m / (2 * slow));
    else if (fabsf(along) > dock->within_m)
        return steer_pulse(robot, dock, now_us, (steer_motion){copysignf(slow, along), 0}, fabsf(along) / slow);
    else
        dock->phase = STEER_DOCKED;
    return STEER_STAND;
}

/* One step, 50 times a second; until `dock->phase` is STEER_DOCKED. */
static inline steer_motion steer_dock_step(const steer_robot *robot, steer_dock *dock, steer_state *state, uint32_t now_us)
{
    if (!steer_is_known(state, now_us) || dock->phase == STEER_DOCKED)
        return STEER_STAND;
    const steer_pose at = steer_ahead(state, now_us, dock->phase == STEER_MEND ? 0 : robot->settles_s);
    const float c = cosf(dock->goal.yaw_rad), s = sinf(dock->goal.yaw_rad);
    const float along = c * (dock->goal.x_m - at.x_m) + s * (dock->goal.y_m - at.y_m); /* that is left to go */
    const float across = c * (at.y_m - dock->goal.y_m) - s * (at.x_m - dock->goal.x_m); /* to the left of the axis */
    const float yaw = steer_wrapped(at.yaw_rad - dock->goal.yaw_rad);
    const float panel = atan2f(-across, along + dock->panel_m); /* the direction in which it is seen */
    const bool is_vague = state->deviation_m > .02f + .2f * fabsf(along); /* first it must see the panel */
    if (dock->phase == STEER_MEND)
        return is_vague ? STEER_STAND : steer_mend(robot, dock, now_us, along, across, yaw);
    if (is_vague)
        return fabsf(steer_wrapped(panel - yaw)) > .05f ? steer_turn(robot, steer_wrapped(panel - yaw)) : STEER_STAND;
    if (dock->phase == STEER_BACK) {
        if (along > STEER_BACK_M)
            dock->phase = STEER_APPROACH;
        return steer_curve(robot, -.15f, 2 * (steer_clip(2 * across, -.25f, .25f) - yaw));
    }
    if (along < .002f)
        return steer_pulse(robot, dock, now_us, STEER_STAND, 0);
    /* A point of the axis to aim at, nearer as it comes closer; but the panel stays in view. */
    const float aim = atan2f(-across, steer_clip(.45f * along + .10f, .12f, .6f));
    const float aside = steer_wrapped(steer_clip(aim, panel - STEER_VIEW_RAD, panel + STEER_VIEW_RAD) - yaw);
    if (fabsf(aside) > 1)
        return steer_turn(robot, aside);
    const float slow = 2 * robot->slowest_m_s, speed = steer_clip(1.2f * along, slow, fmaxf(slow, robot->fastest_m_s));
    return steer_curve(robot, fmaxf(slow, speed * cosf(aside) * cosf(aside)), 3 * aside);
}

#endif
