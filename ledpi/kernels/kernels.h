/* What the loops share. Every function takes arrays as numpy lays them out (C order), allocates nothing, keeps nothing, and
 * touches no element beyond the sizes that it is told. Numbers that are not finite are legal everywhere. */
#ifndef LEDPI_KERNELS_H
#define LEDPI_KERNELS_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A grey picture, and the table (256,) from its codes to linear light. */
typedef struct {
    const uint8_t *pixels;
    ptrdiff_t height, width, stride; /* stride: bytes from a row to the next; width and height at least 2 */
    const float *light;
} Picture;

/* A coordinate's pixel before, 0 … size − 2, and the share of the way to the next; beyond the picture that of its end.
 * What is not a number counts as 0, which is as good as any other place. */
static inline ptrdiff_t ledpi_before(float at, ptrdiff_t size, float *share) {
    if (!(at > 0.0f)) {
        *share = 0.0f;
        return 0;
    }
    if (at >= (float)(size - 1)) {
        *share = 1.0f;
        return size - 2;
    }
    ptrdiff_t pixel = (ptrdiff_t)at;
    *share = at - (float)pixel;
    return pixel;
}

/* Linear light between pixels, bilinear, at `count` places; beyond the picture as at its border (light.c). Of several places
 * at a time it is told which pixels are around. */
void ledpi_light_at_all(const Picture *picture, const float *x, const float *y, ptrdiff_t count, float *light);

/* ---- The four sides of quads, as in decode/corners/sides.py (sides.c). */

enum { MOST_PROFILES = 64 }; /* across a side */

typedef struct {
    double x, y;
} Point;

/* (The library's hypot takes ten times as long, as it also adds what overflows.) */
static inline double ledpi_length(double x, double y) { return sqrt(x * x + y * y); }

typedef struct {
    Point start, along, inward; /* along: to the next corner; inward: the unit normal */
    double length;
} Side;

/* Where a side is looked across: shares of the way along it, and what either of its bends moves each of them. */
typedef struct {
    ptrdiff_t count; /* at most MOST_PROFILES */
    const double *share, *bend; /* (count,), (2, count) */
} Shares;

void ledpi_sides_of(const Point corners[4], Side sides[4]);

/* The corners after each side has moved inward by middle + slope·(share of the way − ½). */
void ledpi_moved(const Side sides[4], const double middle[4], const double slope[4], Point corners[4]);

/* The line through `found` (count,) by weighted least squares: at half of the side, and slope over its length. */
void ledpi_fit_line(const Shares *shares, const double *found, const double *weights, double *middle, double *slope);

/* Weights (count,): 1 for those of the `good` of `found` that are so near to their median. */
void ledpi_near_median(ptrdiff_t count, const double *found, const bool *good, double distance, double *weights);

/* Standard deviation of the `good` of `found` about a line, and the weight (count,) that each deserves. */
double ledpi_deviation(const Shares *shares, const double *found, const bool *good, double middle, double slope,
                       double *weights);

/* Which profiles (4, count) of a quad have a step that may be the panel's. False: not enough on every side. */
bool ledpi_steps(ptrdiff_t count, const double *height, bool *good);

/* The k-th smallest of `numbers` (count,), which it puts into another order. */
double ledpi_kth(double *numbers, ptrdiff_t count, ptrdiff_t k);

double ledpi_area(const Point corners[4]); /* positive where they run clockwise in the picture */

/* The homography that takes (0,0) (1,0) (1,1) (0,1) to the corners; not a number where there is none. */
void ledpi_unit_square_to(const Point corners[4], double homography[9]);

double ledpi_farthest(const Point a[4], const Point b[4]); /* NaN where a corner is none */

/* Constants of decode/corners/approach.py, where they are explained. */
typedef struct {
    double finest_step_px, max_tilt_steps, cut_off, obtuse, straighter, max_spread_px, max_spread_steps, almost, max_move;
} Approaching;

/* ---- Where light steps up the most across the sides of a quad, as `nearest_sides` in decode/corners/approach.py (approach.c).
 * Returns whether it has such steps all round; `spread_px` is that of the steps about the sides. */
bool ledpi_nearest(const Picture *picture, const Approaching *by, const Shares *shares, const float *templates,
                   const Point corners[4], double step_px, Point found[4], double *spread_px);

#endif
