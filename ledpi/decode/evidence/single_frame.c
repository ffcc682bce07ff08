/* What one picture says of the bands in a panel's cells: decode/evidence/single_frame.py says why. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cells.h"
#include "core.h"
#include "simd.h"

enum { MEETING = 40, MET = 5 }; /* ways in which cells meet at a point, MET of them together */
/* Neighbours of the same gain light up a border as the cell itself would. Where they add less than this share to what it
 * shows, that is far below the noise. */
static const float ALIKE = 1e-3f;

/* Sum of a[i]·b[i], i < wide, which is a multiple of LEDPI_WIDTH. */
static inline float product(const float *a, const float *b, ptrdiff_t wide) {
    Floats sums = {0};
    for (ptrdiff_t i = 0; i < wide; i += LEDPI_WIDTH) sums += *(const Floats *)(a + i) * *(const Floats *)(b + i);
    return ledpi_total(sums);
}

/* What lights up each point, as `Sources` in decode/evidence/shared_light.py has it; and which cells meet. */
typedef struct {
    ptrdiff_t count;
    const int64_t *column, *first; /* (count,) of MEETING; (points,) */
    const int64_t *met; /* (cells, MEETING), `cells` where there is none */
} Sources;

/* The estimate of a first pass, all NULL if there is none: what each cell's bands make of an even light (cells,
 * points), which cells are white, and what either class would make of it (2, cells, points). */
typedef struct {
    const float *shown, *of_class;
    const uint8_t *white;
} BandEstimate;

static inline float share_of(const Panel *panel, const BandEstimate *estimate, ptrdiff_t i) {
    if (panel->valid && !panel->valid[i]) return 0.0f;
    return estimate->shown ? estimate->shown[i] : 1.0f;
}

/* Gains (cells,) and the profile (points,), each without the other. */
static void alternate(const Panel *panel, const BandEstimate *estimate, const float *light, double *gain, double *profile) {
    const ptrdiff_t points = panel->points;
    for (ptrdiff_t p = 0; p < points; p++) {
        double sum = 0.0, weight = 0.0;
        for (ptrdiff_t c = 0, i = p; c < panel->cells; c++, i += points) {
            sum += light[i];
            weight += gain[c] * share_of(panel, estimate, i);
        }
        profile[p] = sum / fmax(weight, 1e-9);
    }
    for (ptrdiff_t c = 0; c < panel->cells; c++) {
        double sum = 0.0, weight = 0.0;
        for (ptrdiff_t p = 0, i = c * points; p < points; p++, i++) {
            sum += light[i];
            weight += profile[p] * share_of(panel, estimate, i);
        }
        gain[c] = sum / fmax(weight, 1e-9);
    }
}

/* Gains, of mean 1, profile, and `light` filled in where it is not valid, in the gains' unit. */
LEDPI_SIMD static void levels(const Panel *panel, const BandEstimate *estimate, float *light, double *gain,
                              double *profile) {
    const ptrdiff_t points = panel->points;
    const bool plain = !panel->valid && !estimate->shown;
    double mean = 0.0, most = 0.0;
    for (ptrdiff_t c = 0; c < panel->cells; c++) {
        double weight = plain ? (double)points : 0.0;
        for (ptrdiff_t p = 0; !plain && p < points; p++) weight += share_of(panel, estimate, c * points + p);
        gain[c] = ledpi_sum(light + c * points, points) / weight;
    }
    if (plain) {
        memset(profile, 0, sizeof(double) * (size_t)points);
        for (ptrdiff_t c = 0; c < panel->cells; c++)
            for (ptrdiff_t p = 0; p < points; p++) profile[p] += light[c * points + p] * (1.0 / gain[c] / (double)panel->cells);
    } else
        for (int round = 0; round < 3; round++) alternate(panel, estimate, light, gain, profile);
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
                light[i] = (float)(gain[c] * profile[p] * (estimate->shown ? estimate->shown[i] : 1.0f));
            light[i] *= (float)(1.0 / mean);
        }
        gain[c] /= mean;
    }
}

/* Gram and Schmidt: `count` vectors (count, wide) made orthonormal, one after the other; 0 where one is all but the same
 * as those before it. */
