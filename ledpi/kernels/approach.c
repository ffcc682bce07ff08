/* From rough corners to the sides, up to several pixels away: `nearest_sides` of decode/approach.py. */
#include <math.h>

#include "kernels.h"

/* As there: samples across a side, and places of the step up in light, in steps. */
enum { SAMPLES = 11, OFFSETS = 11 };
#define FIRST_SAMPLE (-6.0)
#define FIRST_OFFSET (-4.5)
#define OFFSET_STEP 0.75
#define MAX_TILT_STEPS 2.0

/* Where in a profile the largest step up is, in steps, and how high. `templates` (SAMPLES, OFFSETS). */
static double step_up(const float *light, const float *templates, double *height) {
    float score[OFFSETS] = {0};
    for (int t = 0; t < SAMPLES; t++)
        for (int o = 0; o < OFFSETS; o++) score[o] += light[t] * templates[t * OFFSETS + o];
    int best = 0;
    for (int o = 1; o < OFFSETS; o++)
        if (score[o] > score[best]) best = o;
    best = best < 1 ? 1 : best > OFFSETS - 2 ? OFFSETS - 2 : best;
    float before = score[best - 1], here = score[best], after = score[best + 1];
    double shift = 0.5 * (after - before) / fmax(2 * here - before - after, 1e-9); /* of the parabola through the three */
    *height = here;
    return FIRST_OFFSET + best * OFFSET_STEP + fmin(fmax(shift, -1.0), 1.0) * OFFSET_STEP;
}

bool ledpi_nearest(const Picture *picture, const Shares *shares, const float *templates, const Point corners[4],
                   double step_px, Point nearest[4], double *spread_px) {
    Side sides[4];
    double found[4 * MOST_PROFILES], height[4 * MOST_PROFILES], weights[MOST_PROFILES], middle[4], slope[4];
    bool good[4 * MOST_PROFILES];
    ptrdiff_t count = shares->count;
    ledpi_sides_of(corners, sides);
    for (int k = 0; k < 4; k++)
        for (ptrdiff_t p = 0; p < count; p++) {
            const Side *side = &sides[k];
            float light[SAMPLES], x = (float)(side->start.x + side->along.x * shares->share[p]),
                                  y = (float)(side->start.y + side->along.y * shares->share[p]);
            for (int t = 0; t < SAMPLES; t++) {
                double across = step_px * (FIRST_SAMPLE + t);
                light[t] = ledpi_light_between(picture, x + (float)(side->inward.x * across),
                                               y + (float)(side->inward.y * across));
            }
            found[k * count + p] = step_px * step_up(light, templates, &height[k * count + p]);
        }
    bool seen = ledpi_steps(count, height, good);
    double squares = 0.0;
    for (int k = 0; k < 4; k++) {
        const double *at = found + k * count;
        ledpi_near_median(count, at, good + k * count, MAX_TILT_STEPS * step_px, weights);
        ledpi_fit_line(shares, at, weights, &middle[k], &slope[k]);
        double spread = ledpi_deviation(shares, at, good + k * count, middle[k], slope[k], weights);
        ledpi_fit_line(shares, at, weights, &middle[k], &slope[k]);
        squares += spread * spread;
    }
    ledpi_moved(sides, middle, slope, nearest);
    *spread_px = sqrt(squares / 4);
    return seen;
}

/* Of `quads` quads: `corners` (quads, 4, 2), `step_px` (quads,) → `nearest` (quads, 4, 2), `spread_px` (quads,), and
 * whether each was `seen` (quads,). */
void ledpi_nearest_sides(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                         const double *share, ptrdiff_t shares, const float *templates, ptrdiff_t quads,
                         const Point *corners, const double *step_px, Point *nearest, double *spread_px, bool *seen) {
    const Picture picture = {pixels, height, width, stride, table};
    const Shares at = {shares, share, NULL};
    for (ptrdiff_t i = 0; i < quads; i++)
        seen[i] = ledpi_nearest(&picture, &at, templates, corners + 4 * i, step_px[i], nearest + 4 * i, &spread_px[i]);
}
