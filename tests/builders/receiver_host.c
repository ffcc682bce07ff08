/* The C receiver on the host: bytes on standard input, each message as a line of JSON, the counters as the last one. */
#include <stdio.h>

#include "ledpi_receiver.h"

static void pose(const ledpi_pose *p)
{
    const int16_t *q = p->quaternion_q15;
    printf(", \"position_100um\": [%d, %d, %d], \"quaternion_q15\": [%d, %d, %d, %d]", (int)p->position_100um[0],
           (int)p->position_100um[1], (int)p->position_100um[2], q[0], q[1], q[2], q[3]);
    printf(", \"deviation_100um\": [%u, %u, %u]", p->deviation_100um[0], p->deviation_100um[1], p->deviation_100um[2]);
    printf(", \"deviation_100urad\": [%u, %u, %u]", p->deviation_100urad[0], p->deviation_100urad[1],
           p->deviation_100urad[2]);
}

static void marker(const ledpi_marker *m)
{
    printf("\"id\": %u, \"age_us\": %u, \"flags\": [%d, %d, %d], \"has_pose\": %d", m->id, m->age_us, m->uncalibrated,
           m->ambiguous, m->alternate, m->has_pose);
    pose(&m->pose);
}

static void fix(const ledpi_fix *f)
{
    printf("\"age_us\": %u, \"panels_used\": %u, \"map_resets\": %u", f->age_us, f->panels_used, f->map_resets);
    pose(&f->pose);
}

static void status(const ledpi_status *s)
{
    printf("\"state\": %u, \"no_fix\": %u, \"panels_in_view\": %u, \"temperature_c\": %d, \"throttling\": %u", s->state,
           s->no_fix, s->panels_in_view, s->temperature_c, s->throttling);
    printf(", \"uptime_s\": %u, \"frames\": %u, \"frames_dropped\": %u, \"markers\": %u, \"packets_dropped\": %u",
           s->uptime_s, s->frames, s->frames_dropped, s->markers, s->packets_dropped);
    printf(", \"decode_p50_us\": %u, \"decode_p99_us\": %u", s->decode_p50_us, s->decode_p99_us);
}

static void state(const ledpi_state *s)
{
    const int8_t *c = s->correlations_127;
    const uint32_t *d = s->deviations;
    printf("\"mode\": %u, \"flags\": [%d, %d, %d], \"counts\": [%u, %u, %u], \"clock_us\": %u", s->mode, s->has_clock,
           s->contested, s->panel_moved, s->map_resets, s->relocalisations, s->panels, s->clock_us);
    printf(", \"pose\": [%d, %d, %d, %d, %d], \"deviations\": [%u, %u, %u]", (int)s->x_100um, (int)s->y_100um,
           s->yaw_100urad, s->speed_mm_s, s->turn_mrad_s, d[0], d[1], d[2]);
    printf(", \"correlations\": [%d, %d, %d], \"age\": %u, \"way\": %u", c[0], c[1], c[2], s->panel_age_ms, s->way_cm);
}

int main(void)
{
    static const char *const kinds[] = {"", "marker", "fix", "status", "state", [LEDPI_TIME_ASK] = "time_ask"};
    static ledpi_receiver r;
    for (int byte; (byte = getchar()) != EOF;) {
        const ledpi_kind kind = ledpi_feed(&r, (uint8_t)byte);
        if (kind == LEDPI_NOTHING)
            continue;
        printf("{\"message\": \"%s\", \"sequence\": %u, ", kinds[kind], r.sequence);
        if (kind == LEDPI_MARKER)
            marker(&r.message.marker);
        else if (kind == LEDPI_FIX)
            fix(&r.message.fix);
        else if (kind == LEDPI_STATE)
            state(&r.message.state);
        else if (kind == LEDPI_TIME_ASK)
            printf("\"number\": %u", r.message.time_number);
        else
            status(&r.message.status);
        puts("}");
    }
    printf("{\"good\": %u, \"lost\": %u, \"restarts\": %u, \"faults\": [", r.good, r.lost, r.restarts);
    for (int fault = 0; fault < LEDPI_WHOLE; fault++)
        printf("%s%u", fault ? ", " : "", r.faults[fault]);
    puts("]}");
    return 0;
}