LEDPI_SIMD static void make_orthonormal(float *vectors, ptrdiff_t count, ptrdiff_t wide) {
    for (ptrdiff_t s = 0; s < count; s++) {
        float *own = vectors + s * wide;
        const float whole = product(own, own, wide);
        for (const float *other = vectors; other < own; other += wide) {
            const float along = product(own, other, wide);
            for (ptrdiff_t c = 0; c < wide; c++) own[c] -= along * other[c];
        }
        const float left = product(own, own, wide);
        const float unit = left > ALIKE * ALIKE * whole ? 1.0f / sqrtf(fmaxf(left, 1e-18f)) : 0.0f;
        for (ptrdiff_t c = 0; c < wide; c++) own[c] *= unit;
    }
}

/* For each column of MEETING, what the cells may show at a point, whitened, by an orthonormal basis (MEETING, wide). The
 * same at all points of an even light: what else it is weighed by there is alike in all cells. */
static void put_even_basis(const Panel *panel, const Sources *sources, const double *gain, float *basis) {
    const ptrdiff_t wide = padded(panel->cells);
    for (ptrdiff_t column = 0; column < MEETING; column++)
        for (ptrdiff_t c = 0; c < panel->cells; c++) {
            const int64_t neighbour = sources->met[c * MEETING + column];
            basis[column * wide + c] = neighbour < panel->cells ? (float)(gain[neighbour] / sqrt(gain[c])) : 0.0f;
        }
    for (ptrdiff_t meeting = 0; meeting < MEETING; meeting += MET) make_orthonormal(basis + meeting * wide, MET, wide);
}

/* The same for `count` sources at point p from the one numbered `from`, where the cells' bands are known. */
static void put_basis_at(const Panel *panel, const Sources *sources, const BandEstimate *estimate, const double *gain,
                         const float *root, ptrdiff_t p, ptrdiff_t from, ptrdiff_t count, float *basis) {
    const ptrdiff_t wide = padded(panel->cells);
    for (ptrdiff_t s = 0; s < count; s++)
        for (ptrdiff_t c = 0, i = p; c < panel->cells; c++, i += panel->points) {
            const int64_t neighbour = sources->met[c * MEETING + sources->column[from + s]];
            if (neighbour >= panel->cells) continue;
            const float blinking = estimate->of_class[(estimate->white[neighbour] ? panel->samples : 0) + i];
            basis[s * wide + c] = (float)gain[neighbour] / root[i] * blinking;
        }
    make_orthonormal(basis, count, wide);
}

/* An orthonormal basis of what the cells may show at the point of each source: `bases` (sources). */
static void put_bases(const Panel *panel, const Sources *sources, const BandEstimate *estimate, const double *gain,
                      const float *root, float *room, const float **bases) {
    const ptrdiff_t wide = padded(panel->cells);
    if (!estimate->shown) put_even_basis(panel, sources, gain, room);
    for (ptrdiff_t p = 0, s = 0; p < panel->points; p++) {
        const ptrdiff_t to = p + 1 < panel->points ? sources->first[p + 1] : sources->count;
        if (estimate->shown) put_basis_at(panel, sources, estimate, gain, root, p, s, to - s, room + s * wide);
        for (; s < to; s++) bases[s] = room + wide * (estimate->shown ? s : sources->column[s]);
    }
}

/* Splits the light into what the cells share, `still`, at least 0.02, and what is left, `residual`: (samples) both. */
LEDPI_SIMD static void split(const Panel *panel, const Sources *sources, const float *light, const float **bases,
                             float *room, float *still, float *residual) {
    const ptrdiff_t cells = panel->cells, points = panel->points, wide = padded(cells);
    float *seen = room, *shared = room + wide; /* at one point, of all cells */
    for (ptrdiff_t p = 0, s = 0; p < points; p++) {
        for (ptrdiff_t c = 0; c < cells; c++) seen[c] = light[c * points + p];
        for (ptrdiff_t c = 0; c < wide; c++) shared[c] = 0.0f;
        for (; s < (p + 1 < points ? sources->first[p + 1] : sources->count); s++) {
            const float along = product(bases[s], seen, wide);
            for (ptrdiff_t c = 0; c < wide; c++) shared[c] += along * bases[s][c];
        }
        for (ptrdiff_t c = 0, i = p; c < cells; c++, i += points) {
            residual[i] = seen[c] - shared[c];
            still[i] = shared[c] > 0.02f ? shared[c] : 0.02f;
        }
    }
}

