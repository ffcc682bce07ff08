/* Correlation of noise in samples near each other: by interpolation, and as a camera's processor leaves it.
 *
 * Bands are coarse, so they meet the sum R of the noise's autocorrelation r(l) over all lags l, not r(0) alone. A fit takes
 * some of white noise with it: of two samples the product of their residuals is r(l) less what their unknowns share, P(l).
 * A cell's own unknowns share no more than its own samples, and P is known; those of the whole panel, which are few, share
 * alike. */
#include <math.h>
#include <string.h>

#include "panel_evidence.h"
#include "simd.h"

/* Pixels: noise that is further apart is not alike in any picture; what is alike there is light that was not explained. */
static const double FURTHEST_PX = 2.0;

/* A triangular root of the normal equations of a cell's own FREE. */
static void put_root(const Weighing *w, const Sums *sums, ptrdiff_t cell, double root[FREE][FREE]) {
    double trace = 0.0;
    for (ptrdiff_t i = 0; i < w->free; i++) trace += sums->own[cell * w->free + i][cell][i];
    for (ptrdiff_t i = 0; i < w->free; i++)
        for (ptrdiff_t j = 0; j <= i; j++) {
            double left = sums->own[cell * w->free + i][cell][j] + (i == j ? LEDPI_RIDGE * trace / (double)w->free + 1e-12 : 0.0);
            for (ptrdiff_t k = 0; k < j; k++) left -= root[i][k] * root[j][k];
            root[i][j] = i == j ? sqrt(fmax(left, 1e-12)) : left / root[j][j];
        }
}

/* Puts what a cell's own FREE take of a sample: of two samples they share the product. */
static void put_share(const Weighing *w, const CellOverlap *overlap, ptrdiff_t cell, double root[FREE][FREE], float share[FREE]) {
    memset(share, 0, FREE * sizeof *share);
    for (int m = 0; m < overlap->count; m++) {
        if (overlap->cell[m] != cell) continue;
        for (ptrdiff_t k = 0; k < w->free; k++) {
            double left = overlap->by[m][k];
            for (ptrdiff_t j = 0; j < k; j++) left -= root[k][j] * share[j];
            share[k] = (float)(left / root[k][k]);
        }
    }
}

static void put_shares(const Weighing *w, Sums *sums) {
    const ptrdiff_t n = w->fit.panel.cells, each = w->each;
    for (ptrdiff_t cell = 0; cell < n * n; cell++) {
        double root[FREE][FREE];
        put_root(w, sums, cell, root);
        for (ptrdiff_t j = cell / n * each; j < (cell / n + 1) * each; j++)
            for (ptrdiff_t i = cell % n * each; i < (cell % n + 1) * each; i++)
                put_share(w, &sums->overlap[j][i], cell, root, sums->share[j][i]);
    }
}

/* Means of two samples that are so many lines apart: the product of their residuals, and what their cell's own FREE share. */
typedef struct {
    double left, shared;
} Pair;

static LEDPI_SIMD Pair pair_of(const Weighing *w, const Sums *sums, ptrdiff_t aside, ptrdiff_t below) {
    const ptrdiff_t lines = w->fit.lines, each = w->each;
    const double *const along = w->fit.along;
    const bool even = along[each] - along[each - 1] < 1.01 * (along[1] - along[0]); /* across a border, too */
    Pair sum = {0.0, 0.0};
    double count = 0.0;
    for (ptrdiff_t j = below; j < lines; j++)
        for (ptrdiff_t i = aside > 0 ? aside : 0; i < lines + (aside < 0 ? aside : 0); i++) {
            const ptrdiff_t above = j - below, left = i - aside;
            const bool same_cell = j / each == above / each && i / each == left / each;
            if (!sums->overlap[j][i].count || !sums->overlap[above][left].count || !(same_cell || even)) continue;
            sum.left += (double)sums->left[j][i] * sums->left[above][left], count += 1.0;
            if (!same_cell) continue;
            for (int k = 0; k < FREE; k++) sum.shared += (double)sums->share[j][i][k] * sums->share[above][left][k];
        }
    return (Pair){sum.left / fmax(count, 1.0), sum.shared / fmax(count, 1.0)};
}

double ledpi_noise_inflation(const Weighing *w, Sums *sums) {
    const double *const step_px = w->asked->step_px, samples = (double)sums->samples;
    put_shares(w, sums);
    const Pair same = pair_of(w, sums, 0, 0);
    const double of_all = fmax(0.0, sums->fitted / samples - same.shared);
    const double variance = fmax(same.left * samples / w->asked->freedom, 1e-12);
    const ptrdiff_t most_below = (ptrdiff_t)fmin(FURTHEST_PX / step_px[1], (double)(w->each - 1));
    const ptrdiff_t most_aside = (ptrdiff_t)fmin(FURTHEST_PX / step_px[0], (double)(w->each - 1));
    double inflation = 1.0;
    for (ptrdiff_t below = 0; below <= most_below; below++)
        for (ptrdiff_t aside = below ? -most_aside : 1; aside <= most_aside; aside++)
            if (ledpi_length((double)aside * step_px[0], (double)below * step_px[1]) <= FURTHEST_PX) {
                const Pair apart = pair_of(w, sums, aside, below);
                inflation += 2.0 * (apart.left / variance + apart.shared + of_all);
            }
    return fmax(1.0, inflation);
}
