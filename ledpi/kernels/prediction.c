/* Whether a frame shows what is predicted: decode/evidence/prediction.py says why. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "cells.h"
#include "core.h"
#include "waves.h"
#include "simd.h"

#define TURN 6.283185307179586 /* rad */
enum { WAYS = LEDPI_NUISANCES, VECTORS = 3 }; /* of `put_ways`, and of `compare` */

/* What is expected, as in decode/evidence/prediction.py: picture, root, residual_bands (cells, points), basis (WAYS,
 * cells·points), and the bands of each cell: frequency, phase (rad), depth (cells,); and when the frame's rows were read out.
 * */
typedef struct {
    ptrdiff_t cells, points;
    const float *picture, *root, *basis, *residual_bands, *depth;
    const double *hz, *phase;
    double since_s, row_time_s;
} Prediction;

typedef float Four __attribute__((vector_size(16), aligned(4)));

static inline double all_of(Four sums) { return (double)(sums[0] + sums[1]) + (double)(sums[2] + sums[3]); }

static inline double dot(const float *a, const float *b, ptrdiff_t count) {
    Four first = {0}, second = {0};
    ptrdiff_t i = 0;
    for (; i + 8 <= count; i += 8) {
        first += *(const Four *)(a + i) * *(const Four *)(b + i);
        second += *(const Four *)(a + i + 4) * *(const Four *)(b + i + 4);
    }
    double sum = all_of(first + second);
    for (; i < count; i++) sum += a[i] * b[i];
    return sum;
}

/* Of VECTORS (cells·points) each, weighted: what the frame adds to the picture beyond what it should, the bands it should
 * show, and how these have changed since the picture. */
LEDPI_SIMD static void compare(const Prediction *expected, const float *light, const uint8_t *valid, const float *rows,
                               float *restrict off, float *restrict bands, float *restrict change) {
    const ptrdiff_t cells = expected->cells, points = expected->points, size = cells * points;
    for (ptrdiff_t i = 0; valid && i < size; i++) off[i] = valid[i] ? expected->picture[i] : 0.0f;
    const float scale = (float)(ledpi_sum(valid ? off : expected->picture, size) / ledpi_sum(light, size));
    for (ptrdiff_t c = 0, from = 0; c < cells; c++, from += points) {
        const double cycles = expected->hz[c] * expected->since_s;
        const float start = (float)(cycles - floor(cycles) - expected->phase[c] / TURN), depth = expected->depth[c];
        const float a_row = (float)(expected->hz[c] * expected->row_time_s);
        for (ptrdiff_t i = from; i < from + points; i++) {
            const float own = depth * ledpi_cosine(ledpi_part(rows[i] * a_row + start)), root = expected->root[i];
            bands[i] = own * root;
            change[i] = (own - expected->residual_bands[i]) * root;
            off[i] = (light[i] * scale / expected->picture[i] - 1.0f) * root - change[i];
        }
    }
    for (ptrdiff_t i = 0; valid && i < size; i++)
        if (!valid[i]) off[i] = bands[i] = change[i] = 0.0f;
}

/* Solves a symmetric positive matrix for right sides (WAYS, VECTORS), in place. Gauss. */
static void solve(double matrix[WAYS][WAYS], double right[WAYS][VECTORS]) {
    for (ptrdiff_t k = 0; k < WAYS; k++)
        for (ptrdiff_t i = k + 1; i < WAYS; i++) {
            const double factor = matrix[i][k] / matrix[k][k];
            for (ptrdiff_t j = k; j < WAYS; j++) matrix[i][j] -= factor * matrix[k][j];
            for (int j = 0; j < VECTORS; j++) right[i][j] -= factor * right[k][j];
        }
    for (ptrdiff_t k = WAYS - 1; k >= 0; k--)
        for (int j = 0; j < VECTORS; j++) {
            for (ptrdiff_t i = k + 1; i < WAYS; i++) right[k][j] -= matrix[k][i] * right[i][j];
            right[k][j] /= matrix[k][k];
        }
}

/* Takes off what a wrong gain and wrong corners would add. Where samples are not valid, what is left of the basis is not
 * orthonormal any more; `ridge` is of the square of a vector that may be all but gone. */
LEDPI_SIMD static void project(const Prediction *expected, const uint8_t *valid, double ridge, float *room,
                               float *restrict vectors) {
    const ptrdiff_t size = expected->cells * expected->points;
    double right[WAYS][VECTORS], gram[WAYS][WAYS];
    for (ptrdiff_t k = 0; k < WAYS; k++)
        for (int j = 0; j < VECTORS; j++) right[k][j] = dot(expected->basis + k * size, vectors + j * size, size); /* 0 where not valid */
    if (valid) {
        for (ptrdiff_t k = 0; k < WAYS; k++) {
            for (ptrdiff_t i = 0; i < size; i++) room[i] = valid[i] ? expected->basis[k * size + i] : 0.0f;
            for (ptrdiff_t j = 0; j < WAYS; j++) gram[k][j] = dot(room, expected->basis + j * size, size) + (j == k ? ridge : 0.0);
        }
        solve(gram, right);
    }
    for (ptrdiff_t k = 0; k < WAYS; k++)
        for (int j = 0; j < VECTORS; j++) {
            const float *own = expected->basis + k * size, share = (float)right[k][j];
            float *vector = vectors + j * size;
            for (ptrdiff_t i = 0; i < size; i++) vector[i] -= share * own[i];
        }
    for (ptrdiff_t i = 0; valid && i < size; i++)
        for (int j = 0; !valid[i] && j < VECTORS; j++) vectors[j * size + i] = 0.0f;
}

