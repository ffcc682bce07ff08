/* What a picture says of the bands in a panel's cells by comparison with the mean of those before: `compared_evidence` of
 * decode/evidence/comparison.py, which says why. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cells.h"
#include "core.h"
#include "simd.h"

#define LEAST 1e-9 /* of what is divided by */

/* The frames before: their mean picture, above 0, in how many each sample was seen, and the mean of their waves. */
typedef struct {
    const float *picture, *count, *waves;
} Mean;

static inline bool is_seen(const Panel *panel, const Mean *mean, ptrdiff_t i) {
    return mean->count[i] > 0.0f && (!panel->valid || panel->valid[i]);
}

/* Light of the mean picture's unit over that of the new one. */
static double scale_of(const Panel *panel, const Mean *mean, const float *light) {
    double product = 0.0, square = 0.0;
    for (ptrdiff_t i = 0; i < panel->samples; i++) {
        const float picture = is_seen(panel, mean, i) ? mean->picture[i] : 0.0f;
        product += light[i] * picture;
        square += picture * picture;
    }
    return fmax(product / fmax(square, LEAST), LEAST);
}

/* `root` of each sample's weight, `residual` and `waves` (panel->waves): how the new picture differs. Returns how many
 * samples are seen in both. */
LEDPI_SIMD static ptrdiff_t put_differences(const Panel *panel, const Mean *mean, const float *light, float per_unit,
                                            const float *new_waves, float *root, float *residual, float *waves) {
    const ptrdiff_t samples = panel->samples;
    ptrdiff_t seen = 0;
    double total = 0.0;
    for (ptrdiff_t i = 0; i < samples; i++) {
        const bool both = is_seen(panel, mean, i);
        const float count = mean->count[i];
        root[i] = both ? mean->picture[i] * count / (count + 1.0f) : 0.0f;
        seen += root[i] > 0.0f;
        total += root[i];
    }
    const float per_weight = (float)(1.0 / fmax(total / (double)samples, LEAST));
    for (ptrdiff_t i = 0; i < samples; i++) root[i] = sqrtf(root[i] * per_weight);
    for (ptrdiff_t i = 0; i < samples; i++) residual[i] = (light[i] * per_unit / mean->picture[i] - 1.0f) * root[i];
    for (ptrdiff_t i = 0; i < samples * panel->waves; i++) waves[i] = new_waves[i] - mean->waves[i];
    return seen;
}

/* `score` (cells, waves), `information` (cells, waves, cells, waves), and four `numbers`: the light's scale, how many
 * samples are free, and two sums of what is left of the light (`ledpi_put_differences`). False where the evidence cannot
 * be had. */
bool ledpi_compared_evidence(ptrdiff_t side, ptrdiff_t k, ptrdiff_t count, const float *light, const uint8_t *valid,
                             const float *new_waves, const float *picture, const float *counts, const float *mean_waves,
                             const float *along, double independence, ptrdiff_t aside, ptrdiff_t below, ptrdiff_t rim,
                             double *score, double *information, double *numbers) {
    const Panel panel = {side, k, count, side * side, k * k, side * side * k * k, valid, along};
    const Lags lags = {aside, below, rim};
    const Mean mean = {picture, counts, mean_waves};
    const ptrdiff_t size = unknowns(&panel, 1), matrix_size = size * (size + 1), samples = panel.samples;
    const ptrdiff_t floats = samples * (5 + count + width_of(&panel)) + 3 * side * k;
    double *matrix = malloc(sizeof(double) * (size_t)(matrix_size + size) + sizeof(float) * (size_t)floats);
    numbers[0] = scale_of(&panel, &mean, light);
    numbers[1] = 0.0;
    if (!matrix) return false;
    memset(matrix, 0, sizeof(double) * (size_t)matrix_size);
    double *unknown = matrix + matrix_size;
    float *root = (float *)(unknown + size), *residual = root + samples, *across = residual + samples;
    float *down = across + samples, *room = down + samples, *waves = room + samples + 3 * side * k;
    const float per_unit = (float)(1.0 / numbers[0]);
    const ptrdiff_t seen = put_differences(&panel, &mean, light, per_unit, new_waves, root, residual, waves);
    ledpi_slopes(&panel, picture, room, across, down);
    const Terms terms = {root, root, waves, across, down, residual};
    const double squares = ledpi_add_cells(&panel, 1, &terms, waves + count * samples, matrix);
    numbers[1] = (double)(seen - size);
    const bool fits = ledpi_weigh(matrix, size, 1 + SLOPES, squares, numbers[1], independence, score, information);
    if (fits) {
        ledpi_solve(matrix, size, unknown);
        ledpi_leave(&panel, 1, waves + count * samples, unknown, residual);
        ledpi_put_differences(&panel, residual, &lags, numbers + 2);
    }
    free(matrix);
    return fits;
}
