/* One step of Gauss and Newton, within the limits in which slopes hold and unknowns mean something. */
#include <math.h>

#include "panel_fit.h"

#define MOST_STEP 0.1 /* of half the side: as far as the slopes hold */
#define MOST_BLURRING 0.3 /* of the blur's logarithm */
#define MOST_TURN 0.1 /* cycles of a phase: as far as its wave's slope holds */
#define LEAST_GAIN 0.02
#define SURELY 2.0 /* deviations: one in fifty */
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

/* The least and the most that an unknown may be. A cell's gain is at least LEAST_GAIN of what is usual. */
static void put_limits(ptrdiff_t at, double usual, double limits[2]) {
    limits[0] = at >= COMMON && (at - COMMON) % OWN == 0 ? LEAST_GAIN * usual : -INFINITY, limits[1] = INFINITY;
    for (size_t i = 0; i < sizeof LIMITS / sizeof *LIMITS; i++)
        if (at >= LIMITS[i].at && at < LIMITS[i].at + LIMITS[i].count) limits[0] = LIMITS[i].least, limits[1] = LIMITS[i].most;
}

static double usual_gain(const Fitting *fit) {
    const ptrdiff_t count = fit->panel.cells * fit->panel.cells;
    double usual = 0.0;
    for (ptrdiff_t c = 0; c < count; c++) usual += fit->unknown[COMMON + OWN * c] / (double)count;
    return usual;
}

/* The normal equations (size, size + 1), right side last, over the variance, with what is known beforehand. */
static void put_matrix(const Fitting *fit, const Products *products, double damping, double *matrix) {
    const ptrdiff_t owns = fit->owns, size = fit->size;
    const double *prior = fit->prior, *information = fit->prior + COMMON + OWN * fit->panel.cells * fit->panel.cells;
    const double scale = 1.0 / fit->variance;
    for (ptrdiff_t i = 0; i < size; i++) {
        double *const row = matrix + i * (size + 1);
        const ptrdiff_t at = unknown_at(fit, i);
        const float *common = i < owns ? products->mixed[i] : products->common + (i - owns) * DENSE;
        for (ptrdiff_t j = i; j < owns; j++) row[j] = scale * products->own[i * owns + j];
        for (ptrdiff_t k = 0; k < DENSE; k++) row[owns + k] = scale * common[k];
        row[i] = (row[i] * (1.0 + 1e-6) + 1e-6 + information[at]) * (1.0 + damping);
        const double mean = at == PHASE || at == PHASE + 1 ? fit->sought[at - PHASE] : prior[at];
        row[size] += information[at] * (at < WAYS ? 0.0 : mean - fit->unknown[at]);
    }
}

/* Takes an unknown's step as given: the others' are to go with it. Returns the squares that this explains. */
static double hold(ptrdiff_t i, double step, ptrdiff_t size, double *matrix) {
    double *const row = matrix + i * (size + 1);
    const double explained = (2.0 * row[size] - row[i] * step) * step;
    for (ptrdiff_t j = 0; j < i; j++) {
        double *const other = matrix + j * (size + 1);
        other[size] -= step * other[i], other[i] = 0.0;
    }
    for (ptrdiff_t j = i + 1; j < size; j++) matrix[j * (size + 1) + size] -= step * row[j], row[j] = 0.0;
    row[i] = HELD, row[size] = 0.0;
    return explained;
}

/* Puts the step of what is not held (size,), NAN, and eliminates the matrix to it. Returns the squares that both explain; NAN
 * where there is no step. */
static double put_step(const Fitting *fit, double damping, const double *held, Work *work) {
    const ptrdiff_t size = fit->size;
    double explained = 0.0;
    put_matrix(fit, &work->products, damping, work->matrix);
    for (ptrdiff_t i = 0; i < size; i++)
        if (!isnan(held[i])) explained += hold(i, held[i], size, work->matrix);
    explained += ledpi_eliminate(work->matrix, size, 0, size);
    for (ptrdiff_t i = 0; i < size; i++)
        if (!(work->matrix[i * (size + 2)] > 0.0)) return NAN;
    ledpi_solve(work->matrix, size, work->step);
    for (ptrdiff_t i = 0; i < size; i++)
        if (!isnan(held[i])) work->step[i] = held[i];
    return explained;
}

