/* A panel's picture fitted to light by Gauss and Newton: corners, profile, phases and each cell's own, all at once. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "normal.h"
#include "panel.h"
#include "simd.h"

enum {
    BLOCKS = 3, /* that are weighed together, along a cell */
    MOST_BLOCKS = MOST_CELLS * MOST_CELLS * BLOCKS * BLOCKS + 4 * MOST_CELLS,
};
#define MOST_STEP 0.1 /* of half the side: as far as the slopes hold */
#define MOST_BLURRING 0.3 /* of the blur's logarithm */
#define MOST_TURN 0.1 /* cycles of a phase: as far as its wave's slope holds */
#define SETTLED_SHARE 0.1 /* of the squared residuals: so well is the noise known, and no better, as samples move with the corners */
#define WEIGHED_SHARE 0.5 /* and while more of them than this will go, what does not fit is not told from what is not fitted yet */
/* Student's t: blocks of this freedom are weighed by (freedom + 1)/(freedom + their mean square over the usual one). */
#define FREEDOM 4.0
#define LEAST_GAIN 0.02
#define HELD 1e12 /* one over the variance of what cannot move */
#define SHALLOW 0.25 /* of the squares that bands should explain */
#define NATS_NEEDED 11.3
#define MOST_SIGHT 6.0 /* steps aside for one inwards: from 80° aside */
static const double MOST_BLUR_CELLS = 1.0;
/* Unknowns stay where the equation means something: the blur within 0.4 … 2 px, other lengths in cells. */
static const struct {
    ptrdiff_t at, count;
    double least, most;
} LIMITS[] = {{BLUR, 1, -0.92, 0.69}, {GAP, 1, 0.0, 0.25}, {RIM, 4, -0.5, 0.5}, {DEPTH, 1, 0.0, 0.2}, {GLOW, 1, 0.0, 1.0}, {SMEAR, 1, -0.9, 0.9}};
/* In cells: further within than another side's, light ends at what hides the rest; two deviations of RIM_SIGMA of prior.py. */
static const double HIDDEN = 0.06;

/* A fit under way. */
typedef struct {
    View view;
    Panel panel;
    Point corners[4], lit[4];
    const PanelFit *asked;
    const double *along, *prior;
    ptrdiff_t lines, reweightings, own, owns, size; /* unknowns of a cell that are sought, of all cells, in all */
    double *unknown, *covariance, explained, variance, sought[2]; /* phases, as the grid has them */
} Fitting;

/* Sums of products of the columns; of COMMON, of each cell's OWN with COMMON, and of these among each other. */
typedef struct {
    float common[DENSE * DENSE], mixed[MOST_OWN][DENSE], own[MOST_OWN * MOST_OWN];
} Products;

typedef struct {
    Line grid[2][LEDPI_MOST_LINES];
    Lines across[LEDPI_MOST_LINES / LEDPI_WIDTH];
    float numbers[9], unknown[MOST_UNKNOWN]; /* of the homography; as they are before this round */
    float columns[2 * LEDPI_MOST_LINES * DENSE];
    Products products;
    double matrix[MOST_UNKNOWN * (MOST_UNKNOWN + 1)], step[MOST_UNKNOWN];
    float by_row[2][MOST_CELLS * MOST_CELLS * MOST_ROWS];
    double weight[MOST_BLOCKS], squares[MOST_BLOCKS], sum[MOST_BLOCKS], count[MOST_BLOCKS];
    double left, inside, used, light, light2; /* sums, weighed: of squared residuals, of weights, of light and its square */
    double decrease; /* of the squared residuals, that the step should bring: a share of them */
    ptrdiff_t samples, sampled; /* of this round, of all */
} Work;

ptrdiff_t ledpi_panel_room(void) { return (ptrdiff_t)sizeof(Work); }

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* How far aside, across and down, a line of sight to the panel's middle goes for each step inwards. */
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

/* Lines of the grid in both directions. The picture's blur is the same all over: in cells it is as broad as these are
 * narrow, across their own lines, half way along each. */
