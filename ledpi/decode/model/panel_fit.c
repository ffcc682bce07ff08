/* A panel's picture fitted to light by Gauss and Newton: corners, profile, phases and each cell's own, all at once. */
#include <math.h>
#include <string.h>

#include "panel_fit.h"

#define SETTLED_SHARE 0.1 /* share of the squared residuals: so well is the noise known, and no better, as samples move with the corners */
#define WEIGHED_SHARE 0.5 /* and while more of them than this will go, what does not fit is not told from what is not fitted yet */
#define SHALLOW 0.25 /* share of the squares that bands should explain */
#define NATS_NEEDED 11.3
#define NEAR 0.01 /* half sides: a step so short no longer moves samples */

ptrdiff_t ledpi_panel_room(void) { return (ptrdiff_t)sizeof(Work); }

/* Early stop, as foreseen: a step leaves too much, or corners are too uncertain after one more like it; else it will do. */
static int early_stop(Fitting *fit, const double h[9], Work *work) {
    const double kept = fmax(0.0, 1.0 - work->decrease);
    if ((1.0 - fit->explained) * kept > fit->asked->most_left) return LEDPI_MISFIT;
    if (!isfinite(fit->asked->most_sigma)) return LEDPI_FITTED;
    double variance = 0.0;
    ledpi_panel_put_covariance(fit, h, work);
    for (int i = 0; i < 8; i++) variance += fit->covariance[9 * i] / 8.0;
    return variance * kept * kept > fit->asked->most_sigma * fit->asked->most_sigma ? LEDPI_UNCERTAIN : LEDPI_FITTED;
}

static void seen_through(const Lens *lens, Point corners[4]) {
    for (int i = 0; lens && i < 4; i++) {
        double seen[2], by[2][2];
        ledpi_distort(lens, corners[i].x, corners[i].y, seen, by);
        corners[i] = (Point){seen[0], seen[1]};
    }
}

static double variance_of(const Work *work) { return fmax(work->left / fmax((double)work->samples, 1.0), 1e-9); }

/* True if bands of the expected depth would be seen, and are not: of half of it, or less. What is seen then is unlikelier by
 * ½(√expected − √seen)² nats, of variance 1, than what would be; at so many this is wrong in one of a million (½z²). */
static bool is_without_bands(Bands bands, const Work *work) {
    return bands.seen < SHALLOW * bands.expected && 0.5 * SHALLOW * bands.expected > NATS_NEEDED * variance_of(work);
}

Fitting ledpi_panel_begun(const PanelFit *asked, PanelFit *into) {
    Fitting fit = {
        .view = {asked->light, asked->rows, asked->columns, asked->first_x, asked->first_y, asked->shrink, asked->saturated,
                 {asked->focal[0], asked->focal[1]}, {asked->centre[0], asked->centre[1]}, (const Lens *)asked->lens},
        .panel = {asked->cells, asked->waves, {asked->cycles_a_row[0], asked->cycles_a_row[1]}, {0.0, 0.0}, asked->scale, asked->dark},
        .asked = asked, .along = asked->along, .prior = asked->prior, .lines = asked->lines,
        .reweightings = asked->reweightings, .unknown = asked->unknown, .covariance = into ? into->covariance : NULL,
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

/* The start of a step. */
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
    ledpi_panel_put_grid(fit, h, work);
    if (phasing) {
        ledpi_panel_sum_up(fit, true, work);
        const Bands bands = ledpi_panel_phases(&fit->panel, &fit->view, ledpi_panel_rows(fit), work->by_row[0], work->by_row[1],
                                               ridge_of(fit, work), fit->unknown + PHASE);
        memcpy(fit->sought, fit->unknown + PHASE, sizeof fit->sought);
        if (asked->must_blink && is_without_bands(bands, work)) return false;
    }
    ledpi_panel_sum_up(fit, false, work);
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
        if (!ledpi_panel_solve_step(fit, true, work)) return LEDPI_DIVERGED;
        if (last) return LEDPI_FITTED;
        const int foreseen = round ? early_stop(fit, h, work) : LEDPI_FITTED;
        const double moved = ledpi_panel_take_step(fit, h, work);
        if (!(moved < 1e3)) return LEDPI_DIVERGED;
        const bool near = moved < NEAR && work->decrease < WEIGHED_SHARE;
        *settled = moved < asked->tolerance && work->decrease < SETTLED_SHARE && !fit->reweightings;
        if (*settled || foreseen != LEDPI_FITTED) return foreseen;
        if (near && fit->reweightings) {
            ledpi_panel_weigh_blocks(fit->panel.cells, work);
            fit->reweightings--;
            start.variance = INFINITY; /* it had other weights */
        }
    }
}

int ledpi_fit_panel(PanelFit *asked, uint8_t *room) {
    Work *const work = (Work *)room;
    const ptrdiff_t cells = asked->cells, blocks = cells * cells * BLOCKS * BLOCKS + 4 * cells;
    if (asked->lines > LEDPI_MOST_LINES || cells > MOST_CELLS) return LEDPI_DIVERGED;
    double h[9];
    Fitting fit = ledpi_panel_begun(asked, asked);
    for (ptrdiff_t b = 0; b < blocks; b++) work->weight[b] = 1.0;
    ledpi_panel_put_blocks(&fit, work);
    work->sampled = 0;
    const int outcome = iterate(&fit, h, &asked->settled, work);
    asked->sampled = work->sampled;
    if (outcome != LEDPI_FITTED) return outcome;
    if (asked->reweightings) { /* by a matrix of before the last step, and slopes of after it, cells would have leverages far above 1 */
        look(&fit, h, false, work);
        asked->sampled = work->sampled;
        if (!ledpi_panel_solve_step(&fit, false, work)) return LEDPI_DIVERGED;
    }
    ledpi_unit_square_homography(fit.corners, h);
    ledpi_panel_put_covariance(&fit, h, work);
    ledpi_panel_put_rim_variance(&fit, work, asked->rim_variance);
    ledpi_panel_put_lit(&fit, h, asked->hidden);
    asked->explained = fit.explained, asked->variance = fit.variance;
    if (asked->reweightings) ledpi_panel_put_jackknife(&fit, h, work, asked->jackknife);
    seen_through(fit.view.lens, fit.corners);
    seen_through(fit.view.lens, fit.lit);
    memcpy(asked->corners, fit.corners, sizeof asked->corners);
    memcpy(asked->lit, fit.lit, sizeof asked->lit);
    return LEDPI_FITTED;
}
