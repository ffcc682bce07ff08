/* From rough corners to the sides, up to several pixels away: decode/corners/approach.py. */
#include <math.h>

#include "kernels.h"

/* As there: samples across a side, and places of the step up in light, in steps. */
enum { SAMPLES = 11, OFFSETS = 11 };
#define FIRST_SAMPLE (-6.0)
#define FIRST_OFFSET (-4.5)
#define OFFSET_STEP 0.75

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

bool ledpi_nearest(const Picture *picture, const Approaching *by, const Shares *shares, const float *templates,
                   const Point corners[4], double step_px, Point nearest[4], double *spread_px) {
    Side sides[4];
    double found[4 * MOST_PROFILES], height[4 * MOST_PROFILES], weights[MOST_PROFILES], middle[4], slope[4];
    bool good[4 * MOST_PROFILES];
    ptrdiff_t count = shares->count;
    ledpi_sides_of(corners, sides);
    for (int k = 0; k < 4; k++) {
        const Side *side = &sides[k];
        float xs[MOST_PROFILES * SAMPLES], ys[MOST_PROFILES * SAMPLES], light[MOST_PROFILES * SAMPLES];
        for (ptrdiff_t p = 0; p < count; p++) {
            const float x = (float)(side->start.x + side->along.x * shares->share[p]);
            const float y = (float)(side->start.y + side->along.y * shares->share[p]);
            for (int t = 0; t < SAMPLES; t++) {
                const double across = step_px * (FIRST_SAMPLE + t);
                xs[p * SAMPLES + t] = x + (float)(side->inward.x * across);
                ys[p * SAMPLES + t] = y + (float)(side->inward.y * across);
            }
        }
        ledpi_light_at_all(picture, xs, ys, count * SAMPLES, light);
        for (ptrdiff_t p = 0; p < count; p++)
            found[k * count + p] = step_px * step_up(light + p * SAMPLES, templates, &height[k * count + p]);
    }
    bool seen = ledpi_steps(count, height, good);
    double squares = 0.0;
    for (int k = 0; k < 4; k++) {
        const double *at = found + k * count;
        ledpi_near_median(count, at, good + k * count, by->max_tilt_steps * step_px, weights);
        ledpi_fit_line(shares, at, weights, &middle[k], &slope[k]);
        double spread = ledpi_deviation(shares, at, good + k * count, middle[k], slope[k], weights);
        ledpi_fit_line(shares, at, weights, &middle[k], &slope[k]);
        squares += spread * spread;
    }
    ledpi_moved(sides, middle, slope, nearest);
    *spread_px = sqrt(squares / 4);
    return seen;
}

/* A way from corners to the sides: where it leads, and whether that is a square. */
typedef struct {
    Point corners[4];
    double spread_px;
    bool there, straight;
} Way;

static Way follow(const Picture *picture, const Approaching *by, const Shares *shares, const float *templates,
                  const Point start[4], double step_px) {
    const double limit = fmax(by->max_spread_px, by->max_spread_steps * step_px);
    Way way;
    bool seen = ledpi_nearest(picture, by, shares, templates, start, step_px, way.corners, &way.spread_px), finite = true;
    for (int k = 0; k < 4; k++) finite = finite && isfinite(way.corners[k].x) && isfinite(way.corners[k].y);
    if (seen && finite && way.spread_px > limit && way.spread_px < by->almost * limit) {
        Point begun[4]; /* too far off: the side was only seen in part */
        for (int k = 0; k < 4; k++) begun[k] = way.corners[k];
        seen = ledpi_nearest(picture, by, shares, templates, begun, step_px, way.corners, &way.spread_px);
    }
    way.there = seen && ledpi_farthest(way.corners, start) < by->max_move * sqrt(fabs(ledpi_area(start)));
    way.straight = way.there && way.spread_px <= limit;
    return way;
}

/* A quad with the most obtuse corner moved to where it makes it a parallelogram. False where that is not far. */
static bool with_fourth_corner(const Approaching *by, const Point c[4], Point squared[4]) {
    double least = HUGE_VAL;
    int most = 0;
    for (int k = 0; k < 4; k++) {
        const Point *here = &c[k], *next = &c[(k + 1) & 3], *before = &c[(k + 3) & 3];
        const double x = next->x - here->x, y = next->y - here->y, u = before->x - here->x, v = before->y - here->y;
        const double cosine = (x * u + y * v) / fmax(ledpi_length(x, y) * ledpi_length(u, v), 1e-9);
        if (cosine < least) least = cosine, most = k;
    }
    const Point *here = &c[most], *next = &c[(most + 1) & 3], *before = &c[(most + 3) & 3], *opposite = &c[(most + 2) & 3];
    for (int k = 0; k < 4; k++) squared[k] = c[k];
    squared[most] = (Point){next->x + before->x - opposite->x, next->y + before->y - opposite->y};
    const double away = ledpi_length(squared[most].x - here->x, squared[most].y - here->y);
    return least < by->obtuse && away > by->cut_off * sqrt(fabs(ledpi_area(c)));
}

/* Of `quads` rough quads (quads, 4, 2), whose sides are up to `tolerance_px` (quads,) away: better corners; and what is
 * there: 0 for a square, 1 for none, 2 for one whose sides are not straight. */
void ledpi_approach(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                    const Approaching *by, const double *share, ptrdiff_t shares, const float *templates,
                    ptrdiff_t quads, const Point *rough,
                    const double *tolerance_px, Point *corners, int32_t *outcomes) {
    const Picture picture = {pixels, height, width, stride, table};
    const Shares at = {shares, share, NULL};
    for (ptrdiff_t i = 0; i < quads; i++, rough += 4, corners += 4) {
        const double step_px = fmax(by->finest_step_px, tolerance_px[i] / -FIRST_OFFSET);
        Point squared[4];
        Way way = follow(&picture, by, &at, templates, rough, step_px);
        if (with_fourth_corner(by, rough, squared)) {
            const Way other = follow(&picture, by, &at, templates, squared, step_px);
            /* Perspective, too, makes a square no parallelogram: what is as straight as it is stays as it is. */
            if (other.straight && !(way.straight && way.spread_px < by->straighter * other.spread_px)) way = other;
        }
        for (int k = 0; k < 4; k++) corners[k] = way.corners[k];
        outcomes[i] = way.straight ? 0 : way.there ? 2 : 1;
    }
}
