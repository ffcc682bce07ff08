/* The grid that moves with a panel's corners, and what is summed up over its samples, block by block. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "panel_fit.h"
#include "simd.h"

#define MOST_SIGHT 6.0 /* steps aside for one inwards: from 80° aside */
static const double MOST_BLUR_CELLS = 1.0;
/* Student's t: blocks of this freedom are weighed by (freedom + 1)/(freedom + their mean square over the usual one). */
#define FREEDOM 4.0

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Slant, across and down, of a line of sight to the panel's middle, for each step inwards. */
static void put_sight(const View *view, const double h[9], double sight[2]) {
    double to[3][3]; /* across, down, and to the middle, in the camera's frame */
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 2; i++) /* with a lens these are rays */
            to[k][i] = view->lens ? h[3 * i + k] : (h[3 * i + k] - view->centre[i] * h[6 + k]) / view->focal[i];
        to[k][2] = h[6 + k];
    }
    for (int i = 0; i < 3; i++) to[2][i] += 0.5 * (to[0][i] + to[1][i]);
    const double *a = to[0], *b = to[1];
    const double normal[] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    const double inwards = fmax(fabs(dot(normal, to[2])), 1e-12) / sqrt(dot(normal, normal));
    for (int k = 0; k < 2; k++)
        sight[k] = fmin(fmax(dot(to[k], to[2]) / sqrt(dot(to[k], to[k])) / inwards, -MOST_SIGHT), MOST_SIGHT);
}

/* A small step from ray (x, y), as it is seen. */
static void put_in_pixels(const Lens *lens, double x, double y, double *right, double *down) {
    double seen[2], by[2][2];
    const double step[2] = {*right, *down};
    ledpi_distort(lens, x, y, seen, by);
    *right = by[0][0] * step[0] + by[0][1] * step[1], *down = by[1][0] * step[0] + by[1][1] * step[1];
}

/* Lines of the grid in both directions. The picture's blur is the same all over: in cells it is as broad as these are
 * narrow, across their own lines, half way along each. */
static void put_lines(const Fitting *fit, const double h[9], Work *work) {
    const double n = (double)fit->panel.cells;
    for (int axis = 0; axis < 2; axis++) {
        const double *unknown = fit->unknown, *rim = unknown + RIM + 2 * axis;
        const Walls walls = {unknown[GAP], {rim[0], rim[1]}, unknown[DEPTH], unknown[GLOW], fit->panel.sight[axis]};
        for (ptrdiff_t i = 0; i < fit->lines; i++) {
            const double u = axis ? 0.5 : fit->along[i] / n, v = axis ? fit->along[i] / n : 0.5;
            const double w = 1.0 / (h[6] * u + h[7] * v + h[8]);
            const double x = (h[0] * u + h[1] * v + h[2]) * w, y = (h[3] * u + h[4] * v + h[5]) * w;
            double xu = (h[0] - x * h[6]) * w, xv = (h[1] - x * h[7]) * w;
            double yu = (h[3] - y * h[6]) * w, yv = (h[4] - y * h[7]) * w;
            if (fit->view.lens) {
                put_in_pixels(fit->view.lens, x, y, &xu, &yu);
                put_in_pixels(fit->view.lens, x, y, &xv, &yv);
            }
            const double area = fmax(fabs(xu * yv - xv * yu), 1e-12);
            const double *const along = axis ? (double[]){xu, yu} : (double[]){xv, yv}; /* the line, which goes across the other axis */
            const double a_pixel = n / area, spread[2] = {exp(unknown[BLUR] + unknown[SMEAR]), exp(unknown[BLUR] - unknown[SMEAR])};
            const double of_rows = a_pixel * along[1] * spread[0], of_columns = a_pixel * along[0] * spread[1];
            const double sigma = ledpi_length(of_rows, of_columns);
            const Blur blur = {fmin(fmax(fit->view.shrink * sigma, 1e-3), MOST_BLUR_CELLS),
                               (of_rows * of_rows - of_columns * of_columns) / fmax(sigma * sigma, 1e-12)};
            work->grid[axis][i] = ledpi_panel_line(fit->along[i], fit->panel.cells, blur, &walls);
        }
    }
    for (ptrdiff_t i = 0; i < fit->lines; i += LEDPI_WIDTH)
        ledpi_panel_lines(work->grid[0] + i, fit->along + i, fit->lines - i, fit->panel.cells, work->across + i / LEDPI_WIDTH);
    for (int k = 0; k < 9; k++) work->numbers[k] = (float)h[k];
}