/* Holds what is at a limit, and by more than `least` deviations beyond it, by the slope of the log-likelihood in the matrix's
 * right side. */
static void hold_at_limits(const Fitting *fit, double usual, double least, const double *matrix, double *held) {
    for (ptrdiff_t i = 0; i < fit->size; i++) {
        const double unknown = fit->unknown[unknown_at(fit, i)], *const row = matrix + i * (fit->size + 1);
        const double beyond = row[fit->size] / sqrt(fmax(row[i], 1e-12)); /* deviations */
        double limits[2];
        put_limits(unknown_at(fit, i), usual, limits);
        held[i] = (unknown <= limits[0] && beyond < -least) || (unknown >= limits[1] && beyond > least) ? 0.0 : NAN;
    }
}

/* Holds what the step would take beyond a limit there. Returns whether there is any. */
static bool hold_crossing(const Fitting *fit, double usual, const double *step, double *held) {
    bool any = false;
    for (ptrdiff_t i = 0; i < fit->size; i++) {
        const ptrdiff_t at = unknown_at(fit, i);
        const double to = fit->unknown[at] + step[i];
        double limits[2];
        put_limits(at, usual, limits);
        if (at < WAYS || !isnan(held[i]) || (to >= limits[0] && to <= limits[1])) continue;
        held[i] = fmin(fmax(to, limits[0]), limits[1]) - fit->unknown[at], any = true;
    }
    return any;
}

/* What is explained of the light, and the variance of what is not. Returns whether there is any. */
static bool put_variance(Fitting *fit, const Work *work) {
    const double freedom = (double)(work->samples - fit->size);
    if (!(freedom > 0.0) || !isfinite(work->left)) return false;
    fit->variance = fmax(work->left / freedom, 1e-9);
    const double used = fmax(work->used, 1e-12), about_mean = work->light2 - work->light * work->light / used;
    fit->explained = 1.0 - work->left / fmax(work->inside, 1e-12) * used / fmax(about_mean, 1e-12);
    return true;
}

bool ledpi_panel_solve_step(Fitting *fit, double damping, Work *work) {
    const double usual = usual_gain(fit);
    double held[MOST_UNKNOWN], explained;
    if (!put_variance(fit, work)) return false;
    put_matrix(fit, &work->products, damping, work->matrix);
    hold_at_limits(fit, usual, 0.0, work->matrix, held);
    do explained = put_step(fit, damping, held, work);
    while (damping > 0.0 && !isnan(explained) && hold_crossing(fit, usual, work->step, held));
    work->decrease = fmax(explained, 0.0) / (double)(work->samples - fit->size);
    return !isnan(explained);
}

bool ledpi_panel_weigh(Fitting *fit, Work *work) {
    double held[MOST_UNKNOWN];
    if (!put_variance(fit, work)) return false;
    put_matrix(fit, &work->products, 0.0, work->matrix);
    hold_at_limits(fit, usual_gain(fit), SURELY, work->matrix, held);
    return !isnan(put_step(fit, 0.0, held, work));
}

double ledpi_panel_take_step(Fitting *fit, const double h[9], Work *work) {
    const ptrdiff_t cells = fit->panel.cells, owns = fit->owns, size = fit->size;
    double most = 0.0, *unknown = fit->unknown;
    for (int i = 0; i < WAYS; i++) most = fmax(most, fabs(work->step[owns + i]));
    const double share = fmin(1.0, fmin(MOST_STEP / most, MOST_BLURRING / fabs(work->step[owns + BLUR])));
    for (ptrdiff_t i = 0; i < size; i++) {
        const ptrdiff_t at = unknown_at(fit, i);
        work->step[i] *= share;
        if (at == PHASE || at == PHASE + 1) work->step[i] = fmin(fmax(work->step[i], -MOST_TURN), MOST_TURN);
        if (at >= WAYS) unknown[at] += work->step[i];
    }
    ledpi_panel_move(h, work->step + owns, (double[]){-1.0, -1.0}, (double[]){1.0, 1.0}, fit->corners);
    const double usual = usual_gain(fit);
    for (ptrdiff_t at = WAYS; at < COMMON + OWN * cells * cells; at++) {
        double limits[2];
        put_limits(at, usual, limits);
        unknown[at] = fmin(fmax(unknown[at], limits[0]), limits[1]);
    }
    return most;
}
