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

int main(void)
{
    static const char *const kinds[] = {"", "marker", "fix", "status"};
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