void ledpi_panel_put_grid(Fitting *fit, const double h[9], Work *work) {
    put_sight(&fit->view, h, fit->panel.sight);
    put_lines(fit, h, work);
}

/* The block that a place, in cells, is weighed with: a part of a cell, or what is beside one. */
static ptrdiff_t block_at(double across, double down, ptrdiff_t cells) {
    const double n = (double)cells;
    if (across >= 0.0 && across < n && down >= 0.0 && down < n)
        return (ptrdiff_t)(down * BLOCKS) * cells * BLOCKS + (ptrdiff_t)(across * BLOCKS);
    const ptrdiff_t beside = cells * cells * BLOCKS * BLOCKS;
    const ptrdiff_t i = (ptrdiff_t)fmin(fmax(across, 0.0), n - 1.0), j = (ptrdiff_t)fmin(fmax(down, 0.0), n - 1.0);
    if (across < 0.0 || across >= n) return beside + (across < 0.0 ? 0 : cells) + j;
    return beside + 2 * cells + (down < 0.0 ? 0 : cells) + i;
}

void ledpi_panel_put_blocks(const Fitting *fit, Work *work) {
    for (ptrdiff_t j = 0; j < fit->lines; j++)
        for (ptrdiff_t i = 0; i < fit->lines; i++)
            work->block[j][i] = (int16_t)block_at(fit->along[i], fit->along[j], fit->panel.cells);
}

static LEDPI_INLINE void add_own(Products *products, ptrdiff_t own, const Owned *met, int count, float root, const float *columns) {
    for (int i = 0; i < count; i++)
        for (ptrdiff_t k = 0; k < own; k++) {
            const ptrdiff_t row = met[i].cell * own + k;
            const float by = root * met[i].by[k];
            for (int column = 0; column < DENSE; column += LEDPI_WIDTH)
                *(Floats *)(products->mixed[row] + column) += by * *(const Floats *)(columns + column);
            for (int j = i; j < count; j++) products->own[row][met[j].cell] += by * root * met[j].by; /* on and above the diagonal */
        }
}

/* Samples for `ledpi_panel_phases`: of one cell's light the part that its own unknowns explain. */
static void add_row(const Fitting *fit, const Owned *met, float row_px, float residual, ptrdiff_t rows, Work *work) {
    const ptrdiff_t row = (ptrdiff_t)((row_px - fit->view.first_y) / fit->view.shrink + 0.5);
    if (row < 0 || row >= rows) return;
    const double *own = fit->unknown + COMMON + OWN * met->cell;
    double seen = residual;
    for (int k = 0; k < OWN; k++) seen += own[k] * met->by[k];
    work->by_row[0][met->cell * rows + row] += met->by[0] * met->by[0];
    work->by_row[1][met->cell * rows + row] += (float)(met->by[0] * seen);
}

static void clear(const Fitting *fit, Work *work) {
    const size_t owns = (size_t)fit->owns, cells = (size_t)(fit->panel.cells * fit->panel.cells);
    memset(work->products.common, 0, sizeof work->products.common);
    memset(work->products.mixed, 0, owns * sizeof *work->products.mixed);
    for (size_t k = 0; k < owns; k++) memset(work->products.own[k], 0, cells * sizeof *work->products.own[k]);
    memset(work->squares, 0, sizeof work->squares);
    memset(work->sum, 0, sizeof work->sum);
    memset(work->count, 0, sizeof work->count);
    work->left = work->inside = work->used = work->light = work->light2 = 0.0, work->samples = 0;
}