/* Log-likelihood ratio of the frame's light (cells, points), `valid` unless that is NULL, with the bands to without:
 * `of[0]` of all cells together, `of[1]` what cells that speak against them weigh. `room` is (VECTORS + 1, cells·points). */
LEDPI_SIMD void ledpi_weigh_prediction(ptrdiff_t cells, ptrdiff_t points, const float *picture, const float *root,
                               const float *basis, const float *residual_bands, const float *depth, const double *hz,
                               const double *phase, double since_s, double row_time_s, const float *light,
                               const uint8_t *valid, const float *rows, double independence, double ridge, float *room,
                               double *of) {
    const Prediction expected = {cells, points, picture, root, basis, residual_bands, depth, hz, phase, since_s, row_time_s};
    const ptrdiff_t size = cells * points;
    float *off = room, *bands = room + size, *change = room + 2 * size;
    compare(&expected, light, valid, rows, off, bands, change);
    project(&expected, valid, ridge, room + VECTORS * size, room);
    int32_t count = 0;
    for (ptrdiff_t i = 0; i < size; i++) count += off[i] != 0.0f;
    const double variance = dot(off, off, size) / (count - WAYS > 1 ? (double)(count - WAYS) : 1.0);
    const double scale = independence / (variance < 1e-12 ? 1e-12 : variance);
    of[0] = of[1] = 0.0;
    for (ptrdiff_t c = 0; c < cells; c++) {
        const float *own_off = off + c * points, *own_bands = bands + c * points, *own_change = change + c * points;
        const double dark = dot(own_off, own_bands, points) + 0.5 * dot(own_bands, own_bands, points);
        const double still = dot(own_off, own_change, points) + 0.5 * dot(own_change, own_change, points);
        const double own = scale * (dark < still ? dark : still);
        of[0] += own;
        of[1] -= own < 0.0 ? own : 0.0;
    }
}

/* Ways in which gain and corners may be wrong, weighted: `basis` (WAYS, samples). `room` (3·samples + 3·side·k). */
static void put_ways(const Panel *panel, const float *picture, const float *root, float *room, float *basis) {
    const ptrdiff_t k = panel->k, samples = panel->samples;
    float *across = room, *down = across + samples;
    ledpi_slopes(panel, picture, down + samples, across, down);
    for (ptrdiff_t cell = 0, i = 0; cell < panel->cells; cell++) {
        const float *us = panel->along + cell % panel->side * k, *vs = panel->along + cell / panel->side * k;
        for (ptrdiff_t y = 0; y < k; y++)
            for (ptrdiff_t x = 0; x < k; x++, i++) {
                const float u = 2.0f * us[x] - 1.0f, v = 2.0f * vs[y] - 1.0f;
                float ways[WAYS] = {root[i]};
                put_slopes(u, v, root[i] * across[i], root[i] * down[i], ways + 1);
                for (int way = 0; way < WAYS; way++) basis[way * samples + i] = ways[way];
            }
    }
}

/* Gram and Schmidt, each vector (size) twice, as single precision asks for. What the others explain all of becomes 0. */
LEDPI_SIMD static void make_orthonormal(float *vectors, ptrdiff_t size) {
    for (ptrdiff_t j = 0; j < WAYS; j++) {
        float *own = vectors + j * size;
        const double before = dot(own, own, size);
        for (int round = 0; round < 2; round++)
            for (const float *other = vectors; other < own; other += size) {
                const float share = (float)dot(own, other, size);
                for (ptrdiff_t i = 0; i < size; i++) own[i] -= share * other[i];
            }
        const double left = dot(own, own, size);
        const float scale = left > 1e-10 * before ? (float)(1.0 / sqrt(left)) : 0.0f;
        for (ptrdiff_t i = 0; i < size; i++) own[i] *= scale;
    }
}

/* What to expect of the next frames of a panel whose mean picture, above 0, is of `count` frames (cells, points), with what
 * is left of its waves in it (waves, cells, points), and that shows `bands` (cells, waves): `root`, `basis` and
 * `residual_bands` as above. `room` is (3·samples + 3·side·k). */
LEDPI_SIMD void ledpi_predict(ptrdiff_t side, ptrdiff_t k, ptrdiff_t waves, const float *picture, const float *count,
                                  const float *mean_waves, const float *along, const double *bands, float *root,
                                  float *basis, float *residual_bands, float *room) {
    const Panel panel = {side, k, waves, side * side, k * k, side * side * k * k, NULL, along};
    const ptrdiff_t samples = panel.samples, points = panel.points;
    for (ptrdiff_t i = 0; i < samples; i++) root[i] = picture[i] * (count[i] / (count[i] + 1.0f));
    const float per_weight = (float)((double)samples / ledpi_sum(root, samples));
    for (ptrdiff_t i = 0; i < samples; i++) root[i] = sqrtf(root[i] * per_weight);
    put_ways(&panel, picture, root, room, basis);
    make_orthonormal(basis, samples);
    for (ptrdiff_t i = 0; i < samples; i++) residual_bands[i] = 0.0f;
    for (ptrdiff_t wave = 0; wave < waves; wave++)
        for (ptrdiff_t c = 0; c < panel.cells; c++) {
            const float share = (float)bands[c * waves + wave], *own = mean_waves + wave * samples + c * points;
            for (ptrdiff_t p = 0; p < points; p++) residual_bands[c * points + p] += share * own[p];
        }
}
