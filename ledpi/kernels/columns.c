/* What each sample of a panel's cells is explained by, and the normal equations of that. */
#include <math.h>
#include <string.h>

#include "cells.h"
#include "wide.h"


/* Natural logarithm, off by less than 1e-7 of its size; not a number where `x` is none. (In line, unlike the library's.) */
static inline float logarithm_of(float x) {
    int32_t bits;
    memcpy(&bits, &x, sizeof bits);
    const int32_t exponent = (bits - 0x3f3504f3) >> 23; /* of what is from √½ to √2 once that is taken off */
    bits -= exponent * (1 << 23);
    float part;
    memcpy(&part, &bits, sizeof part);
    const float t = (part - 1.0f) / (part + 1.0f), s = t * t;
    const float series = 2.0f * t * (1.0f + s * (1.0f / 3 + s * (1.0f / 5 + s * (1.0f / 7 + s / 9))));
    return (series + (float)exponent * 0.693147180559945f) + (x - x);
}

/* The slope at each of the places `along` (size,) of a parabola through three values, at an end of the line through two:
 * what the rise to the next one weighs, and that from the last one. */
static void slope_weights(const float *along, ptrdiff_t size, float *of_next, float *of_last) {
    for (ptrdiff_t i = 0; i < size; i++) {
        const float ahead = i + 1 < size ? along[i + 1] - along[i] : 0.0f, behind = i > 0 ? along[i] - along[i - 1] : 0.0f;
        of_next[i] = i + 1 == size ? 0.0f : i == 0 ? 1.0f / ahead : behind / (ahead * (ahead + behind));
        of_last[i] = i == 0 ? 0.0f : i + 1 == size ? 1.0f / behind : ahead / (behind * (ahead + behind));
    }
}

LEDPI_WIDE void ledpi_put_slopes(const Panel *panel, const float *picture, const float *weight, float *room,
                                 float *columns) {
    const ptrdiff_t n = panel->side, k = panel->k, size = n * k, width = width_of(panel);
    float *logarithm = room, *across = room + size * size, *down = across + size, *of_next = down + size;
    float *of_last = of_next + size;
    const float *along = panel->along;
    slope_weights(along, size, of_next, of_last);
    for (ptrdiff_t cell = 0; cell < panel->cells; cell++)
        for (ptrdiff_t y = 0; y < k; y++, picture += k) {
            float *to = logarithm + (cell / n * k + y) * size + cell % n * k;
            for (ptrdiff_t x = 0; x < k; x++) to[x] = logarithm_of(picture[x]);
        }
    for (ptrdiff_t row = 0; row < size; row++) {
        const float *here = logarithm + row * size, next = of_next[row], last = of_last[row], v = 2.0f * along[row] - 1.0f;
        const float *below = row + 1 < size ? here + size : here, *above = row > 0 ? here - size : here;
        for (ptrdiff_t x = 0; x < size; x++) down[x] = next * (below[x] - here[x]) + last * (here[x] - above[x]);
        for (ptrdiff_t x = 1; x + 1 < size; x++)
            across[x] = of_next[x] * (here[x + 1] - here[x]) + of_last[x] * (here[x] - here[x - 1]);
        across[0] = size > 1 ? of_next[0] * (here[1] - here[0]) : 0.0f;
        if (size > 1) across[size - 1] = of_last[size - 1] * (here[size - 1] - here[size - 2]);
        for (ptrdiff_t cell = row / k * n, x = 0; x < size; cell++) {
            const ptrdiff_t i = (cell * k + row % k) * k;
            float *into = columns + i * width + first_slope(panel);
            for (const float *own = weight + i, *end = own + k; own < end; own++, x++, into += width) {
                const float u = 2.0f * along[x] - 1.0f, by_u = *own * across[x], by_v = *own * down[x];
                const float both = u * by_u + v * by_v;
                into[0] = by_u, into[1] = u * by_u, into[2] = v * by_u;
                into[3] = by_v, into[4] = u * by_v, into[5] = v * by_v;
                into[6] = u * both, into[7] = v * both;
            }
        }
    }
}

void ledpi_put_waves(const Panel *panel, const float *waves, const float *weight, float *columns) {
    const ptrdiff_t width = width_of(panel);
    for (ptrdiff_t wave = 0; wave < panel->waves; wave++, waves += panel->samples)
        for (ptrdiff_t i = 0; i < panel->samples; i++) columns[i * width + 1 + wave] = weight[i] * waves[i];
}

double ledpi_add_cells(const Panel *panel, ptrdiff_t gains, const float *columns, double *matrix) {
    const ptrdiff_t size = unknowns(panel, gains), width = width_of(panel), last = of_residual(panel);
    float sums[MOST_COLUMNS * MOST_COLUMNS];
    ptrdiff_t place[MOST_COLUMNS];
    double squares = 0.0;
    for (ptrdiff_t cell = 0; cell < panel->cells; cell++) {
        memset(sums, 0, sizeof(float) * (size_t)(width * width));
        ledpi_add_products(columns + cell * panel->points * width, panel->points, width, sums);
        place[0] = gains > 1 ? cell : 0;
        for (ptrdiff_t i = 0; i < panel->waves; i++) place[1 + i] = gains + SLOPES + cell * panel->waves + i;
        for (ptrdiff_t i = 0; i < SLOPES; i++) place[first_slope(panel) + i] = gains + i;
        place[last] = size;
        for (ptrdiff_t i = 0; i < last; i++)
            for (ptrdiff_t j = i; j <= last; j++) {
                const ptrdiff_t a = place[i] < place[j] ? place[i] : place[j], b = place[i] + place[j] - a;
                matrix[a * (size + 1) + b] += sums[i * width + j];
            }
        squares += sums[last * width + last];
    }
    return squares;
}
