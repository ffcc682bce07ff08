/* What each sample of a panel's cells is explained by, and the normal equations of that. */
#include <math.h>
#include <string.h>

#include "cells.h"


/* Of a parabola through three of `values`, `stride` apart, that stand at the places `along`; at an end of two. */
static inline float slope_at(const float *values, ptrdiff_t stride, const float *along, ptrdiff_t i, ptrdiff_t size) {
    const ptrdiff_t next = i + 1 < size ? i + 1 : i, last = i > 0 ? i - 1 : i;
    if (next == last) return 0.0f;
    const float ahead = along[next] - along[i], behind = along[i] - along[last];
    const float rise = values[next * stride] - values[i * stride], fall = values[i * stride] - values[last * stride];
    if (next == i || last == i) return (rise + fall) / (ahead + behind);
    return (rise * behind * behind + fall * ahead * ahead) / (ahead * behind * (ahead + behind));
}

void ledpi_put_slopes(const Panel *panel, const float *picture, const float *weight, float *logarithm, float *columns) {
    const ptrdiff_t n = panel->side, k = panel->k, size = n * k, width = width_of(panel);
    for (ptrdiff_t cell = 0; cell < panel->cells; cell++)
        for (ptrdiff_t y = 0; y < k; y++) {
            float *to = logarithm + (cell / n * k + y) * size + cell % n * k;
            for (ptrdiff_t x = 0; x < k; x++) to[x] = logf(*picture++);
        }
    for (ptrdiff_t cell = 0, i = 0; cell < panel->cells; cell++)
        for (ptrdiff_t row = cell / n * k; row < cell / n * k + k; row++)
            for (ptrdiff_t column = cell % n * k; column < cell % n * k + k; column++, i++) {
                const float across = weight[i] * slope_at(logarithm + row * size, 1, panel->along, column, size);
                const float down = weight[i] * slope_at(logarithm + column, size, panel->along, row, size);
                const float *shift = panel->shifts + i;
                float *into = columns + i * width + first_slope(panel);
                for (int way = 0; way < SLOPES; way++, shift += 2 * panel->samples)
                    into[way] = shift[0] * across + shift[panel->samples] * down;
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
