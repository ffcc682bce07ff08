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
#define SETTLED_SHARE 0.02 /* of the squared residuals */
/* Student's t: blocks of this freedom are weighed by (freedom + 1)/(freedom + their mean square over the usual one). */
#define FREEDOM 4.0
#define LEAST_GAIN 0.02
#define SHALLOW 0.25 /* of the squares that bands should explain */
#define NATS_NEEDED 11.3
static const double LEAST_BLUR_PX = 0.4, MOST_BLUR_PX = 3.0, MOST_GAP = 0.6, MOST_RIM = 0.5, MOST_SIGMA = 1.0;
/* In cells: further within than another side's, light ends at what hides the rest; two deviations of RIM_SIGMA of prior.py. */
static const double HIDDEN = 0.06;

/* A fit under way. */
typedef struct {
    View view;
    Panel panel;
    Point corners[4], lit[4];
    const PanelFit *asked;
    const double *along, *prior;
    ptrdiff_t lines, reweightings;
    double *unknown, *covariance, explained, variance;
} Fitting;

/* Sums of products of the columns; of COMMON, of each cell's OWN with COMMON, and of these among each other. */
typedef struct {
    float common[DENSE * DENSE], mixed[MOST_OWN][DENSE];
    double own[MOST_OWN * MOST_OWN];
} Products;

typedef struct {
    Line grid[2][LEDPI_MOST_LINES];
    float columns[LEDPI_MOST_LINES * DENSE];
    Products products;
    double matrix[MOST_UNKNOWN * MOST_UNKNOWN], step[MOST_UNKNOWN];
    float by_row[2][MOST_CELLS * MOST_CELLS * MOST_ROWS];
    double weight[MOST_BLOCKS], squares[MOST_BLOCKS], sum[MOST_BLOCKS], count[MOST_BLOCKS];
    double left, used, light, light2; /* sums, weighed: of squared residuals, of weights, of light and its square */
    double decrease; /* of the squared residuals, that the step should bring: a share of them */
    ptrdiff_t samples, sampled; /* of this round, of all */
} Work;

ptrdiff_t ledpi_panel_room(void) { return (ptrdiff_t)sizeof(Work); }

/* Lines of the grid in both directions. The picture's blur is the same all over: in cells it is as broad as these are
 * narrow, across their own lines, half way along each. */
