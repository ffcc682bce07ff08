/* The covariance of a panel's corners by how far they would move without any one of its cells.
 *
 * What hides a side or touches it by a part of its length leaves residuals that are alike there, and nowhere else. Without a
 * cell c, and what is beside it, corners would be (A - A_c)⁻¹g_c off: A is the normal matrix, A_c what the cell adds to it, g_c
 * its slope of the log-likelihood. The sum of these squares is the jackknife's variance. A coordinate x goes with A⁻¹g by the
 * influence u = A⁻¹∂x/∂(unknowns); so it moves by d/(1 - h), where d = uᵀg_c and h = uᵀA_c·u/uᵀA·u is the cell's leverage. */
#include <math.h>
#include <string.h>

#include "panel_fit.h"

#define MOST_LEVERAGE 0.95 /* rounding could make it 1; what one cell alone tells no other one contradicts */

/* A number for each of the eight coordinates: eight also where the processor's own vectors hold four. */
typedef float Coordinates __attribute__((vector_size(32), aligned(4)));

/* All eight coordinates side by side. */
typedef struct {
    Coordinates influence[MOST_UNKNOWN]; /* in the matrix's order, each cell's own first */
    Coordinates moved[MOST_CELLS * MOST_CELLS], leverage[MOST_CELLS * MOST_CELLS];
    double variance[8];
} Jackknife;

/* Solves by the matrix that is eliminated: its right side is used up. */
static void put_influence(const Fitting *fit, const double h[9], Work *work, Jackknife *out) {
    const ptrdiff_t size = fit->size, owns = fit->owns;
    double by[8][COMMON];
    ledpi_panel_put_slopes(fit, h, by);
    for (int i = 0; i < 8; i++) {
        double right[COMMON];
        memcpy(right, by[i], sizeof right);
        ledpi_panel_eliminate_right(fit, work->matrix, right);
        for (ptrdiff_t k = 0; k < owns; k++) work->matrix[k * (size + 1) + size] = 0.0;
        for (ptrdiff_t k = 0; k < COMMON; k++) work->matrix[(owns + k) * (size + 1) + size] = right[k];
        ledpi_solve(work->matrix, size, work->step);
        out->variance[i] = 0.0;
        for (ptrdiff_t k = 0; k < COMMON; k++) out->variance[i] += work->step[owns + k] * by[i][k];
        for (ptrdiff_t k = 0; k < size; k++) out->influence[k][i] = (float)work->step[k];
    }
}

static ptrdiff_t nearest_cell(double at, ptrdiff_t cells) { return (ptrdiff_t)fmin(fmax(at, 0.0), (double)(cells - 1)); }

/* Adds how far each sample moves the coordinates, and its part of the leverage, to what its cell does. */
static LEDPI_INLINE void add_samples(const Fitting *fit, const Samples *s, ptrdiff_t first, ptrdiff_t down, const Work *work, Jackknife *out) {
    const ptrdiff_t cells = fit->panel.cells, lanes = fit->lines - first < LEDPI_WIDTH ? fit->lines - first : LEDPI_WIDTH;
    const ptrdiff_t row = nearest_cell(fit->along[down], cells) * cells;
    Owns owns;
    ledpi_panel_put_owns(s, &owns);
    for (int lane = 0; lane < lanes; lane++) {
        Owned met[4];
        if (!s->valid[lane]) continue;
        Coordinates by = {0};
        for (int k = 0; k < COMMON; k++) by += s->by[k][lane] * out->influence[fit->owns + k];
        const int count = ledpi_panel_met(&owns, lane, work->across + first / LEDPI_WIDTH, &work->grid[1][down], cells, met);
        for (int m = 0; m < count; m++)
            for (ptrdiff_t k = 0; k < fit->own; k++) by += met[m].by[k] * out->influence[met[m].cell * fit->own + k];
        const double along = fit->along[first + lane];
        const float trust = (float)(work->weight[work->block[down][first + lane]] / (fit->variance * fit->inflation));
        const ptrdiff_t cell = row + nearest_cell(along, cells);
        out->moved[cell] += trust * s->by[RESIDUAL][lane] * by;
        out->leverage[cell] += trust * by * by;
    }
}

/* Turns the sums into a covariance. */
static void put_squares(Jackknife *all, ptrdiff_t cells, double covariance[64]) {
    memset(covariance, 0, 64 * sizeof *covariance);
    for (ptrdiff_t c = 0; c < cells * cells; c++) {
        double moved[8];
        for (int i = 0; i < 8; i++) moved[i] = all->moved[c][i] / (1.0 - fmin(all->leverage[c][i] / all->variance[i], MOST_LEVERAGE));
        for (int i = 0; i < 8; i++)
            for (int k = 0; k < 8; k++) covariance[8 * i + k] += moved[i] * moved[k];
    }
}

LEDPI_SIMD void ledpi_panel_put_jackknife(Fitting *fit, const double h[9], Work *work, double covariance[64]) {
    const ptrdiff_t cells = fit->panel.cells;
    Jackknife all;
    memset(&all, 0, sizeof all);
    put_influence(fit, h, work, &all);
    ledpi_panel_put_grid(fit, h, work);
    for (ptrdiff_t k = 0; k < COMMON + OWN * cells * cells; k++) work->unknown[k] = (float)fit->unknown[k];
    for (ptrdiff_t j = 0; j < fit->lines; j++) {
        const Profile profile = ledpi_panel_profile(work->unknown, &work->grid[1][j]);
        for (ptrdiff_t i = 0; i < fit->lines; i += LEDPI_WIDTH) {
            Samples s;
            ledpi_panel_sample_at(fit, work, &profile, i, j, &s);
            add_samples(fit, &s, i, j, work, &all);
        }
    }
    put_squares(&all, cells, covariance);
}
