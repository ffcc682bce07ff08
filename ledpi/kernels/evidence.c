/* What one picture says of the bands in a panel's cells: `single_evidence` in decode/single_frame.py, which says why. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cells.h"

enum { MEETING = 18 };


/* What lights up each point, as `Sources` in decode/shared_light.py has it; and which cells meet. */
typedef struct {
    ptrdiff_t count;
    const int64_t *column, *first; /* (count,) of MEETING; (points,) */
    const int64_t *met; /* (cells, MEETING), `cells` beyond the rim */
} Sources;

/* What a first look has shown, all NULL where there was none: what each cell's bands make of an even light (cells,
 * points), which cells are white, and what either class would make of it (2, cells, points). */
typedef struct {
    const float *shown, *of_class;
    const uint8_t *white;
} Believed;

static inline float share_of(const Panel *panel, const Believed *believed, ptrdiff_t i) {
    if (panel->valid && !panel->valid[i]) return 0.0f;
    return believed->shown ? believed->shown[i] : 1.0f;
}

/* Gains (cells,) and the profile (points,), each without the other. */
static void alternate(const Panel *panel, const Believed *believed, const float *light, double *gain, double *profile) {
    const ptrdiff_t points = panel->points;
    for (ptrdiff_t p = 0; p < points; p++) {
        double sum = 0.0, weight = 0.0;
        for (ptrdiff_t c = 0, i = p; c < panel->cells; c++, i += points) {
            sum += light[i];
            weight += gain[c] * share_of(panel, believed, i);
        }
        profile[p] = sum / fmax(weight, 1e-9);
    }
    for (ptrdiff_t c = 0; c < panel->cells; c++) {
        double sum = 0.0, weight = 0.0;
        for (ptrdiff_t p = 0, i = c * points; p < points; p++, i++) {
            sum += light[i];
            weight += profile[p] * share_of(panel, believed, i);
        }
        gain[c] = sum / fmax(weight, 1e-9);
    }
}

/* Gains, of mean 1, profile, and `light` filled in where it is not valid, in the gains' unit. */
static void levels(const Panel *panel, const Believed *believed, float *light, double *gain, double *profile) {
    const ptrdiff_t points = panel->points;
    double mean = 0.0, most = 0.0;
    for (ptrdiff_t c = 0; c < panel->cells; c++) {
        double sum = 0.0, weight = 0.0;
        for (ptrdiff_t p = 0, i = c * points; p < points; p++, i++) {
            sum += light[i];
            weight += share_of(panel, believed, i);
        }
        gain[c] = sum / weight;
    }
    if (!panel->valid && !believed->shown) {
        memset(profile, 0, sizeof(double) * (size_t)points);
        for (ptrdiff_t c = 0; c < panel->cells; c++)
            for (ptrdiff_t p = 0; p < points; p++) profile[p] += light[c * points + p] * (1.0 / gain[c] / (double)panel->cells);
    } else
        for (int round = 0; round < 3; round++) alternate(panel, believed, light, gain, profile);
    for (ptrdiff_t c = 0; c < panel->cells; c++) mean += gain[c] / (double)panel->cells;
    for (ptrdiff_t p = 0; p < points; p++) most = fmax(most, profile[p]);
    for (ptrdiff_t p = 0; panel->valid && p < points; p++) {
        bool seen = false;
        for (ptrdiff_t c = 0; c < panel->cells; c++) seen |= panel->valid[c * points + p];
        if (!seen) profile[p] = most;
    }
    for (ptrdiff_t c = 0, i = 0; c < panel->cells; c++) {
        for (ptrdiff_t p = 0; p < points; p++, i++) {
            if (panel->valid && !panel->valid[i])
                light[i] = (float)(gain[c] * profile[p] * (believed->shown ? believed->shown[i] : 1.0f));
            light[i] *= (float)(1.0 / mean);
        }
        gain[c] /= mean;
    }
}

