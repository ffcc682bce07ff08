/* Where the cells of a panel meet, as decode/corners/inner_lines.py explains and does it. */
#include <math.h>

#include "lattice.h"
#include "wide.h"

enum { STEPS = 8, REACH = STEPS + 2, T = 2 * REACH + 1, PLACES = 6 };
#define REACH_PX 4.0
#define REACH_CELLS 0.5
#define FIRST_PLACE 0.15
#define LAST_PLACE 0.85
#define BLUR_PX 1.2
#define MOST_UNEVEN 0.4
#define LEAST_LIGHT 0.3
#define LEAST_CONTRAST 1e-4

void ledpi_line_place(ptrdiff_t i, ptrdiff_t cells, double *u, double *v) {
    ptrdiff_t half = cells * (cells - 1), of_axis = i % half;
    double line = (double)(of_axis / cells + 1) / (double)cells;
    double middle = ((double)(of_axis % cells) + 0.5) / (double)cells;
    *u = i < half ? line : middle;
    *v = i < half ? middle : line;
}

/* Mean light over a cell's length, on both sides of line i. */
static LEDPI_INLINE void light_across(const Picture *picture, const Homography *homography, double reach, Point moved,
                                      ptrdiff_t i, ptrdiff_t cells, double light[T]) {
    ptrdiff_t half = cells * (cells - 1);
    const double *h = homography->h;
    double u, v;
    ledpi_line_place(i, cells, &u, &v);
    const int by = i < half ? 0 : 1; /* across the line is along u, or along v */
    double across[T];
    float columns[PLACES][T], rows[PLACES][T], between[PLACES][T];
    for (int t = 0; t < T; t++) light[t] = 0.0, across[t] = reach * (t - REACH) / STEPS / (double)cells;
    for (int p = 0; p < PLACES; p++) {
        const double along = (FIRST_PLACE + (LAST_PLACE - FIRST_PLACE) * p / (PLACES - 1) - 0.5) / (double)cells;
        const double x = u + (by ? along : 0.0), y = v + (by ? 0.0 : along); /* on the line */
        const double top = h[0] * x + h[1] * y + h[2], side = h[3] * x + h[4] * y + h[5], below = h[6] * x + h[7] * y + 1.0;
        for (int t = 0; t < T; t++) {
            const double scale = 1.0 / (below + h[6 + by] * across[t]);
            columns[p][t] = (float)((top + h[by] * across[t]) * scale + moved.x);
            rows[p][t] = (float)((side + h[3 + by] * across[t]) * scale + moved.y);
        }
    }
    ledpi_light_at_all(picture, columns[0], rows[0], PLACES * T, between[0]);
    for (int p = 0; p < PLACES; p++)
        for (int t = 0; t < T; t++) light[t] += between[p][t];
    for (int t = 0; t < T; t++) light[t] /= PLACES;
}

static double dot(const double *a, const double *b) {
    double sum = 0.0;
    for (int t = 0; t < STEPS; t++) sum += a[t] * b[t];
    return sum;
}

static void unit(double *course) {
    double scale = 1.0 / sqrt(dot(course, course) + 1e-12);
    for (int t = 0; t < STEPS; t++) course[t] *= scale;
}

static void without(double *course, const double *unit_course) {
    double share = dot(course, unit_course);
    for (int t = 0; t < STEPS; t++) course[t] -= share * unit_course[t];
}

/* Derivative by the step, exact to its fourth power, of an even course from none to two steps more. */
static void slope_of(const double even[REACH + 1], double step_px, double slope[STEPS]) {
    for (int t = 1; t <= STEPS; t++)
        slope[t - 1] = (8.0 * (even[t + 1] - even[t - 1]) - (even[t + 2] - even[t < 2 ? 2 - t : t - 2])) / (12.0 * step_px);
}

/* Light across the lines that run one way, taken apart. */
typedef struct {
    double even[MOST_INNER / 2][REACH + 1], odd[MOST_INNER / 2][STEPS];
    bool shown[MOST_INNER / 2];
} Across;