/* Adds eight samples; those that tell nothing have columns of zeros. `blocks` are theirs. */
static LEDPI_INLINE void add_samples(const Fitting *fit, const Samples *s, ptrdiff_t first, ptrdiff_t down, bool phasing,
                                     const int16_t *blocks, float *columns, Work *work) {
    const ptrdiff_t cells = fit->panel.cells, lanes = fit->lines - first < LEDPI_WIDTH ? fit->lines - first : LEDPI_WIDTH;
    Floats root = {0};
    Ints valid = {0};
    for (int lane = 0; lane < lanes; lane++) {
        if (!s->valid[lane]) continue;
        const double left = s->by[RESIDUAL][lane], trust = work->weight[blocks[lane]], weight = trust * s->weight[lane] * s->weight[lane];
        work->squares[blocks[lane]] += left * left, work->sum[blocks[lane]] += left, work->count[blocks[lane]] += 1.0;
        work->used += weight, work->sampled++;
        if (s->outside[lane] < 0.5f) work->left += trust * left * left, work->inside += weight, work->samples++;
        work->light += weight * s->seen[lane], work->light2 += weight * s->seen[lane] * s->seen[lane];
        root[lane] = trust < 1.0 ? sqrtf((float)trust) : 1.0f, valid[lane] = -1;
    }
    for (int from = 0; from < DENSE && !phasing; from += LEDPI_WIDTH) {
        Floats part[LEDPI_WIDTH];
        for (int k = 0; k < LEDPI_WIDTH; k++) part[k] = (Floats)((Ints)(root * s->by[from + k]) & valid); /* it may be no number elsewhere */
        ledpi_transpose(part);
        for (int lane = 0; lane < LEDPI_WIDTH; lane++) *(Floats *)(columns + lane * DENSE + from) = part[lane];
    }
    Owns owns;
    ledpi_panel_put_owns(s, &owns);
    for (int lane = 0; lane < lanes; lane++) {
        Owned met[4];
        if (!s->valid[lane]) continue;
        const int cells_met = ledpi_panel_met(&owns, lane, work->across + first / LEDPI_WIDTH, &work->grid[1][down], cells, met);
        if (!phasing)
            add_own(&work->products, fit->own, met, cells_met, root[lane], columns + lane * DENSE);
        else if (cells_met == 1)
            add_row(fit, met, s->row[lane], s->by[RESIDUAL][lane], ledpi_panel_rows(fit), work);
    }
}

LEDPI_SIMD void ledpi_panel_sum_up(const Fitting *fit, bool phasing, Work *work) {
    const ptrdiff_t cells = fit->panel.cells;
    clear(fit, work);
    for (ptrdiff_t i = 0; i < COMMON + OWN * cells * cells; i++) work->unknown[i] = (float)fit->unknown[i];
    if (phasing)
        for (int k = 0; k < 2; k++) memset(work->by_row[k], 0, (size_t)(cells * cells * ledpi_panel_rows(fit)) * sizeof(float));
    ptrdiff_t count = 0; /* columns that wait */
    for (ptrdiff_t j = 0; j < fit->lines; j++) {
        const Profile profile = ledpi_panel_profile(work->unknown, &work->grid[1][j]);
        for (ptrdiff_t i = 0; i < fit->lines; i += LEDPI_WIDTH, count += LEDPI_WIDTH) {
            Samples s;
            ledpi_panel_sample_at(fit, work, &profile, i, j, &s);
            add_samples(fit, &s, i, j, phasing, work->block[j] + i, work->columns + count * DENSE, work);
        }
        if (count < LEDPI_AT_ONCE && j + 1 < fit->lines) continue;
        if (!phasing) ledpi_add_products(work->columns, count, DENSE, work->products.common);
        count = 0;
    }
}

void ledpi_panel_weigh_blocks(ptrdiff_t cells, Work *work) {
    const ptrdiff_t inside = cells * cells * BLOCKS * BLOCKS, blocks = inside + 4 * cells;
    double sorted[MOST_BLOCKS];
    ptrdiff_t count = 0;
    for (ptrdiff_t b = 0; b < inside; b++)
        if (work->count[b] > 0.0) sorted[count++] = work->squares[b] / work->count[b];
    if (!count) return;
    qsort(sorted, (size_t)count, sizeof *sorted, ledpi_ascending);
    const double usual = fmax(sorted[count / 2], 1e-9);
    for (ptrdiff_t b = 0; b < blocks; b++) {
        const double mean = work->count[b] > 0.0 ? work->squares[b] / work->count[b] : usual;
        work->weight[b] = fmin(1.0, (FREEDOM + 1.0) / (FREEDOM + mean / usual));
    }
}
