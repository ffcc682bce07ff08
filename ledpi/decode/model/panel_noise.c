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
/* Samples by which it is known what the fit takes of pairs: all of a small panel, and as many of a large one. */
enum { REFERENCES = 144, MOST_LAGS = 2 * MOST_EACH * MOST_EACH };

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

/* Tells whether a sample and the one that is a lag before it tell noise; across a cell's border only where samples are even there. */
static LEDPI_INLINE bool are_pair(const Weighing *w, const Sums *sums, ptrdiff_t j, ptrdiff_t i, const Lag *lag, bool even) {
    const ptrdiff_t lines = w->fit.lines, each = w->each, above = j - lag->below, left = i - lag->aside;
    if (above < 0 || left < 0 || left >= lines || !sums->overlap[j][i].count || !sums->overlap[above][left].count) return false;
    return even || (j / each == above / each && i / each == left / each);
}

/* Puts the slopes (size) of a sample by all unknowns, less what the one value explains that cells share at its place. */
static LEDPI_SIMD void put_slopes(const Weighing *w, const Sums *sums, ptrdiff_t j, ptrdiff_t i, double *slopes) {
    const CellOverlap *const overlap = &sums->overlap[j][i];
    const float *const shared = sums->shared + (j % w->each * w->each + i % w->each) * w->width;
    const double shown = w->asked->compared ? 0.0 : overlap->shown * sums->norm[j % w->each * w->each + i % w->each];
    for (ptrdiff_t k = 0; k < COMMON; k++) slopes[k] = sums->columns[j][i][k] - shown * shared[k];
    for (ptrdiff_t e = 0; e < w->frees; e++) slopes[ledpi_place_of(w, e)] = -shown * shared[DENSE + e];
    for (int m = 0; m < overlap->count; m++)
        for (ptrdiff_t k = 0; k < w->free; k++) slopes[ledpi_place_of(w, overlap->cell[m] * w->free + k)] += overlap->by[m][k];
}

/* Puts N⁻¹a of slopes a, by the matrix that the unknowns are eliminated from, whose right side it takes. */
static LEDPI_SIMD void put_solved(ptrdiff_t size, double *matrix, double *slopes, double *solved) {
    for (ptrdiff_t k = 0; k < size; k++) {
        double *const row = matrix + k * (size + 1);
        const double factor = slopes[k] / row[k];
        row[size] = slopes[k];
        for (ptrdiff_t m = k + 1; m < size; m++) slopes[m] -= factor * row[m];
    }
    ledpi_solve(matrix, size, solved);
}

static void add_taken(const Weighing *w, Sums *sums, bool even, ptrdiff_t count, Lag *lags) {
    const ptrdiff_t lines = w->fit.lines, size = COMMON + w->frees, every = (lines * lines - 1) / REFERENCES + 1;
    double slopes[MOST_SUMS], solved[MOST_SUMS];
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) {
            if ((i + 5 * j) % every || !sums->overlap[j][i].count) continue;
            put_slopes(w, sums, j, i, slopes);
            put_solved(size, sums->matrix, slopes, solved);
            for (Lag *lag = lags; lag < lags + count; lag++) {
                if (!are_pair(w, sums, j, i, lag, even)) continue;
                put_slopes(w, sums, j - lag->below, i - lag->aside, slopes);
                for (ptrdiff_t k = 0; k < size; k++) lag->taken += solved[k] * slopes[k];
                lag->references += 1.0;
            }
        }
}

double ledpi_noise_inflation(const Weighing *w, Sums *sums) {
    const double *const along = w->fit.along;
    const bool even = along[w->each] - along[w->each - 1] < 1.01 * (along[1] - along[0]);
    Lag lags[MOST_LAGS];
    const ptrdiff_t count = put_lags(w, lags);
    add_taken(w, sums, even, count, lags);
    for (ptrdiff_t j = 0; j < w->fit.lines; j++)
        for (ptrdiff_t i = 0; i < w->fit.lines; i++)
            for (Lag *lag = lags; lag < lags + count; lag++) {
                if (!are_pair(w, sums, j, i, lag, even)) continue;
                lag->left += (double)sums->left[j][i] * sums->left[j - lag->below][i - lag->aside], lag->pairs += 1.0;
            }
    const double variance = fmax(lags[0].left / w->asked->freedom, 1e-12);
    const double *const step_px = w->asked->step_px, least = fmax(1.0, CUBIC / step_px[0]) * fmax(1.0, CUBIC / step_px[1]);
    double inflation = 1.0;
    for (const Lag *lag = lags + 1; lag < lags + count; lag++)
        inflation += 2.0 * (lag->left / fmax(lag->pairs, 1.0) / variance + lag->taken / fmax(lag->references, 1.0));
    return fmax(least, inflation);
}
