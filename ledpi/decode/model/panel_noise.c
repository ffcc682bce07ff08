/* Correlation of noise in samples near each other: by interpolation, and as a camera's processor leaves it.
 *
 * Bands are coarse, so they meet the sum R of the noise's autocorrelation r(l) over all lags l, not r(0) alone. The fit takes
 * some of white noise with it: of two samples the product of their residuals is r(l) less aᵀN⁻¹b of their slopes, N being
 * the normal equations' matrix. Without that a panel of ten pixels, with a hundred unknowns for as many samples, seems to have
 * noise that is alike, or that is not, wherever the fit puts what it leaves. */
#include <math.h>
#include <string.h>

#include "panel_evidence.h"
#include "simd.h"

/* Pixels: noise that is further apart is not alike in any picture; what is alike there is light that was not explained. */
static const double FURTHEST_PX = 2.0;
/* Pixels a sample by cubics stands for, along a line: it has 57/70 (the integral of Catmull and Rom's cubic squared) of a pixel's
 * noise, and samples that are closer tell no more than the pixels do. */
static const double CUBIC = 70.0 / 57.0;
/* Samples by which it is known what the fit takes of pairs: a few for each cell. */
enum { REFERENCES = 48, MOST_LAGS = 2 * MOST_EACH * MOST_EACH };
/* References that are solved for at once. */
enum { TOGETHER = LEDPI_WIDTH / 2 };
typedef double Together __attribute__((vector_size(TOGETHER * sizeof(double))));

/* Pairs of samples that are so many lines apart: the sums of products of their residuals, and of what the fit takes. */
typedef struct {
    ptrdiff_t aside, below;
    double left, pairs, taken, references;
} Lag;

static ptrdiff_t put_lags(const Weighing *w, Lag *lags) {
    const double *const step_px = w->asked->step_px;
    const ptrdiff_t most_below = (ptrdiff_t)fmin(FURTHEST_PX / step_px[1], (double)(w->each - 1));
    const ptrdiff_t most_aside = (ptrdiff_t)fmin(FURTHEST_PX / step_px[0], (double)(w->each - 1));
    ptrdiff_t count = 0;
    for (ptrdiff_t below = 0; below <= most_below; below++)
        for (ptrdiff_t aside = below ? -most_aside : 0; aside <= most_aside; aside++)
            if (ledpi_length((double)aside * step_px[0], (double)below * step_px[1]) <= FURTHEST_PX)
                lags[count++] = (Lag){.aside = aside, .below = below};
    return count;
}

/* The cell of each line, 0 of all where samples are even across a cell's border. */
typedef struct {
    ptrdiff_t of[LINES];
} Cells;

static Cells cells_of(const Weighing *w) {
    const double *const along = w->fit.along;
    const bool even = along[w->each] - along[w->each - 1] < 1.01 * (along[1] - along[0]);
    Cells cell;
    for (ptrdiff_t line = 0; line < w->fit.lines; line++) cell.of[line] = even ? 0 : line / w->each;
    return cell;
}

/* Tells whether a sample and the one that is a lag before it tell noise. */
static LEDPI_INLINE bool are_pair(const Weighing *w, const Sums *sums, const Cells *cell, ptrdiff_t j, ptrdiff_t i, const Lag *lag) {
    const ptrdiff_t lines = w->fit.lines, above = j - lag->below, left = i - lag->aside;
    if (above < 0 || left < 0 || left >= lines || !sums->overlap[j][i].count || !sums->overlap[above][left].count) return false;
    return cell->of[j] == cell->of[above] && cell->of[i] == cell->of[left];
}

/* Index of a sample's place within its cell, at which cells share a value. */
static LEDPI_INLINE ptrdiff_t within_cell(const Weighing *w, ptrdiff_t j, ptrdiff_t i) { return j % w->each * w->each + i % w->each; }

/* The share that this value takes of a sample; of frames that are compared there is none. */
static LEDPI_INLINE float shared_share(const Weighing *w, const Sums *sums, ptrdiff_t j, ptrdiff_t i) {
    return w->asked->compared ? 0.0f : sums->overlap[j][i].shown * sums->norm[within_cell(w, j, i)];
}

/* Puts a sample's slopes a, less what is shared, in the matrix' order. */
static LEDPI_INLINE void put_slopes(const Weighing *w, const Sums *sums, ptrdiff_t j, ptrdiff_t i, int lane, Together slopes[MOST_SUMS]) {
    const CellOverlap *const overlap = &sums->overlap[j][i];
    const float shown = shared_share(w, sums, j, i), *const shared = sums->shared + within_cell(w, j, i) * w->width;
    for (ptrdiff_t k = 0; k < COMMON; k++) slopes[k][lane] = sums->columns[j][i][k];
    for (int m = 0; m < overlap->count; m++)
        for (ptrdiff_t k = 0; k < w->free; k++) slopes[ledpi_place_of(w, overlap->cell[m] * w->free + k)][lane] += overlap->by[m][k];
    for (ptrdiff_t k = 0; shown != 0.0f && k < COMMON; k++) slopes[k][lane] -= shown * shared[k];
    for (ptrdiff_t e = 0; shown != 0.0f && e < w->frees; e++) slopes[ledpi_place_of(w, e)][lane] -= shown * shared[DENSE + e];
}

