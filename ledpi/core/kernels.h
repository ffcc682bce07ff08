/* Shared by the loops. Every function takes arrays as numpy lays them out (C order), keeps nothing, and
 * touches no element beyond the sizes that it is given. Numbers that are not finite are legal everywhere. */
#ifndef LEDPI_KERNELS_H
#define LEDPI_KERNELS_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A coordinate's pixel before, 0 … size − 2, and the share of the way to the next; beyond the picture that of its end.
 * What is not a number counts as 0, which is as good as any other place. */
static inline ptrdiff_t ledpi_interpolation_pixel(float at, ptrdiff_t size, float *share) {
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

/* Quantiles: of the light around, what is taken for dark; of that within a square, for a panel's own. */
#define LEDPI_DARK 0.05
#define LEDPI_BRIGHT 0.8

/* A quantile of grey levels, by how often each occurs. */
static inline int ledpi_quantile(const int32_t counts[256], double share) {
    int32_t total = 0, sum = 0;
    for (int i = 0; i < 256; i++) total += counts[i];
    const int32_t at = (int32_t)(share * total);
    int level = 0;
    while (level < 255 && (sum += counts[level]) <= at) level++;
    return level;
}

typedef struct {
    double x, y;
} Point;

/* (The library's hypot takes ten times as long, as it also adds what overflows.) */
static inline double ledpi_length(double x, double y) { return sqrt(x * x + y * y); }

/* The homography that takes (0,0) (1,0) (1,1) (0,1) to the corners; not a number where there is none (homography.c). */
void ledpi_unit_square_homography(const Point corners[4], double homography[9]);

#endif
