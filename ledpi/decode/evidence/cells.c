/* The light of a panel's cells, on a lattice of points in each: `sample_cells` of cells.py. */
#include <math.h>
#include <stdlib.h>

#include "core.h"
#include "kernels.h"
#include "lens.h"
#include "simd.h"

enum {
    TAPS = 8, /* of Lanczos' kernel, the fourth at the pixel before */
    MARGIN = 4, /* pixels that it takes in on either side */
};

/* The part of a picture that is sampled, in linear light. */
typedef struct {
    float *light; /* (rows, columns) */
    ptrdiff_t first_column, first_row, columns, rows;
} Patch;

/* The part that has these places (count,) in it, with as much on each side as the interpolation takes in; false where they, or
 * `corners` (4, 2), leave the picture. */
static bool put_window(const Picture *picture, const double *corners, const float *places[2], ptrdiff_t count, Patch *patch) {
    ptrdiff_t first[2], wide[2];
    for (int axis = 0; axis < 2; axis++) {
        const ptrdiff_t size = axis ? picture->height : picture->width;
        for (int i = 0; i < 4; i++)
            if (!(corners[2 * i + axis] >= 0.0 && corners[2 * i + axis] <= (double)(size - 1))) return false;
        float low = INFINITY, high = -INFINITY;
        for (ptrdiff_t i = 0; i < count; i++) low = fminf(low, places[axis][i]), high = fmaxf(high, places[axis][i]);
        if (!(low >= 0.0f && high <= (float)(size - 1))) return false;
        first[axis] = (ptrdiff_t)low + 1 - MARGIN;
        if (first[axis] < 0) first[axis] = 0;
        wide[axis] = (ptrdiff_t)high + 1 + MARGIN - first[axis];
        if (wide[axis] > size - first[axis]) wide[axis] = size - first[axis];
    }
    patch->first_column = first[0], patch->columns = wide[0];
    patch->first_row = first[1], patch->rows = wide[1];
    return true;
}

/* Whether one of `count` pixels is saturated. */
static bool any_saturated(const uint8_t *pixels, ptrdiff_t count) {
    uint8_t most = 0;
    for (ptrdiff_t i = 0; i < count; i++) most = pixels[i] > most ? pixels[i] : most;
    return most == 255;
}

/* Returns whether a pixel of it is saturated: then it is not a number. */
static bool linearise(const Picture *picture, Patch *patch) {
    const float *table = picture->light;
    const uint8_t *pixel = picture->pixels + patch->first_row * picture->stride + patch->first_column;
    float *into = patch->light;
    bool saturated = false;
    for (ptrdiff_t row = 0; row < patch->rows; row++, into += patch->columns, pixel += picture->stride) {
        saturated = any_saturated(pixel, patch->columns) || saturated;
        for (ptrdiff_t column = 0; column < patch->columns; column++) into[column] = table[pixel[column]];
    }
    return saturated;
}

static ptrdiff_t within(ptrdiff_t index, ptrdiff_t size) { return index < 0 ? 0 : index >= size ? size - 1 : index; }

/* The pixel before a place, and the share of the way to the next; places far outside, or that are no numbers, are at an
 * end of the patch. */
static ptrdiff_t before(double at, ptrdiff_t size, double *share) {
    if (!(at > -1.0)) at = -1.0;
    if (at > (double)size) at = (double)size;
    ptrdiff_t pixel = (ptrdiff_t)(at + 1.0) - 1; /* rounded down: what is cut off is positive */
    *share = at - (double)pixel;
    return pixel;
}

static float bilinear(const Patch *patch, double x, double y) {
    double right, down;
    ptrdiff_t column = before(x, patch->columns, &right), row = before(y, patch->rows, &down);
    const float *above = patch->light + within(row, patch->rows) * patch->columns;
    const float *below = patch->light + within(row + 1, patch->rows) * patch->columns;
    ptrdiff_t left = within(column, patch->columns), next = within(column + 1, patch->columns);
    double upper = above[left] + right * (above[next] - above[left]);
    double lower = below[left] + right * (below[next] - below[left]);
    return (float)(upper + down * (lower - upper));
}

/* Eight numbers that the processor treats at once, or in two halves: the compilers of all systems that there are for Pis
 * know this. They may lie anywhere. */
typedef float Taps __attribute__((vector_size(32), aligned(4)));

/* `TAPS` × `TAPS` pixels from this one, which may be outside, by Lanczos' weights across and downward. */
static inline float lanczos(const Patch *patch, ptrdiff_t column, ptrdiff_t row, const float *across, const float *downward) {
    Taps sums = {0}; /* of the columns, down them */
    if (column >= 0 && row >= 0 && column + TAPS <= patch->columns && row + TAPS <= patch->rows) {
        const float *light = patch->light + row * patch->columns + column;
        for (int j = 0; j < TAPS; j++, light += patch->columns) sums += downward[j] * *(const Taps *)light;
    } else {
        for (int j = 0; j < TAPS; j++) {
            const float *light = patch->light + within(row + j, patch->rows) * patch->columns;
            for (int i = 0; i < TAPS; i++) sums[i] += downward[j] * light[within(column + i, patch->columns)];
        }
    }
    sums *= *(const Taps *)across;
    return ((sums[0] + sums[4]) + (sums[1] + sums[5])) + ((sums[2] + sums[6]) + (sums[3] + sums[7]));
}

enum { AT_ONCE = 64 }; /* places for which taps are computed */