/* Makes N⁻¹a of slopes a, in the order of the matrix, from which the unknowns are eliminated: forward, and back. */
static LEDPI_SIMD void solve_together(const Weighing *w, const Sums *sums, Together slopes[MOST_SUMS]) {
    const ptrdiff_t size = COMMON + w->frees;
    ptrdiff_t k = 0;
    for (; k + 1 < size; k += 2) {
        const double *const row = sums->matrix + k * (size + 1), *const next = row + size + 1;
        const Together factor = slopes[k] / row[k];
        slopes[k + 1] -= factor * row[k + 1];
        const Together further = slopes[k + 1] / next[k + 1];
        for (ptrdiff_t m = k + 2; m < size; m++) slopes[m] -= factor * row[m] + further * next[m];
    }
    for (k = size - 1; k >= 0; k--) {
        const double *const row = sums->matrix + k * (size + 1);
        Together known[4] = {slopes[k]};
        ptrdiff_t m = k + 1;
        for (; m + 4 <= size; m += 4)
            for (int n = 0; n < 4; n++) known[n] -= row[m + n] * slopes[m + n];
        for (; m < size; m++) known[0] -= row[m] * slopes[m];
        slopes[k] = ((known[0] + known[1]) + (known[2] + known[3])) / row[k];
    }
}

/* The share of noise that the fit takes of a sample together with another, whose slopes are `solved`. */
static LEDPI_SIMD double taken_of(const Weighing *w, const Sums *sums, ptrdiff_t j, ptrdiff_t i, const float solved[MOST_SUMS]) {
    const CellOverlap *const overlap = &sums->overlap[j][i];
    const float shown = shared_share(w, sums, j, i);
    double taken = ledpi_product(solved, sums->columns[j][i], DENSE);
    for (int m = 0; m < overlap->count; m++)
        for (ptrdiff_t k = 0; k < w->free; k++) taken += solved[DENSE + overlap->cell[m] * w->free + k] * overlap->by[m][k];
    return shown == 0.0f ? taken : taken - shown * ledpi_product(solved, sums->shared + within_cell(w, j, i) * w->width, w->width);
}

/* Adds what the fit takes of a sample and those that are a lag before it, whose slopes' solution is a lane of `together`. */
static void add_reference(const Weighing *w, const Sums *sums, const Cells *cell, ptrdiff_t at, const Together *together, int lane,
                          ptrdiff_t count, Lag *lags) {
    const ptrdiff_t j = at / w->fit.lines, i = at % w->fit.lines;
    float solved[MOST_SUMS] = {0.0f};
    for (ptrdiff_t k = 0; k < COMMON; k++) solved[k] = (float)together[k][lane];
    for (ptrdiff_t e = 0; e < w->frees; e++) solved[DENSE + e] = (float)together[ledpi_place_of(w, e)][lane];
    for (Lag *lag = lags; lag < lags + count; lag++)
        if (are_pair(w, sums, cell, j, i, lag))
            lag->taken += taken_of(w, sums, j - lag->below, i - lag->aside, solved), lag->references += 1.0;
}

static void add_taken(const Weighing *w, const Sums *sums, const Cells *cell, ptrdiff_t count, Lag *lags) {
    const ptrdiff_t lines = w->fit.lines, every = (lines * lines - 1) / REFERENCES + 1;
    ptrdiff_t at[TOGETHER], waiting = 0;
    for (ptrdiff_t sample = 0; sample < lines * lines; sample++) {
        const ptrdiff_t j = sample / lines, i = sample % lines;
        if ((i + 5 * j) % every == 0 && sums->overlap[j][i].count) at[waiting++] = sample;
        if (waiting < TOGETHER && !(waiting && sample == lines * lines - 1)) continue;
        Together slopes[MOST_SUMS] = {{0.0}};
        for (int lane = 0; lane < waiting; lane++) put_slopes(w, sums, at[lane] / lines, at[lane] % lines, lane, slopes);
        solve_together(w, sums, slopes);
        for (int lane = 0; lane < waiting; lane++) add_reference(w, sums, cell, at[lane], slopes, lane, count, lags);
        waiting = 0;
    }
}

double ledpi_noise_inflation(const Weighing *w, const Sums *sums) {
    const Cells cell = cells_of(w);
    Lag lags[MOST_LAGS];
    const ptrdiff_t count = put_lags(w, lags);
    add_taken(w, sums, &cell, count, lags);
    for (ptrdiff_t j = 0; j < w->fit.lines; j++)
        for (ptrdiff_t i = 0; i < w->fit.lines; i++)
            for (Lag *lag = lags; lag < lags + count; lag++) {
                if (!are_pair(w, sums, &cell, j, i, lag)) continue;
                lag->left += (double)sums->left[j][i] * sums->left[j - lag->below][i - lag->aside], lag->pairs += 1.0;
            }
    const double variance = fmax(lags[0].left / w->asked->freedom, 1e-12);
    const double *const step_px = w->asked->step_px, least = fmax(1.0, CUBIC / step_px[0]) * fmax(1.0, CUBIC / step_px[1]);
    double inflation = 1.0;
    for (const Lag *lag = lags + 1; lag < lags + count; lag++)
        inflation += 2.0 * (lag->left / fmax(lag->pairs, 1.0) / variance + lag->taken / fmax(lag->references, 1.0));
    return fmax(least, inflation);
}