static void put_lines(const Fitting *fit, const double h[9], Work *work) {
    const double n = (double)fit->panel.cells, per_ray = fit->view.lens ? fit->view.lens->fx : 1.0;
    for (int axis = 0; axis < 2; axis++)
        for (ptrdiff_t i = 0; i < fit->lines; i++) {
            const double u = axis ? 0.5 : fit->along[i] / n, v = axis ? fit->along[i] / n : 0.5;
            const double w = 1.0 / (h[6] * u + h[7] * v + h[8]);
            const double x = (h[0] * u + h[1] * v + h[2]) * w, y = (h[3] * u + h[4] * v + h[5]) * w;
            const double xu = (h[0] - x * h[6]) * w, xv = (h[1] - x * h[7]) * w;
            const double yu = (h[3] - y * h[6]) * w, yv = (h[4] - y * h[7]) * w;
            const double area = fmax(fabs(xu * yv - xv * yu) * per_ray, 1e-12);
            const double a_pixel = n * (axis ? ledpi_length(xu, yu) : ledpi_length(xv, yv)) / area;
            const double sigma = fmin(fmax(exp(fit->unknown[BLUR]) * fit->view.shrink * a_pixel, 1e-3), MOST_SIGMA);
            work->grid[axis][i] = ledpi_panel_line(fit->along[i], fit->panel.cells, sigma, fit->unknown[GAP],
                                                   fit->unknown + RIM + 2 * axis);
        }
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

static LEDPI_INLINE void add_own(Products *products, ptrdiff_t owns, const Sample *s, float root, const float *columns) {
    float by[MOST_MET * OWN];
    for (ptrdiff_t i = 0; i < s->met * OWN; i++) by[i] = root * (float)s->weight * s->by[i / OWN][i % OWN];
    for (ptrdiff_t i = 0; i < s->met * OWN; i++) {
        const ptrdiff_t row = s->cell[i / OWN] * OWN + i % OWN;
        for (int k = 0; k < DENSE; k += LEDPI_WIDTH)
            *(Eight *)(products->mixed[row] + k) += by[i] * *(const Eight *)(columns + k);
        for (ptrdiff_t j = 0; j < s->met * OWN; j++)
            products->own[row * owns + s->cell[j / OWN] * OWN + j % OWN] += (double)(by[i] * by[j]);
    }
}

/* What `ledpi_panel_phases` asks for: of one cell's light the part that its own unknowns explain. */
static void add_row(const Fitting *fit, const Sample *s, ptrdiff_t rows, Work *work) {
    const ptrdiff_t row = (ptrdiff_t)((s->row - fit->view.first_y) / fit->view.shrink + 0.5);
    if (s->met != 1 || row < 0 || row >= rows) return;
    const double *own = fit->unknown + COMMON + OWN * s->cell[0], steady = s->weight * s->by[0][0];
    double seen = s->weight * (s->seen - s->predicted);
    for (int k = 0; k < OWN; k++) seen += s->weight * own[k] * s->by[0][k];
    work->by_row[0][s->cell[0] * rows + row] += (float)(steady * steady);
    work->by_row[1][s->cell[0] * rows + row] += (float)(steady * seen);
}

static ptrdiff_t rows_of(const Fitting *fit) { return fit->view.rows < MOST_ROWS ? fit->view.rows : MOST_ROWS; }

static void clear(const Fitting *fit, Work *work) {
    const size_t owns = (size_t)(OWN * fit->panel.cells * fit->panel.cells);
    memset(work->products.common, 0, sizeof work->products.common);
    memset(work->products.mixed, 0, owns * sizeof *work->products.mixed);
    memset(work->products.own, 0, owns * owns * sizeof *work->products.own);
    memset(work->squares, 0, sizeof work->squares);
    memset(work->sum, 0, sizeof work->sum);
    memset(work->count, 0, sizeof work->count);
    work->left = work->used = work->light = work->light2 = 0.0, work->samples = 0;
}

/* Sums over the grid; by rows where `phasing`. */
LEDPI_SIMD static void sum_up(const Fitting *fit, const double h[9], bool phasing, Work *work) {
    const ptrdiff_t cells = fit->panel.cells, owns = OWN * cells * cells, rows = rows_of(fit);
    clear(fit, work);
    if (phasing)
        for (int k = 0; k < 2; k++) memset(work->by_row[k], 0, (size_t)(cells * cells * rows) * sizeof(float));
    for (ptrdiff_t j = 0; j < fit->lines; j++) {
        const Profile profile = ledpi_panel_profile(fit->unknown, &work->grid[1][j]);
        ptrdiff_t count = 0;
        for (ptrdiff_t i = 0; i < fit->lines; i++) {
            float *const columns = work->columns + count * DENSE;
            const double across = fit->along[i], down = fit->along[j];
            Sample s;
            if (!ledpi_panel_sample(&fit->panel, &fit->view, h, fit->unknown, &work->grid[0][i], &work->grid[1][j],
                                    &profile, across / (double)cells, down / (double)cells, columns, &s))
                continue;
            const ptrdiff_t block = block_of(across, down, cells);
            const double left = columns[RESIDUAL], trust = work->weight[block], weight = trust * s.weight * s.weight;
            work->squares[block] += left * left, work->sum[block] += left, work->count[block] += 1.0;
            work->left += trust * left * left, work->used += weight;
            work->light += weight * s.seen, work->light2 += weight * s.seen * s.seen;
            count++;
            if (phasing) {
                add_row(fit, &s, rows, work);
                continue;
            }
            const float root = trust < 1.0 ? (float)sqrt(trust) : 1.0f;
            for (int k = 0; trust < 1.0 && k < DENSE; k++) columns[k] *= root;
            add_own(&work->products, owns, &s, root, columns);
        }
        if (!phasing) ledpi_add_products(work->columns, count, DENSE, work->products.common);
        work->samples += count, work->sampled += count;
    }
}

/* The matrix has each cell's OWN first, then COMMON: where an unknown is in the fit's order. */
static ptrdiff_t unknown_at(ptrdiff_t i, ptrdiff_t owns) { return i < owns ? COMMON + i : i - owns; }

/* The first column of a row of the Cholesky factor that is not zero: cells share light with their neighbours only. */
static ptrdiff_t first_of(ptrdiff_t i, ptrdiff_t cells) {
    if (i >= OWN * cells * cells) return 0;
    const ptrdiff_t cell = i / OWN - cells - 1;
    return cell > 0 ? OWN * cell : 0;
}

static double product_of(const Products *products, ptrdiff_t owns, ptrdiff_t i, ptrdiff_t j) {
    if (i < owns) return products->own[i * owns + j];
    if (j < owns) return products->mixed[j][i - owns];
    return products->common[(j - owns) * DENSE + i - owns];
}

/* A symmetric positive matrix (size, size), of which the lower half is read, becomes its Cholesky factor. */
static bool factorise(double *matrix, ptrdiff_t size, ptrdiff_t cells) {
    for (ptrdiff_t i = 0; i < size; i++) {
        const ptrdiff_t from = first_of(i, cells);
        double *const row = matrix + i * size;
        for (ptrdiff_t j = from; j <= i; j++) {
            const ptrdiff_t other = first_of(j, cells);
            const double *const column = matrix + j * size;
            double sum = row[j];
            for (ptrdiff_t k = from > other ? from : other; k < j; k++) sum -= row[k] * column[k];
            if (i == j && !(sum > 0.0)) return false;
            row[j] = i == j ? sqrt(sum) : sum / column[j];
        }
    }
    return true;
}

static void solve_forward(const double *factor, ptrdiff_t size, ptrdiff_t cells, double *right) {
    for (ptrdiff_t i = 0; i < size; i++) {
        for (ptrdiff_t k = first_of(i, cells); k < i; k++) right[i] -= factor[i * size + k] * right[k];
        right[i] /= factor[i * size + i];
    }
}

static void solve_backward(const double *factor, ptrdiff_t size, ptrdiff_t cells, double *right) {
    for (ptrdiff_t i = size - 1; i >= 0; i--) {
        right[i] /= factor[i * size + i];
        for (ptrdiff_t k = first_of(i, cells); k < i; k++) right[k] -= factor[i * size + k] * right[i];
    }
}

/* The step, in the fit's order of unknowns but for the matrix's in `step`; leaves the factor. */
static bool solve_step(Fitting *fit, Work *work) {
    const ptrdiff_t cells = fit->panel.cells, owns = OWN * cells * cells, size = owns + COMMON;
    const double *prior = fit->prior, *information = fit->prior + size;
    const double freedom = (double)(work->samples - size);
    if (!(freedom > 0.0)) return false;
    fit->variance = fmax(work->left / freedom, 1e-9);
    const double used = fmax(work->used, 1e-12), about_mean = work->light2 - work->light * work->light / used;
    fit->explained = 1.0 - work->left / fmax(about_mean, 1e-12);
    for (ptrdiff_t i = 0; i < size; i++) {
        const ptrdiff_t at = unknown_at(i, owns);
        double *const row = work->matrix + i * size;
        for (ptrdiff_t j = first_of(i, cells); j <= i; j++) row[j] = product_of(&work->products, owns, i, j) / fit->variance;
        row[i] = row[i] * (1.0 + 1e-6) + 1e-6 + information[at];
        const float right = i < owns ? work->products.mixed[i][RESIDUAL] : work->products.common[(i - owns) * DENSE + RESIDUAL];
        work->step[i] = right / fit->variance + information[at] * (at < WAYS ? 0.0 : prior[at] - fit->unknown[at]);
    }
    if (!factorise(work->matrix, size, cells)) return false;
    solve_forward(work->matrix, size, cells, work->step);
    work->decrease = 0.0;
    for (ptrdiff_t i = 0; i < size; i++) work->decrease += work->step[i] * work->step[i];
    work->decrease /= freedom;
    solve_backward(work->matrix, size, cells, work->step);
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

/* How far within the lattice's end a panel ends (4), by where its light does: a side that something hides ends where the
 * others do. All are built alike; no more than two are hidden. */
static void put_ends(const double rim[4], double ends[4]) {
    double sorted[4] = {rim[0], rim[1], rim[2], rim[3]};
    qsort(sorted, 4, sizeof *sorted, ascending);
    for (int k = 0; k < 4; k++) ends[k] = rim[k] > sorted[1] + HIDDEN ? sorted[1] : rim[k];
}

/* The same of what is lit, which ends within the lattice's end by the rim (4): left, right, above, below, in cells. */
static void move_lit(const double h[9], const double *ways, const double *rim, ptrdiff_t cells, Point corners[4]) {
    const double share = 2.0 / (double)cells;
    double ends[4];
    put_ends(rim, ends);
    move(h, ways, (double[]){share * ends[0] - 1.0, share * ends[2] - 1.0},
         (double[]){1.0 - share * ends[1], 1.0 - share * ends[3]}, corners);
}

/* Takes the step. Returns how far it moves the homography. */
static double take_step(Fitting *fit, const double h[9], Work *work) {
    const ptrdiff_t cells = fit->panel.cells, owns = OWN * cells * cells, size = owns + COMMON;
    double most = 0.0, usual = 0.0, *unknown = fit->unknown;
    for (int i = 0; i < WAYS; i++) most = fmax(most, fabs(work->step[owns + i]));
    const double share = fmin(1.0, fmin(MOST_STEP / most, MOST_BLURRING / fabs(work->step[owns + BLUR])));
    for (ptrdiff_t i = 0; i < size; i++) {
        const ptrdiff_t at = unknown_at(i, owns);
        work->step[i] *= share;
        if (at == PHASE || at == PHASE + 1) work->step[i] = fmin(fmax(work->step[i], -MOST_TURN), MOST_TURN);
        if (at >= WAYS) unknown[at] += work->step[i];
    }
    move(h, work->step + owns, (double[]){-1.0, -1.0}, (double[]){1.0, 1.0}, fit->corners);
    for (ptrdiff_t c = 0; c < cells * cells; c++) usual += unknown[COMMON + OWN * c] / (double)(cells * cells);
    for (ptrdiff_t c = 0; c < cells * cells; c++) unknown[COMMON + OWN * c] = fmax(unknown[COMMON + OWN * c], LEAST_GAIN * usual);
    unknown[BLUR] = fmin(fmax(unknown[BLUR], log(LEAST_BLUR_PX)), log(MOST_BLUR_PX));
    unknown[GAP] = fmin(fmax(unknown[GAP], 0.0), MOST_GAP);
    for (int k = 0; k < 4; k++) unknown[RIM + k] = fmin(fmax(unknown[RIM + k], -MOST_RIM), MOST_RIM);
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
static double inflation_of(ptrdiff_t cells, const Work *work) {
    const ptrdiff_t blocks = cells * cells * BLOCKS * BLOCKS + 4 * cells, size = OWN * cells * cells + COMMON;
    double of_means = 0.0, of_samples = 0.0, used = 0.0;
    for (ptrdiff_t b = 0; b < blocks; b++) {
        if (!(work->count[b] > 0.0)) continue;
        of_means += work->weight[b] * work->sum[b] * work->sum[b] / work->count[b];
        of_samples += work->weight[b] * work->squares[b] / work->count[b];
        used += 1.0;
    }
    return fmax(1.0, of_means / fmax(of_samples, 1e-12) * used / fmax(used - (double)size, 1.0));
}

/* The corners' covariance by the factor of what is known of all unknowns. */
static void put_covariance(Fitting *fit, const double h[9], Work *work) {
    const ptrdiff_t cells = fit->panel.cells, owns = OWN * cells * cells, size = owns + COMMON;
    const double little = 1e-4, none[WAYS] = {0.0}, *rim = fit->unknown + RIM;
    double by[8][MOST_UNKNOWN];
    Point here[4], moved[4];
    memset(by, 0, sizeof by);
    move_lit(h, none, rim, cells, here);
    for (int k = 0; k < WAYS + 4; k++) {
        double ways[WAYS] = {0.0}, rims[4] = {rim[0], rim[1], rim[2], rim[3]};
        *(k < WAYS ? ways + k : rims + k - WAYS) += little;
        move_lit(h, ways, rims, cells, moved);
        const ptrdiff_t at = owns + (k < WAYS ? k : RIM + k - WAYS);
        for (int i = 0; i < 4; i++) {
            by[2 * i][at] = (moved[i].x - here[i].x) / little;
            by[2 * i + 1][at] = (moved[i].y - here[i].y) / little;
        }
    }
    const double a_ray = fit->view.lens ? fit->view.lens->fx * fit->view.lens->fy : 1.0;
    const double scale = a_ray * inflation_of(cells, work);
    for (int i = 0; i < 8; i++) solve_forward(work->matrix, size, cells, by[i]);
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 8; j++) {
            double sum = 0.0;
            for (ptrdiff_t k = owns; k < size; k++) sum += by[i][k] * by[j][k]; /* of OWN it is zero */
            fit->covariance[8 * i + j] = scale * sum;
        }
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
                 (const Lens *)asked->lens},
        .panel = {asked->cells, asked->waves, {asked->cycles_a_row[0], asked->cycles_a_row[1]}, asked->scale, asked->dark},
        .asked = asked, .along = asked->along, .prior = asked->prior, .lines = asked->lines,
        .reweightings = asked->reweightings, .unknown = asked->unknown, .covariance = into->covariance,
    };
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

/* Rounds of Gauss and Newton, until nothing moves. Leaves the homography of the last. */
static int iterate(Fitting *fit, double h[9], bool *settled, Work *work) {
    const PanelFit *const asked = fit->asked;
    for (ptrdiff_t round = 0;; round++) {
        ledpi_unit_square_homography(fit->corners, h);
        put_lines(fit, h, work);
        if (asked->phasing && round == 0) {
            sum_up(fit, h, true, work);
            const Bands bands = ledpi_panel_phases(&fit->panel, &fit->view, rows_of(fit), work->by_row[0], work->by_row[1],
                                                   ridge_of(fit, work), fit->unknown + PHASE);
            if (asked->must_blink && is_without_bands(bands, work)) return LEDPI_WITHOUT_BANDS;
        }
        sum_up(fit, h, false, work);
        if (!solve_step(fit, work)) return LEDPI_DIVERGED;
        const double moved = take_step(fit, h, work);
        if (!(moved < 1e3)) return LEDPI_DIVERGED;
        *settled = moved < asked->tolerance && work->decrease < SETTLED_SHARE && !fit->reweightings;
        if (round + 1 >= asked->rounds || *settled) return LEDPI_FITTED;
        if (fit->reweightings && moved < MOST_STEP / 10.0 && work->decrease < 10.0 * SETTLED_SHARE) {
            weigh_blocks(fit->panel.cells, work);
            fit->reweightings--;
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
    move_lit(h, (double[WAYS]){0.0}, fit.unknown + RIM, cells, fit.lit);
    seen_through(fit.view.lens, fit.corners);
    seen_through(fit.view.lens, fit.lit);
    double ends[4];
    put_ends(fit.unknown + RIM, ends);
    for (int k = 0; k < 4; k++) asked->hidden[k] = fit.unknown[RIM + k] > ends[k] ? fit.unknown[RIM + k] : 0.0;
    memcpy(asked->corners, fit.corners, sizeof asked->corners);
    memcpy(asked->lit, fit.lit, sizeof asked->lit);
    asked->explained = fit.explained, asked->variance = fit.variance;
    return LEDPI_FITTED;
}