/* The first pixel that is taken in at each place, and where in the kernel its weights begin. */
static LEDPI_INLINE void put_taps(const double *at, ptrdiff_t count, ptrdiff_t size, ptrdiff_t steps, int32_t *pixel,
                                  int32_t *weights) {
    for (ptrdiff_t i = 0; i < count; i++) {
        double share, place = at[i] > -1.0 ? at[i] : -1.0; /* as `before` has it */
        place = place < (double)size ? place : (double)size;
        pixel[i] = (int32_t)(place + 1.0) - 1;
        share = place - (double)pixel[i];
        weights[i] = (int32_t)(share * (double)steps + 0.5) * TAPS;
        pixel[i] -= 3;
    }
}

/* Replaces columns of the patch (count) by the light there, in these rows of the picture. `kernel` (steps + 1, TAPS):
 * Lanczos' weights for every share of the way. */
LEDPI_SIMD static void interpolate(const Patch *patch, const float *kernel, ptrdiff_t steps, bool saturated,
                                   const float *rows, ptrdiff_t count, float *columns) {
    const double left = (double)patch->first_column, first = (double)patch->first_row;
    for (ptrdiff_t from = 0; from < count; from += AT_ONCE, columns += AT_ONCE, rows += AT_ONCE) {
        const ptrdiff_t here = count - from < AT_ONCE ? count - from : AT_ONCE;
        double x[AT_ONCE], y[AT_ONCE];
        int32_t column[AT_ONCE], row[AT_ONCE], across[AT_ONCE], downward[AT_ONCE];
        for (ptrdiff_t i = 0; i < here; i++) x[i] = columns[i] - left, y[i] = rows[i] - first;
        for (ptrdiff_t i = 0; saturated && i < here; i++) columns[i] = bilinear(patch, x[i], y[i]);
        if (saturated) continue;
        put_taps(x, here, patch->columns, steps, column, across);
        put_taps(y, here, patch->rows, steps, row, downward);
        for (ptrdiff_t i = 0; i < here; i++)
            columns[i] = lanczos(patch, column[i], row[i], kernel + across[i], kernel + downward[i]);
    }
}

/* In which `columns` (cells², k²) and `rows` of the picture the lattice's points are seen. */
LEDPI_SIMD static void put_places(const double h[9], const Lens *lens, ptrdiff_t cells, ptrdiff_t k,
                                  const float *along, float *columns, float *rows) {
    for (ptrdiff_t cell = 0; cell < cells * cells; cell++) {
        const float *us = along + cell % cells * k, *vs = along + cell / cells * k;
        for (ptrdiff_t j = 0; j < k; j++, columns += k, rows += k) {
            const double v = vs[j], x0 = h[1] * v + h[2], y0 = h[4] * v + h[5], w0 = h[7] * v + 1.0;
            for (ptrdiff_t i = 0; i < k; i++) {
                const double u = us[i], w = 1.0 / (h[6] * u + w0);
                columns[i] = (float)((h[0] * u + x0) * w);
                rows[i] = (float)((h[3] * u + y0) * w);
            }
            for (ptrdiff_t i = 0; lens && i < k; i++) {
                const double u = us[i], w = 1.0 / (h[6] * u + w0);
                double at[2], by[2][2];
                ledpi_distort(lens, (h[0] * u + x0) * w, (h[3] * u + y0) * w, at, by);
                columns[i] = (float)at[0];
                rows[i] = (float)at[1];
            }
        }
    }
}

/* The sum over the samples of the cell with the least, not a number where one is none. */
static double least_light(ptrdiff_t cells, ptrdiff_t points, const float *light) {
    bool numbers = true;
    double least = INFINITY;
    for (ptrdiff_t cell = 0; cell < cells; cell++, light += points) {
        const double sum = ledpi_sum(light, points);
        numbers = numbers && !isnan(sum);
        least = fmin(least, sum);
    }
    return numbers ? least : NAN;
}

/* Samples cells × cells cells inside `corners` (4, 2), k × k points in each, at the places `along` (cells·k,) across the panel and
 * down it; bent by the `lens` unless that is none. Light (cells², k²) and the picture row of each sample. Lanczos' kernel, or
 * straight lines where a pixel is saturated; `least` is the least sum over a cell's samples. */
int ledpi_sample_cells(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                       const double *corners, const double *lens_numbers, ptrdiff_t cells, ptrdiff_t k, const float *along,
                       const float *kernel, ptrdiff_t steps, float *light, float *picture_rows, double *least) {
    const Lens *lens = (const Lens *)lens_numbers;
    const Picture picture = {pixels, height, width, stride, table};
    const ptrdiff_t count = cells * cells * k * k;
    Patch patch;
    Point seen[4];
    double h[9];
    for (int i = 0; i < 4; i++) {
        double ray[2] = {corners[2 * i], corners[2 * i + 1]};
        if (lens) ledpi_ray_of(lens, corners + 2 * i, ray);
        seen[i] = (Point){ray[0], ray[1]};
    }
    ledpi_unit_square_homography(seen, h);
    put_places(h, lens, cells, k, along, light, picture_rows);
    const float *places[] = {light, picture_rows};
    if (height < 2 || width < 2 || !put_window(&picture, corners, places, count, &patch)) return LEDPI_OUTSIDE;
    patch.light = malloc(sizeof(float) * (size_t)(patch.columns * patch.rows));
    if (!patch.light) return LEDPI_NOT_SAMPLED;
    const bool saturated = linearise(&picture, &patch);
    interpolate(&patch, kernel, steps, saturated, picture_rows, count, light);
    free(patch.light);
    *least = least_light(cells * cells, k * k, light);
    return saturated ? LEDPI_SOME_SATURATED : LEDPI_NONE_SATURATED;
}