LEDPI_WIDE static void take_apart(const Picture *picture, const Homography *homography, double reach, const Point *moves,
                       ptrdiff_t cells, ptrdiff_t first, Across *all) {
    ptrdiff_t count = cells * (cells - 1);
    double level[MOST_INNER / 2], ordered[MOST_INNER / 2], uneven[MOST_INNER / 2];
    for (ptrdiff_t i = 0; i < count; i++) {
        double light[T];
        light_across(picture, homography, reach, moves[first + i], first + i, cells, light);
        level[i] = uneven[i] = 0.0;
        for (int t = 2; t < T - 2; t++) level[i] += light[t] / (T - 4);
        double scale = 0.5 / fmax(level[i], 1e-6);
        for (int t = 0; t <= REACH; t++) all->even[i][t] = (light[REACH + t] + light[REACH - t]) * scale;
        for (int t = 1; t <= STEPS; t++) {
            all->odd[i][t - 1] = (light[REACH + t] - light[REACH - t]) * scale;
            uneven[i] += fabs(all->odd[i][t - 1]) / STEPS;
        }
        ordered[i] = level[i];
    }
    double median = ledpi_kth(ordered, count, count / 2);
    median = 0.5 * (median + ledpi_kth(ordered, count, (count - 1) / 2)); /* an even number of them */
    for (ptrdiff_t i = 0; i < count; i++) all->shown[i] = level[i] > LEAST_LIGHT * median && uneven[i] < MOST_UNEVEN;
}

/* `_shifts` there, of one way. */
static void shifts(Across *all, ptrdiff_t cells, double step_px, double *off, double *variance) {
    ptrdiff_t count = cells * (cells - 1), shown = 0;
    double half[2][REACH + 1] = {{0.0}}, slopes[2][STEPS], sloping[STEPS], uneven[STEPS], slope[STEPS];
    double counted[2] = {0.0, 0.0};
    for (ptrdiff_t i = 0; i < count; i++) {
        if (!all->shown[i]) continue;
        ptrdiff_t k = i % cells & 1;
        counted[k] += 1.0, shown++;
        for (int t = 0; t <= REACH; t++) half[k][t] += all->even[i][t];
    }
    for (int k = 0; k < 2; k++) {
        for (int t = 0; t <= REACH; t++) half[k][t] /= fmax(counted[k], 1.0);
        slope_of(half[k], step_px, slopes[k]);
    }
    for (int t = 0; t < STEPS; t++) {
        double away = step_px * (t + 1), usual = 0.5 * (half[0][t + 1] + half[1][t + 1]);
        sloping[t] = usual * away;
        uneven[t] = usual * tanh(away / BLUR_PX);
    }
    unit(sloping);
    without(uneven, sloping);
    unit(uneven);
    for (int k = 0; k < 2; k++) {
        without(slopes[k], sloping);
        without(slopes[k], uneven);
    }
    for (int t = 0; t < STEPS; t++) slope[t] = 0.5 * (slopes[0][t] + slopes[1][t]);
    double contrast = dot(slopes[0], slopes[1]), left = 0.0;
    bool seen = contrast > LEAST_CONTRAST;
    if (!seen) contrast = 1.0;
    for (ptrdiff_t i = 0; i < count; i++) {
        double *odd = all->odd[i];
        without(odd, sloping);
        without(odd, uneven);
        off[i] = -dot(odd, slope) / contrast;
        if (!all->shown[i]) continue;
        for (int t = 0; t < STEPS; t++) {
            double rest = odd[t] + off[i] * slope[t];
            left += rest * rest;
        }
    }
    double noise = left / ((STEPS - 3) * fmax((double)shown, 1.0)) * fmax(1.0 / step_px, 1.0);
    double each = seen ? noise * dot(slope, slope) / (contrast * contrast) : NOT_SEEN_PX2;
    for (ptrdiff_t i = 0; i < count; i++) variance[i] = all->shown[i] ? each : NOT_SEEN_PX2;
}

void ledpi_inner_lines(const Picture *picture, const Homography *homography, const double pitch_px[2], const Point *moves,
                       ptrdiff_t cells, double *off, double *variance) {
    ptrdiff_t half = cells * (cells - 1);
    Across all;
    for (int axis = 0; axis < 2; axis++) {
        double reach = fmin(REACH_CELLS, REACH_PX / pitch_px[axis]);
        take_apart(picture, homography, reach, moves, cells, axis * half, &all);
        shifts(&all, cells, reach * pitch_px[axis] / STEPS, off + axis * half, variance + axis * half);
    }
}