/* At point p: an orthonormal basis (sources, cells) of what the cells may show there, whitened. Gram and Schmidt. */
static ptrdiff_t shared_at(const Panel *panel, const Sources *sources, const Believed *believed, const double *gain,
                           const float *root, ptrdiff_t p, float *basis) {
    const ptrdiff_t cells = panel->cells, from = sources->first[p];
    const ptrdiff_t count = (p + 1 < panel->points ? sources->first[p + 1] : sources->count) - from;
    for (ptrdiff_t s = 0; s < count; s++) {
        float *own = basis + s * cells, norm = 0.0f;
        for (ptrdiff_t c = 0, i = p; c < cells; c++, i += panel->points) {
            const int64_t neighbour = sources->met[c * MEETING + sources->column[from + s]];
            own[c] = neighbour < cells ? (float)gain[neighbour] / root[i] : 0.0f;
            if (believed->shown && neighbour < cells)
                own[c] *= believed->of_class[(believed->white[neighbour] ? panel->samples : 0) + i];
        }
        for (const float *other = basis; other < own; other += cells) {
            float along = 0.0f;
            for (ptrdiff_t c = 0; c < cells; c++) along += own[c] * other[c];
            for (ptrdiff_t c = 0; c < cells; c++) own[c] -= along * other[c];
        }
        for (ptrdiff_t c = 0; c < cells; c++) norm += own[c] * own[c];
        norm = 1.0f / fmaxf(sqrtf(norm), 1e-9f);
        for (ptrdiff_t c = 0; c < cells; c++) own[c] *= norm;
    }
    return count;
}

/* Splits the light into what the cells share and what is left: `still` (samples), at least 0.02, and its column. */
static void split(const Panel *panel, const Sources *sources, const float *light, const float *basis, float *still,
                  float *columns) {
    const ptrdiff_t cells = panel->cells, points = panel->points, width = width_of(panel);
    for (ptrdiff_t p = 0; p < points; p++) {
        const ptrdiff_t from = sources->first[p], to = p + 1 < points ? sources->first[p + 1] : sources->count;
        for (ptrdiff_t i = p; i < panel->samples; i += points) still[i] = 0.0f;
        for (ptrdiff_t s = from; s < to; s++) {
            const float *own = basis + s * cells;
            float along = 0.0f;
            for (ptrdiff_t c = 0, i = p; c < cells; c++, i += points) along += own[c] * light[i];
            for (ptrdiff_t c = 0, i = p; c < cells; c++, i += points) still[i] += along * own[c];
        }
        for (ptrdiff_t i = p; i < panel->samples; i += points) {
            columns[i * width + of_residual(panel)] = light[i] - still[i];
            still[i] = fmaxf(still[i], 0.02f);
        }
    }
}

/* Takes what the cells share at each point out of the matrix. `rows` (sources, padded size) is room to work in. */
static void take_shared(const Panel *panel, const Sources *sources, const float *basis, const float *columns, float *rows,
                        float *sums, double *matrix) {
    const ptrdiff_t cells = panel->cells, points = panel->points, waves = panel->waves, width = width_of(panel);
    const ptrdiff_t size = unknowns(panel, cells), wide = padded(size);
    memset(rows, 0, sizeof(float) * (size_t)(sources->count * wide));
    for (ptrdiff_t p = 0, s = 0; p < points; p++)
        for (; s < (p + 1 < points ? sources->first[p + 1] : sources->count); s++) {
            float *row = rows + s * wide;
            for (ptrdiff_t c = 0; c < cells; c++) {
                const float *own = columns + (c * points + p) * width, share = basis[s * cells + c];
                row[c] = share * own[0];
                for (ptrdiff_t i = 0; i < SLOPES; i++) row[cells + i] += share * own[1 + waves + i];
                for (ptrdiff_t i = 0; i < waves; i++) row[cells + SLOPES + c * waves + i] = share * own[1 + i];
            }
        }
    memset(sums, 0, sizeof(float) * (size_t)(wide * wide));
    ledpi_add_products(rows, sources->count, wide, sums);
    for (ptrdiff_t i = 0; i < size; i++)
        for (ptrdiff_t j = i; j < size; j++) matrix[i * (size + 1) + j] -= sums[i * wide + j];
}

/* Room to work in, and whether there is any. */
typedef struct {
    float *light, *root, *still, *logarithm, *columns, *basis, *rows, *sums;
    double *gain, *profile, *matrix;
} Room;