/* What a source takes from the matrix is the square of this row of its unknowns. */
static inline void put_row(const Panel *panel, const float *basis, const float *columns, ptrdiff_t waves, float *row) {
    const ptrdiff_t cells = panel->cells, apart = panel->points * width_of(panel);
    enum { PARTS = SLOPES / LEDPI_WIDTH };
    Floats slopes[PARTS] = {{0}};
    for (ptrdiff_t c = 0; c < cells; c++, columns += apart) {
        row[c] = basis[c] * columns[0];
        for (int k = 0; k < PARTS; k++) slopes[k] += basis[c] * *(const Floats *)(columns + 1 + waves + k * LEDPI_WIDTH);
        for (ptrdiff_t i = 0; i < waves; i++) row[cells + SLOPES + c * waves + i] = basis[c] * columns[1 + i];
    }
    for (int k = 0; k < PARTS; k++) *(Floats *)(row + cells + k * LEDPI_WIDTH) = slopes[k];
}

/* Takes what the cells share at each point out of the matrix. `rows` (LEDPI_AT_ONCE, padded size) is room to work in. */
LEDPI_SIMD static void take_shared(const Panel *panel, const Sources *sources, const float **bases, const float *columns,
                                   float *rows, float *sums, double *matrix) {
    const ptrdiff_t points = panel->points, waves = panel->waves, width = width_of(panel);
    const ptrdiff_t size = unknowns(panel), wide = padded(size);
    ptrdiff_t count = 0;
    for (ptrdiff_t p = 0, s = 0; p < points; p++)
        for (; s < (p + 1 < points ? sources->first[p + 1] : sources->count); s++) {
            float *row = rows + count * wide;
            put_row(panel, bases[s], columns + p * width, waves, row);
            for (ptrdiff_t i = size; i < wide; i++) row[i] = 0.0f;
            if (++count < LEDPI_AT_ONCE) continue;
            ledpi_add_products(rows, count, wide, sums);
            count = 0;
        }
    ledpi_add_products(rows, count, wide, sums);
    for (ptrdiff_t i = 0; i < size; i++)
        for (ptrdiff_t j = i; j < size; j++) matrix[i * (size + 1) + j] -= sums[i * wide + j];
}

/* Room to work in. */
typedef struct {
    double *gain, *profile, *matrix;
    float *light, *root, *still, *residual, *across, *down, *columns, *basis, *rows, *sums, *slopes;
    const float **bases;
} Room;

/* Takes it, or none; `gain` is where it begins. What is added to is zero, and what pads the cells. */
static bool make_room(const Panel *panel, const Sources *sources, Room *room) {
    const ptrdiff_t samples = panel->samples, size = unknowns(panel), wide = padded(size);
    const ptrdiff_t vectors = (MEETING + sources->count) * padded(panel->cells); /* of cells; two serve `split` */
    const ptrdiff_t matrix = size * (size + 1), levels = panel->cells + panel->points;
    const ptrdiff_t slopes = samples + 3 * panel->side * panel->k;
    const ptrdiff_t floats = wide * wide + vectors + samples * (6 + width_of(panel)) + slopes + LEDPI_AT_ONCE * wide;
    char *all = malloc(sizeof(double) * (size_t)(matrix + levels) + sizeof(float) * (size_t)floats +
                       sizeof(float *) * (size_t)sources->count);
    if (!all) return false;
    room->matrix = (double *)all;
    room->gain = room->matrix + matrix;
    room->profile = room->gain + panel->cells;
    room->bases = (const float **)(room->profile + panel->points);
    room->sums = (float *)(room->bases + sources->count);
    room->basis = room->sums + wide * wide;
    room->columns = room->basis + vectors;
    room->light = room->columns + samples * width_of(panel);
    room->root = room->light + samples;
    room->still = room->root + samples;
    room->residual = room->still + samples;
    room->across = room->residual + samples;
    room->down = room->across + samples;
    room->slopes = room->down + samples;
    room->rows = room->slopes + slopes;
    memset(room->matrix, 0, sizeof(double) * (size_t)matrix);
    memset(room->sums, 0, sizeof(float) * (size_t)(wide * wide + vectors));
    return true;
}

