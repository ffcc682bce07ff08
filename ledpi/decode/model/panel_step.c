/* One step of Gauss and Newton, within the limits in which slopes hold and unknowns mean something. */
#include <math.h>

#include "panel_fit.h"

#define MOST_STEP 0.1 /* half sides: as far as the slopes hold */
#define MOST_BLURRING 0.3 /* in the blur's logarithm */
#define MOST_TURN 0.1 /* cycles of a phase: as far as its wave's slope holds */
#define LEAST_GAIN 0.02
#define HELD 1e12 /* one over the variance of what cannot move */
/* Unknowns stay where the equation means something: the blur within 0.4 … 2 px, other lengths in cells. */
static const struct {
    ptrdiff_t at, count;
    double least, most;
} LIMITS[] = {{BLUR, 1, -0.92, 0.69}, {GAP, 1, 0.0, 0.25}, {RIM, 4, -0.5, 0.5}, {DEPTH, 1, 0.0, 0.2}, {GLOW, 1, 0.0, 1.0}, {SMEAR, 1, -0.9, 0.9}};

/* The matrix has each cell's own unknowns first, then COMMON: where an unknown is in the fit's order. */
static ptrdiff_t unknown_at(const Fitting *fit, ptrdiff_t i) {
    return i < fit->owns ? COMMON + i / fit->own * OWN + i % fit->own : i - fit->owns;
}

/* True if an unknown is at one of its LIMITS, which the slope (of the log-likelihood) would have it cross. */
static bool is_held(ptrdiff_t at, double unknown, double slope) {
    for (size_t i = 0; i < sizeof LIMITS / sizeof *LIMITS; i++)
        if (at >= LIMITS[i].at && at < LIMITS[i].at + LIMITS[i].count)
            return (unknown <= LIMITS[i].least && slope < 0.0) || (unknown >= LIMITS[i].most && slope > 0.0);
    return false;
}

/* The normal equations (size, size + 1), right side last, over the variance, with what is known beforehand. An unknown that
 * is held at its limit has no step: else those of the others would be what goes with its own (Bertsekas 1982). */
static void put_matrix(const Fitting *fit, bool holding, const Products *products, double *matrix) {
    const ptrdiff_t owns = fit->owns, size = fit->size;
    const double *prior = fit->prior, *information = fit->prior + COMMON + OWN * fit->panel.cells * fit->panel.cells;
    const double scale = 1.0 / (fit->variance * fit->inflation);
    for (ptrdiff_t i = 0; i < size; i++) {
        double *const row = matrix + i * (size + 1);
        const ptrdiff_t at = unknown_at(fit, i);
        const float *common = i < owns ? products->mixed[i] : products->common + (i - owns) * DENSE;
        for (ptrdiff_t j = i; j < owns; j++) row[j] = scale * products->own[i][j / fit->own][j % fit->own];
        for (ptrdiff_t k = 0; k < DENSE; k++) row[owns + k] = scale * common[k];
        row[i] = row[i] * (1.0 + 1e-6) + 1e-6 + information[at];
        const double mean = at == PHASE || at == PHASE + 1 ? fit->sought[at - PHASE] : prior[at];
        row[size] += information[at] * (at < WAYS ? 0.0 : mean - fit->unknown[at]);
        if (!holding || at < WAYS || !is_held(at, fit->unknown[at], row[size])) continue;
        row[i] += HELD;
        row[size] = 0.0;
    }
}

bool ledpi_panel_solve_step(Fitting *fit, bool holding, Work *work) {
    const ptrdiff_t size = fit->size;
    const double freedom = (double)(work->samples - size);
    if (!(freedom > 0.0) || !isfinite(work->left)) return false;
    fit->variance = fmax(work->left / freedom, 1e-9);
    const double used = fmax(work->used, 1e-12), about_mean = work->light2 - work->light * work->light / used;
    fit->explained = 1.0 - work->left / fmax(work->inside, 1e-12) * used / fmax(about_mean, 1e-12);
    fit->inflation = fit->asked->reweightings && !fit->reweightings ? ledpi_panel_inflation(fit, work) : 1.0;
    put_matrix(fit, holding, &work->products, work->matrix);
    work->decrease = ledpi_eliminate(work->matrix, size, 0, size) * fit->inflation / freedom;
    for (ptrdiff_t i = 0; i < size; i++)
        if (!(work->matrix[i * (size + 2)] > 0.0)) return false;
    ledpi_solve(work->matrix, size, work->step);
    return true;
}

double ledpi_panel_take_step(Fitting *fit, const double h[9], Work *work) {
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
    ledpi_panel_move(h, work->step + owns, (double[]){-1.0, -1.0}, (double[]){1.0, 1.0}, fit->corners);
    for (ptrdiff_t c = 0; c < cells * cells; c++) usual += unknown[COMMON + OWN * c] / (double)(cells * cells);
    for (ptrdiff_t c = 0; c < cells * cells; c++) unknown[COMMON + OWN * c] = fmax(unknown[COMMON + OWN * c], LEAST_GAIN * usual);
    for (size_t i = 0; i < sizeof LIMITS / sizeof *LIMITS; i++)
        for (ptrdiff_t at = LIMITS[i].at; at < LIMITS[i].at + LIMITS[i].count; at++)
            unknown[at] = fmin(fmax(unknown[at], LIMITS[i].least), LIMITS[i].most);
    return most;
}