static bool make_room(const Panel *panel, const Sources *sources, Room *room) {
    const ptrdiff_t samples = panel->samples, size = unknowns(panel, panel->cells), wide = padded(size);
    const ptrdiff_t doubles = panel->cells + panel->points + size * (size + 1);
    const ptrdiff_t floats = samples * (4 + width_of(panel)) + sources->count * (panel->cells + wide) + wide * wide;
    room->gain = calloc(1, sizeof(double) * (size_t)doubles + sizeof(float) * (size_t)floats);
    if (!room->gain) return false;
    room->profile = room->gain + panel->cells;
    room->matrix = room->profile + panel->points;
    room->light = (float *)(room->matrix + size * (size + 1));
    room->root = room->light + samples;
    room->still = room->root + samples;
    room->logarithm = room->still + samples;
    room->columns = room->logarithm + samples;
    room->basis = room->columns + samples * width_of(panel);
    room->rows = room->basis + sources->count * panel->cells;
    room->sums = room->rows + sources->count * wide;
    return true;
}

/* Every column of every sample. */
static void put_columns(const Panel *panel, const Believed *believed, const float *waves, Room *room) {
    const ptrdiff_t width = width_of(panel);
    float *picture = room->light, *weight = room->still; /* neither is asked for again */
    for (ptrdiff_t i = 0; i < panel->samples; i++) {
        float *own = room->columns + i * width;
        const float valid = panel->valid && !panel->valid[i] ? 0.0f : 1.0f;
        const float bare = believed->shown ? room->still[i] / believed->shown[i] : room->still[i];
        own[0] = valid * room->still[i];
        own[of_residual(panel)] *= valid;
        picture[i] = bare * room->root[i];
        room->root[i] = valid * bare;
        weight[i] = own[0];
    }
    ledpi_put_waves(panel, waves, room->root, room->columns);
    ledpi_put_slopes(panel, picture, weight, room->logarithm, room->columns);
}

/* `score` (cells, waves), `information` (cells, waves, cells, waves) and how many samples are `free`; false where that
 * cannot be had. */
bool ledpi_single_evidence(ptrdiff_t side, ptrdiff_t k, ptrdiff_t count, const float *light, const uint8_t *valid,
                           const float *waves, const float *along, const float *shifts, ptrdiff_t source_count,
                           const int64_t *column, const int64_t *first, const int64_t *met, const float *shown,
                           const float *of_class, const uint8_t *white, double independence, double *score,
                           double *information, double *free_samples) {
    const Panel panel = {side, k, count, side * side, k * k, side * side * k * k, valid, along, shifts};
    const Sources sources = {source_count, column, first, met};
    const Believed believed = {shown, of_class, white};
    const ptrdiff_t size = unknowns(&panel, panel.cells);
    Room room;
    if (!make_room(&panel, &sources, &room)) return false;
    memcpy(room.light, light, sizeof(float) * (size_t)panel.samples);
    levels(&panel, &believed, room.light, room.gain, room.profile);
    ptrdiff_t used = 0;
    for (ptrdiff_t c = 0, i = 0; c < panel.cells; c++)
        for (ptrdiff_t p = 0; p < panel.points; p++, i++) {
            const float even = (float)(room.gain[c] * fmax(room.profile[p], 1e-3));
            room.root[i] = sqrtf(shown ? even * shown[i] : even);
            room.light[i] /= room.root[i]; /* shot noise has the variance of the light: now it is alike everywhere */
            used += !valid || valid[i];
        }
    float *basis = room.basis;
    for (ptrdiff_t p = 0; p < panel.points; p++)
        basis += panel.cells * shared_at(&panel, &sources, &believed, room.gain, room.root, p, basis);
    split(&panel, &sources, room.light, room.basis, room.still, room.columns);
    put_columns(&panel, &believed, waves, &room);
    const double squares = ledpi_add_cells(&panel, panel.cells, room.columns, room.matrix);
    take_shared(&panel, &sources, room.basis, room.columns, room.rows, room.sums, room.matrix);
    *free_samples = (double)(used - source_count + 1 - size);
    const bool fits = ledpi_weigh(room.matrix, size, panel.cells + SLOPES, squares, *free_samples, independence, score,
                                  information);
    free(room.gain);
    return fits;
}