/* What each sample is explained by. What is not valid is left out; `still` becomes the weight, `root` what bands add. */
LEDPI_SIMD static void put_terms(const Panel *panel, const BandEstimate *estimate, Room *room) {
    float *picture = room->light; /* which is not asked for again */
    for (ptrdiff_t i = 0; i < panel->samples; i++) {
        const float bare = estimate->shown ? room->still[i] / estimate->shown[i] : room->still[i];
        picture[i] = bare * room->root[i];
        room->root[i] = bare;
    }
    for (ptrdiff_t i = 0; panel->valid && i < panel->samples; i++)
        if (!panel->valid[i]) room->root[i] = room->still[i] = room->residual[i] = 0.0f;
    ledpi_slopes(panel, picture, room->slopes, room->across, room->down);
}

/* The light over the root of its variance, so that it is alike everywhere. Returns how many samples are valid. */
LEDPI_SIMD static ptrdiff_t whiten(const Panel *panel, const BandEstimate *estimate, Room *room) {
    ptrdiff_t used = 0;
    for (ptrdiff_t p = 0; p < panel->points; p++) room->profile[p] = sqrt(fmax(room->profile[p], 1e-3));
    for (ptrdiff_t c = 0; c < panel->cells; c++) {
        const ptrdiff_t from = c * panel->points;
        const double of_cell = sqrt(room->gain[c]);
        for (ptrdiff_t p = 0; p < panel->points; p++) room->root[from + p] = (float)(of_cell * room->profile[p]);
    }
    for (ptrdiff_t i = 0; estimate->shown && i < panel->samples; i++) room->root[i] *= sqrtf(estimate->shown[i]);
    for (ptrdiff_t i = 0; i < panel->samples; i++) room->light[i] /= room->root[i];
    for (ptrdiff_t i = 0; i < panel->samples; i++) used += !panel->valid || panel->valid[i];
    return used;
}

/* `score` (cells, waves), `information` (cells, waves, cells, waves), and how many samples are `free`. False where that cannot be
 * had. */
bool ledpi_single_evidence(ptrdiff_t side, ptrdiff_t k, ptrdiff_t count, const float *light, const uint8_t *valid,
                           const float *waves, const float *along, ptrdiff_t source_count, const int64_t *column,
                           const int64_t *first, const int64_t *met, const float *shown, const float *of_class,
                           const uint8_t *white, double independence, double *score, double *information, double *free_samples) {
    const Panel panel = {side, k, count, side * side, k * k, side * side * k * k, valid, along};
    const Sources sources = {source_count, column, first, met};
    const BandEstimate estimate = {shown, of_class, white};
    const ptrdiff_t size = unknowns(&panel);
    Room room;
    if (!make_room(&panel, &sources, &room)) return false;
    memcpy(room.light, light, sizeof(float) * (size_t)panel.samples);
    levels(&panel, &estimate, room.light, room.gain, room.profile);
    const ptrdiff_t used = whiten(&panel, &estimate, &room);
    put_bases(&panel, &sources, &estimate, room.gain, room.root, room.basis, room.bases);
    float *vectors = room.basis + (estimate.shown ? sources.count : MEETING) * padded(panel.cells);
    split(&panel, &sources, room.light, room.bases, vectors, room.still, room.residual);
    put_terms(&panel, &estimate, &room);
    const Terms terms = {room.still, room.root, waves, room.across, room.down, room.residual};
    const double squares = ledpi_add_cells(&panel, &terms, room.columns, room.matrix);
    take_shared(&panel, &sources, room.bases, room.columns, room.rows, room.sums, room.matrix);
    *free_samples = (double)(used - source_count + 1 - size);
    const bool fits = ledpi_weigh(room.matrix, size, panel.cells + SLOPES, squares, *free_samples, independence, score,
                                  information);
    free(room.matrix);
    return fits;
}
