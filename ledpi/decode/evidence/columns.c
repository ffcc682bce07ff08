/* What each sample of a panel's cells is explained by, and the normal equations of that. */
#include <string.h>

#include "cells.h"
#include "simd.h"

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

LEDPI_SIMD void ledpi_slopes(const Panel *panel, const float *picture, float *room, float *across, float *down) {
    const ptrdiff_t n = panel->side, k = panel->k, size = n * k;
    float *logarithm = room, *of_next = room + size * size, *of_last = of_next + size, *of_row = of_last + size;
    slope_weights(panel->along, size, of_next, of_last);
    for (ptrdiff_t cell = 0; cell < panel->cells; cell++)
        for (ptrdiff_t y = 0; y < k; y++, picture += k) {
            float *to = logarithm + (cell / n * k + y) * size + cell % n * k;
            for (ptrdiff_t x = 0; x < k; x++) to[x] = logarithm_of(picture[x]);
        }
    for (ptrdiff_t row = 0; row < size; row++) {
        const float *here = logarithm + row * size, next = of_next[row], last = of_last[row];
        const float *below = row + 1 < size ? here + size : here, *above = row > 0 ? here - size : here;
        const ptrdiff_t from = row / k * n * k * k + row % k * k; /* of this row in its first cell; k·k further in the next */
        for (ptrdiff_t x = 0; x < size; x++) of_row[x] = next * (below[x] - here[x]) + last * (here[x] - above[x]);
        for (ptrdiff_t c = 0; c < n; c++) memcpy(down + from + c * k * k, of_row + c * k, sizeof(float) * (size_t)k);
        for (ptrdiff_t x = 1; x + 1 < size; x++)
            of_row[x] = of_next[x] * (here[x + 1] - here[x]) + of_last[x] * (here[x] - here[x - 1]);
        of_row[0] = of_row[size - 1] = 0.0f;
        if (size > 1) of_row[0] = of_next[0] * (here[1] - here[0]);
        if (size > 1) of_row[size - 1] = of_last[size - 1] * (here[size - 1] - here[size - 2]);
        for (ptrdiff_t c = 0; c < n; c++) memcpy(across + from + c * k * k, of_row + c * k, sizeof(float) * (size_t)k);
    }
}

/* The columns of the samples of one cell, (points, width). */
static inline void put_cell(const Panel *panel, const Terms *terms, ptrdiff_t cell, const ptrdiff_t waves, float *columns) {
    const ptrdiff_t k = panel->k, width = width_of(panel);
    const float *us = panel->along + cell % panel->side * k, *vs = panel->along + cell / panel->side * k;
    ptrdiff_t i = cell * panel->points;
    for (ptrdiff_t y = 0; y < k; y++)
        for (ptrdiff_t x = 0; x < k; x++, i++, columns += width) {
            const float weight = terms->weight[i], u = 2.0f * us[x] - 1.0f, v = 2.0f * vs[y] - 1.0f;
            float *slopes = columns + 1 + waves;
            columns[0] = weight;
            for (ptrdiff_t j = 0; j < waves; j++) columns[1 + j] = terms->bands[i] * terms->waves[j * panel->samples + i];
            put_slopes(u, v, weight * terms->across[i], weight * terms->down[i], slopes);
            slopes[8] = terms->residual[i];
            for (ptrdiff_t j = 2 + waves + SLOPES; j < width; j++) columns[j] = 0.0f;
        }
}

LEDPI_SIMD double ledpi_add_cells(const Panel *panel, const Terms *terms, float *columns, double *matrix) {
    const ptrdiff_t bands = panel->cells + SLOPES, size = unknowns(panel), width = width_of(panel), last = of_residual(panel);
    float sums[MOST_COLUMNS * MOST_COLUMNS];
    ptrdiff_t place[MOST_COLUMNS];
    double squares = 0.0;
    for (ptrdiff_t cell = 0; cell < panel->cells; cell++) {
        float *own = columns + cell * panel->points * width;
        if (panel->waves == 4) /* written twice, as loops of a known length are unrolled */
            put_cell(panel, terms, cell, 4, own);
        else
            put_cell(panel, terms, cell, panel->waves, own);
        memset(sums, 0, sizeof(float) * (size_t)(width * width));
        ledpi_add_products(own, panel->points, width, sums);
        place[0] = cell;
        for (ptrdiff_t i = 0; i < panel->waves; i++) place[1 + i] = bands + cell * panel->waves + i;
        for (ptrdiff_t i = 0; i < SLOPES; i++) place[first_slope(panel) + i] = panel->cells + i;
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