static void put_lines(const Fitting *fit, const double h[9], Work *work) {
    const double n = (double)fit->panel.cells, per_ray = fit->view.lens ? fit->view.lens->fx : 1.0;
    for (int axis = 0; axis < 2; axis++) {
        const double *unknown = fit->unknown, *rim = unknown + RIM + 2 * axis;
        const Walls walls = {unknown[GAP], {rim[0], rim[1]}, unknown[DEPTH], unknown[GLOW], fit->panel.sight[axis]};
        for (ptrdiff_t i = 0; i < fit->lines; i++) {
            const double u = axis ? 0.5 : fit->along[i] / n, v = axis ? fit->along[i] / n : 0.5;
            const double w = 1.0 / (h[6] * u + h[7] * v + h[8]);
            const double x = (h[0] * u + h[1] * v + h[2]) * w, y = (h[3] * u + h[4] * v + h[5]) * w;
            const double xu = (h[0] - x * h[6]) * w, xv = (h[1] - x * h[7]) * w;
            const double yu = (h[3] - y * h[6]) * w, yv = (h[4] - y * h[7]) * w;
            const double area = fmax(fabs(xu * yv - xv * yu) * per_ray, 1e-12);
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

/* The block that a place, in cells, is weighed with: a part of a cell, or what is beside one. */
static ptrdiff_t block_of(double across, double down, ptrdiff_t cells) {
    const double n = (double)cells;
    if (across >= 0.0 && across < n && down >= 0.0 && down < n)
        return (ptrdiff_t)(down * BLOCKS) * cells * BLOCKS + (ptrdiff_t)(across * BLOCKS);
    const ptrdiff_t beside = cells * cells * BLOCKS * BLOCKS;
    const ptrdiff_t i = (ptrdiff_t)fmin(fmax(across, 0.0), n - 1.0), j = (ptrdiff_t)fmin(fmax(down, 0.0), n - 1.0);
    if (across < 0.0 || across >= n) return beside + (across < 0.0 ? 0 : cells) + j;
    return beside + 2 * cells + (down < 0.0 ? 0 : cells) + i;
}

/* A cell that a sample shows, and the sample's slopes by its OWN. */
typedef struct {
    ptrdiff_t cell;
    float by[OWN];
} Met;

/* The cells that meet at a sample. Returns how many. */
static LEDPI_INLINE int met_at(const Samples *s, int lane, const Lines *across, const Line *down, ptrdiff_t cells, Met met[4]) {
    int count = 0;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            if (!(across->light[i][lane] * down->light[j] > NO_LIGHT)) continue;
            met[count].cell = down->cell[j] * cells + across->cell[i][lane];
            for (int k = 0; k < OWN; k++) met[count].by[k] = s->weight[lane] * s->own[j][i][k][lane];
            count++;
        }
    return count;
}

static LEDPI_INLINE void add_own(Products *products, ptrdiff_t own, ptrdiff_t owns, const Met *met, int count, float root,
                                 const float *columns) {
    for (int i = 0; i < count; i++)
        for (ptrdiff_t k = 0; k < own; k++) {
            const ptrdiff_t row = met[i].cell * own + k;
            const float by = root * met[i].by[k];
            for (int column = 0; column < DENSE; column += LEDPI_WIDTH)
                *(Eight *)(products->mixed[row] + column) += by * *(const Eight *)(columns + column);
            for (int j = 0; j < count; j++)
                for (ptrdiff_t n = 0; n < own; n++) products->own[row * owns + met[j].cell * own + n] += by * root * met[j].by[n];
        }
}

/* What `ledpi_panel_phases` asks for: of one cell's light the part that its own unknowns explain. */
static void add_row(const Fitting *fit, const Met *met, float row_px, float residual, ptrdiff_t rows, Work *work) {
    const ptrdiff_t row = (ptrdiff_t)((row_px - fit->view.first_y) / fit->view.shrink + 0.5);
    if (row < 0 || row >= rows) return;
    const double *own = fit->unknown + COMMON + OWN * met->cell;
    double seen = residual;
    for (int k = 0; k < OWN; k++) seen += own[k] * met->by[k];
    work->by_row[0][met->cell * rows + row] += met->by[0] * met->by[0];
    work->by_row[1][met->cell * rows + row] += (float)(met->by[0] * seen);
}

static ptrdiff_t rows_of(const Fitting *fit) { return fit->view.rows < MOST_ROWS ? fit->view.rows : MOST_ROWS; }

static void clear(const Fitting *fit, Work *work) {
    const size_t owns = (size_t)fit->owns;
    memset(work->products.common, 0, sizeof work->products.common);
    memset(work->products.mixed, 0, owns * sizeof *work->products.mixed);
    memset(work->products.own, 0, owns * owns * sizeof *work->products.own);
    memset(work->squares, 0, sizeof work->squares);
    memset(work->sum, 0, sizeof work->sum);
    memset(work->count, 0, sizeof work->count);
    work->left = work->inside = work->used = work->light = work->light2 = 0.0, work->samples = 0;
}

/* Adds eight samples, those that tell something. Returns how many columns there are then. */
static LEDPI_INLINE ptrdiff_t add_samples(const Fitting *fit, const Samples *s, ptrdiff_t first, ptrdiff_t down, bool phasing,
                                          ptrdiff_t count, Work *work) {
    const ptrdiff_t cells = fit->panel.cells, lanes = fit->lines - first < LEDPI_WIDTH ? fit->lines - first : LEDPI_WIDTH;
    for (int lane = 0; lane < lanes; lane++) {
        if (!s->tells[lane]) continue;
        const ptrdiff_t block = block_of(fit->along[first + lane], fit->along[down], cells);
        const double left = s->by[RESIDUAL][lane], trust = work->weight[block], weight = trust * s->weight[lane] * s->weight[lane];
        work->squares[block] += left * left, work->sum[block] += left, work->count[block] += 1.0;
        work->used += weight;
        if (s->outside[lane] < 0.5f) work->left += trust * left * left, work->inside += weight, work->samples++;
        work->light += weight * s->seen[lane], work->light2 += weight * s->seen[lane] * s->seen[lane];
        Met met[4];
        const int cells_met = met_at(s, lane, work->across + first / LEDPI_WIDTH, &work->grid[1][down], cells, met);
        float *const columns = work->columns + count++ * DENSE;
        if (phasing) {
            if (cells_met == 1) add_row(fit, met, s->row[lane], s->by[RESIDUAL][lane], rows_of(fit), work);
            continue;
        }
        const float root = trust < 1.0 ? (float)sqrt(trust) : 1.0f;
        for (int k = 0; k < DENSE; k++) columns[k] = root * s->by[k][lane];
        add_own(&work->products, fit->own, fit->owns, met, cells_met, root, columns);
    }
    return count;
}

/* Sums over the grid; by rows where `phasing`. */
LEDPI_SIMD static void sum_up(const Fitting *fit, bool phasing, Work *work) {
    const ptrdiff_t cells = fit->panel.cells;
    clear(fit, work);
    for (ptrdiff_t i = 0; i < COMMON + OWN * cells * cells; i++) work->unknown[i] = (float)fit->unknown[i];
    if (phasing)
        for (int k = 0; k < 2; k++) memset(work->by_row[k], 0, (size_t)(cells * cells * rows_of(fit)) * sizeof(float));
    ptrdiff_t count = 0; /* of columns that wait */
    for (ptrdiff_t j = 0; j < fit->lines; j++) {
        const ptrdiff_t before = count;
        for (ptrdiff_t i = 0; i < fit->lines; i += LEDPI_WIDTH) {
            Samples s;
            ledpi_panel_sample(&fit->panel, &fit->view, work->numbers, work->unknown, work->across + i / LEDPI_WIDTH,
                               &work->grid[1][j], (float)(fit->along[j] / (double)cells), &s);
            count = add_samples(fit, &s, i, j, phasing, count, work);
        }
        work->sampled += count - before;
        if (count < LEDPI_MOST_LINES && j + 1 < fit->lines) continue;
        if (!phasing) ledpi_add_products(work->columns, count, DENSE, work->products.common);
        count = 0;
    }
}

/* The matrix has each cell's own unknowns first, then COMMON: where an unknown is in the fit's order. */
static ptrdiff_t unknown_at(const Fitting *fit, ptrdiff_t i) {
    return i < fit->owns ? COMMON + i / fit->own * OWN + i % fit->own : i - fit->owns;
}

/* Whether an unknown is at one of its LIMITS, which the slope (of the log-likelihood) would have it cross. */
static bool is_held(ptrdiff_t at, double unknown, double slope) {
    for (size_t i = 0; i < sizeof LIMITS / sizeof *LIMITS; i++)
        if (at >= LIMITS[i].at && at < LIMITS[i].at + LIMITS[i].count)
            return (unknown <= LIMITS[i].least && slope < 0.0) || (unknown >= LIMITS[i].most && slope > 0.0);
    return false;
}

/* The normal equations (size, size + 1), right side last, over the variance, with what is known beforehand. An unknown that
 * is held at its limit has no step: else those of the others would be what goes with its own (Bertsekas 1982). */
static void put_matrix(const Fitting *fit, const Products *products, double *matrix) {
    const ptrdiff_t owns = fit->owns, size = fit->size;
    const double *prior = fit->prior, *information = fit->prior + COMMON + OWN * fit->panel.cells * fit->panel.cells;
    const double scale = 1.0 / fit->variance;
    for (ptrdiff_t i = 0; i < size; i++) {
        double *const row = matrix + i * (size + 1);
        const ptrdiff_t at = unknown_at(fit, i);
        const float *common = i < owns ? products->mixed[i] : products->common + (i - owns) * DENSE;
        for (ptrdiff_t j = i; j < owns; j++) row[j] = scale * products->own[i * owns + j];
        for (ptrdiff_t k = 0; k < DENSE; k++) row[owns + k] = scale * common[k];
        row[i] = row[i] * (1.0 + 1e-6) + 1e-6 + information[at];
        const double mean = at == PHASE || at == PHASE + 1 ? fit->sought[at - PHASE] : prior[at];
        row[size] += information[at] * (at < WAYS ? 0.0 : mean - fit->unknown[at]);
        if (at < WAYS || !is_held(at, fit->unknown[at], row[size])) continue;
        row[i] += HELD;
        row[size] = 0.0;
    }
}

/* The step, in the matrix's order of unknowns; leaves what that was eliminated to. */
static bool solve_step(Fitting *fit, Work *work) {
    const ptrdiff_t size = fit->size;
    const double freedom = (double)(work->samples - size);
    if (!(freedom > 0.0) || !isfinite(work->left)) return false;
    fit->variance = fmax(work->left / freedom, 1e-9);
    const double used = fmax(work->used, 1e-12), about_mean = work->light2 - work->light * work->light / used;
    fit->explained = 1.0 - work->left / fmax(work->inside, 1e-12) * used / fmax(about_mean, 1e-12);
    put_matrix(fit, &work->products, work->matrix);
    work->decrease = ledpi_eliminate(work->matrix, size, 0, size) / freedom;
    for (ptrdiff_t i = 0; i < size; i++)
        if (!(work->matrix[i * (size + 2)] > 0.0)) return false;
    ledpi_solve(work->matrix, size, work->step);
    return true;
}

/* Corners of a square that reaches from `low` to `high`, (across, down) each, in −1..1, once the homography has been wrong by
 * these WAYS. */
static void move(const double h[9], const double *ways, const double low[2], const double high[2], Point corners[4]) {
    const double ends[4][2] = {{low[0], low[1]}, {high[0], low[1]}, {high[0], high[1]}, {low[0], high[1]}};
    for (int i = 0; i < 4; i++) {
        const double p = ends[i][0], q = ends[i][1], both = ways[6] * p + ways[7] * q;
        const double u = 0.5 * (p - ways[0] - ways[1] * p - ways[2] * q - p * both + 1.0);
        const double v = 0.5 * (q - ways[3] - ways[4] * p - ways[5] * q - q * both + 1.0);
        const double w = h[6] * u + h[7] * v + h[8];
        corners[i] = (Point){(h[0] * u + h[1] * v + h[2]) / w, (h[3] * u + h[4] * v + h[5]) / w};
    }
}

static int ascending(const void *a, const void *b) {
    const double one = *(const double *)a, other = *(const double *)b;
    return (one > other) - (one < other);
}

/* Which side's rim says how far within the lattice's end each side (4) ends: its own; where something hides it the second
 * least. All are built alike; no more than two are hidden. */
static void put_ends(const double rim[4], int of[4]) {
    double sorted[4] = {rim[0], rim[1], rim[2], rim[3]};
    qsort(sorted, 4, sizeof *sorted, ascending);
    int usual = 0;
    while (rim[usual] != sorted[1] && usual < 3) usual++; /* there is none where one is no number */
    for (int k = 0; k < 4; k++) of[k] = rim[k] > sorted[1] + HIDDEN ? usual : k;
}

/* The same of what is lit, which ends within the lattice's end by the rim (4): left, right, above, below, in cells; each side
 * by the rim `of` one of them. */
static void move_lit(const double h[9], const double *ways, const double *rim, const int of[4], ptrdiff_t cells, Point corners[4]) {
    const double share = 2.0 / (double)cells;
    move(h, ways, (double[]){share * rim[of[0]] - 1.0, share * rim[of[2]] - 1.0},
         (double[]){1.0 - share * rim[of[1]], 1.0 - share * rim[of[3]]}, corners);
}

/* Takes the step. Returns how far it moves the homography. */
static double take_step(Fitting *fit, const double h[9], Work *work) {
    const ptrdiff_t cells = fit->panel.cells, owns = fit->owns, size = fit->size;
    double most = 0.0, usual = 0.0, *unknown = fit->unknown;
    for (int i = 0; i < WAYS; i++) most = fmax(most, fabs(work->step[owns + i]));
    const double share = fmin(1.0, fmin(MOST_STEP / most, MOST_BLURRING / fabs(work->step[owns + BLUR])));
    for (ptrdiff_t i = 0; i < size; i++) {
        const ptrdiff_t at = unknown_at(fit, i);
        work->step[i] *= share;
        if (at == PHASE || at == PHASE + 1) work->step[i] = fmin(fmax(work->step[i], -MOST_TURN), MOST_TURN);
        if (at >= WAYS) unknown[at] += work->step[i];
    }
    move(h, work->step + owns, (double[]){-1.0, -1.0}, (double[]){1.0, 1.0}, fit->corners);
    for (ptrdiff_t c = 0; c < cells * cells; c++) usual += unknown[COMMON + OWN * c] / (double)(cells * cells);
    for (ptrdiff_t c = 0; c < cells * cells; c++) unknown[COMMON + OWN * c] = fmax(unknown[COMMON + OWN * c], LEAST_GAIN * usual);
    for (size_t i = 0; i < sizeof LIMITS / sizeof *LIMITS; i++)
        for (ptrdiff_t at = LIMITS[i].at; at < LIMITS[i].at + LIMITS[i].count; at++)
            unknown[at] = fmin(fmax(unknown[at], LIMITS[i].least), LIMITS[i].most);
    return most;
}

/* Weighs each block by how large its residuals are beside the usual ones of the cells' blocks. */
static void weigh_blocks(ptrdiff_t cells, Work *work) {
    const ptrdiff_t inside = cells * cells * BLOCKS * BLOCKS, blocks = inside + 4 * cells;
    double sorted[MOST_BLOCKS];
    ptrdiff_t count = 0;
    for (ptrdiff_t b = 0; b < inside; b++)
        if (work->count[b] > 0.0) sorted[count++] = work->squares[b] / work->count[b];
    if (!count) return;
    qsort(sorted, (size_t)count, sizeof *sorted, ascending);
    const double usual = fmax(sorted[count / 2], 1e-9);
    for (ptrdiff_t b = 0; b < blocks; b++) {
        const double mean = work->count[b] > 0.0 ? work->squares[b] / work->count[b] : usual;
        work->weight[b] = fmin(1.0, (FREEDOM + 1.0) / (FREEDOM + mean / usual));
    }
}

/* By how much residuals of a block that are alike make its mean vary more than if they were independent; each unknown takes
 * one block's mean up. */
static double inflation_of(const Fitting *fit, const Work *work) {
    const ptrdiff_t cells = fit->panel.cells, blocks = cells * cells * BLOCKS * BLOCKS + 4 * cells;
    double of_means = 0.0, of_samples = 0.0, used = 0.0;
    for (ptrdiff_t b = 0; b < blocks; b++) {
        if (!(work->count[b] > 0.0)) continue;
        of_means += work->weight[b] * work->sum[b] * work->sum[b] / work->count[b];
        of_samples += work->weight[b] * work->squares[b] / work->count[b];
        used += 1.0;
    }
    return fmax(1.0, of_means / fmax(of_samples, 1e-12) * used / fmax(used - (double)fit->size, 1.0));
}

/* bᵀA⁻¹c, b and c being zero but for COMMON, of the matrix A that is eliminated: once b and c are, too. */
static void eliminate_right(const Fitting *fit, const double *matrix, double right[COMMON]) {
    const ptrdiff_t size = fit->size;
    for (ptrdiff_t k = 0; k < COMMON; k++) {
        const double *row = matrix + (fit->owns + k) * (size + 1) + fit->owns;
        for (ptrdiff_t i = k + 1; i < COMMON; i++) right[i] -= row[i] / row[k] * right[k];
    }
}

/* The corners' covariance by what is known of all unknowns. */
static void put_covariance(Fitting *fit, const double h[9], Work *work) {
    const ptrdiff_t cells = fit->panel.cells;
    const double little = 1e-4, none[WAYS] = {0.0}, *rim = fit->unknown + RIM;
    double by[8][COMMON];
    int of[4]; /* as they are: where another side is taken for hidden, corners jump, which is no slope */
    Point here[4], moved[4];
    memset(by, 0, sizeof by);
    put_ends(rim, of);
    move_lit(h, none, rim, of, cells, here);
    for (int k = 0; k < WAYS + 4; k++) {
        double ways[WAYS] = {0.0}, rims[4] = {rim[0], rim[1], rim[2], rim[3]};
        *(k < WAYS ? ways + k : rims + k - WAYS) += little;
        move_lit(h, ways, rims, of, cells, moved);
        const int at = k < WAYS ? k : RIM + k - WAYS;
        for (int i = 0; i < 4; i++) {
            by[2 * i][at] = (moved[i].x - here[i].x) / little;
            by[2 * i + 1][at] = (moved[i].y - here[i].y) / little;
        }
    }
    const double a_ray = fit->view.lens ? fit->view.lens->fx * fit->view.lens->fy : 1.0;
    const double scale = a_ray * inflation_of(fit, work);
    for (int i = 0; i < 8; i++) eliminate_right(fit, work->matrix, by[i]);
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 8; j++) {
            double sum = 0.0;
            for (ptrdiff_t k = 0; k < COMMON; k++) sum += by[i][k] * by[j][k] / work->matrix[(fit->owns + k) * (fit->size + 2)];
            fit->covariance[8 * i + j] = scale * sum;
        }
}

/* What is foreseen: that a step leaves too much, or that corners are too uncertain after one more like it; else it will do. */
static int outlook(Fitting *fit, const double h[9], Work *work) {
    const double kept = fmax(0.0, 1.0 - work->decrease);
    if ((1.0 - fit->explained) * kept > fit->asked->most_left) return LEDPI_MISFIT;
    if (!isfinite(fit->asked->most_sigma)) return LEDPI_FITTED;
    double variance = 0.0;
    put_covariance(fit, h, work);
    for (int i = 0; i < 8; i++) variance += fit->covariance[9 * i] / 8.0;
    return variance * kept * kept > fit->asked->most_sigma * fit->asked->most_sigma ? LEDPI_UNCERTAIN : LEDPI_FITTED;
}

static void seen_through(const Lens *lens, Point corners[4]) {
    for (int i = 0; lens && i < 4; i++) {
        double seen[2];
        ledpi_distort(lens, corners[i].x, corners[i].y, seen);
        corners[i] = (Point){seen[0], seen[1]};
    }
}

static double variance_of(const Work *work) { return fmax(work->left / fmax((double)work->samples, 1.0), 1e-9); }

/* Whether bands of the expected depth would be seen, and are not: of half of it, or less. What is seen then is unlikelier by
 * ½(√expected − √seen)² nats, of variance 1, than what would be; at so many this is wrong in one of a million (½z²). */
static bool is_without_bands(Bands bands, const Work *work) {
    return bands.seen < SHALLOW * bands.expected && 0.5 * SHALLOW * bands.expected > NATS_NEEDED * variance_of(work);
}

static Fitting begun(const PanelFit *asked, PanelFit *into) {
    Fitting fit = {
        .view = {asked->light, asked->rows, asked->columns, asked->first_x, asked->first_y, asked->shrink, asked->saturated,
                 {asked->focal[0], asked->focal[1]}, {asked->centre[0], asked->centre[1]}, (const Lens *)asked->lens},
        .panel = {asked->cells, asked->waves, {asked->cycles_a_row[0], asked->cycles_a_row[1]}, {0.0, 0.0}, asked->scale, asked->dark},
        .asked = asked, .along = asked->along, .prior = asked->prior, .lines = asked->lines,
        .reweightings = asked->reweightings, .unknown = asked->unknown, .covariance = into->covariance,
    };
    memcpy(fit.sought, asked->unknown + PHASE, sizeof fit.sought);
    fit.own = asked->banded ? OWN : 1, fit.owns = fit.own * asked->cells * asked->cells, fit.size = fit.owns + COMMON;
    for (int i = 0; i < 4; i++) { /* before the lens bends it a panel is a square */
        double ray[2] = {asked->corners[2 * i], asked->corners[2 * i + 1]};
        if (fit.view.lens) ledpi_ray_of(fit.view.lens, asked->corners + 2 * i, ray);
        fit.corners[i] = (Point){ray[0], ray[1]};
    }
    return fit;
}

/* A sample's variance over that of how much a cell shows of a wave. */
static float ridge_of(const Fitting *fit, const Work *work) {
    const ptrdiff_t unknowns = COMMON + OWN * fit->panel.cells * fit->panel.cells;
    return (float)(variance_of(work) * fit->prior[unknowns + COMMON + 1]);
}

/* Where a step began. */
typedef struct {
    Point corners[4];
    double unknown[MOST_UNKNOWN], variance;
} Start;

static void keep_start(const Fitting *fit, const Work *work, Start *start) {
    memcpy(start->corners, fit->corners, sizeof start->corners);
    memcpy(start->unknown, fit->unknown, sizeof(double) * (size_t)(COMMON + OWN * fit->panel.cells * fit->panel.cells));
    start->variance = variance_of(work);
}

/* Takes a share of a step back. */
static void go_back(Fitting *fit, double share, const Start *start) {
    double *const corners = (double *)fit->corners;
    for (int i = 0; i < 8; i++) corners[i] += share * (((const double *)start->corners)[i] - corners[i]);
    for (ptrdiff_t i = 0; i < COMMON + OWN * fit->panel.cells * fit->panel.cells; i++)
        fit->unknown[i] += share * (start->unknown[i] - fit->unknown[i]);
}

/* Puts all sums where the fit is, after the phases have been sought if they are to be. */
static bool look(Fitting *fit, double h[9], bool phasing, Work *work) {
    const PanelFit *const asked = fit->asked;
    ledpi_unit_square_homography(fit->corners, h);
    put_sight(&fit->view, h, fit->panel.sight);
    put_lines(fit, h, work);
    if (phasing) {
        sum_up(fit, true, work);
        const Bands bands = ledpi_panel_phases(&fit->panel, &fit->view, rows_of(fit), work->by_row[0], work->by_row[1],
                                               ridge_of(fit, work), fit->unknown + PHASE);
        memcpy(fit->sought, fit->unknown + PHASE, sizeof fit->sought);
        if (asked->must_blink && is_without_bands(bands, work)) return false;
    }
    sum_up(fit, false, work);
    return true;
}

/* Rounds of Gauss and Newton, until nothing moves; a step that leaves more than was left before is halved. What comes out was
 * looked at, but for a last step that hardly moves anything: a step goes too far where the equation is far from straight. */
static int iterate(Fitting *fit, double h[9], bool *settled, Work *work) {
    const PanelFit *const asked = fit->asked;
    Start start = {.variance = INFINITY};
    *settled = false;
    for (ptrdiff_t round = 0;; round++) {
        if (!look(fit, h, asked->phasing && round == 0, work)) return LEDPI_WITHOUT_BANDS;
        const bool goes_too_far = variance_of(work) > (1.0 + SETTLED_SHARE) * start.variance, last = round >= asked->rounds;
        if (goes_too_far) go_back(fit, last ? 1.0 : 0.5, &start);
        if (goes_too_far && !last) continue;
        if (goes_too_far) look(fit, h, false, work);
        keep_start(fit, work, &start);
        if (!solve_step(fit, work)) return LEDPI_DIVERGED;
        if (last) return LEDPI_FITTED;
        const int foreseen = round ? outlook(fit, h, work) : LEDPI_FITTED;
        const double moved = take_step(fit, h, work);
        if (!(moved < 1e3)) return LEDPI_DIVERGED;
        const bool near = moved < MOST_STEP / 10.0 && work->decrease < WEIGHED_SHARE;
        *settled = moved < asked->tolerance && work->decrease < SETTLED_SHARE && !fit->reweightings;
        if (*settled || foreseen != LEDPI_FITTED) return foreseen;
        if (near && fit->reweightings) {
            weigh_blocks(fit->panel.cells, work);
            fit->reweightings--;
            start.variance = INFINITY; /* of other weights */
        }
    }
}

int ledpi_fit_panel(PanelFit *asked, uint8_t *room) {
    Work *const work = (Work *)room;
    const ptrdiff_t cells = asked->cells, blocks = cells * cells * BLOCKS * BLOCKS + 4 * cells;
    if (asked->lines > LEDPI_MOST_LINES || cells > MOST_CELLS) return LEDPI_DIVERGED;
    double h[9];
    Fitting fit = begun(asked, asked);
    for (ptrdiff_t b = 0; b < blocks; b++) work->weight[b] = 1.0;
    work->sampled = 0;
    const int outcome = iterate(&fit, h, &asked->settled, work);
    asked->sampled = work->sampled;
    if (outcome != LEDPI_FITTED) return outcome;
    ledpi_unit_square_homography(fit.corners, h);
    put_covariance(&fit, h, work);
    int of[4];
    put_ends(fit.unknown + RIM, of);
    move_lit(h, (double[WAYS]){0.0}, fit.unknown + RIM, of, cells, fit.lit);
    seen_through(fit.view.lens, fit.corners);
    seen_through(fit.view.lens, fit.lit);
    for (int k = 0; k < 4; k++) asked->hidden[k] = of[k] == k ? 0.0 : fit.unknown[RIM + k];
    memcpy(asked->corners, fit.corners, sizeof asked->corners);
    memcpy(asked->lit, fit.lit, sizeof asked->lit);
    asked->explained = fit.explained, asked->variance = fit.variance;
    return LEDPI_FITTED;
}
