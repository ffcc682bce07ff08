/* A panel's corners as a fit has them: the lattice's, those of what is lit, and their covariance. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "panel_fit.h"

/* In cells: further within than another side's, light ends at what hides the rest; two deviations of RIM_SIGMA of prior.py. */
static const double HIDDEN = 0.06;
#define MOST_MOVE 0.1 /* half sides, in a round: as far as the slopes hold */
#define LEAST_GAIN 0.2 /* share of a template's light: what moves a panel is divided by no less */

void ledpi_panel_move(const double h[9], const double *ways, const double low[2], const double high[2], Point corners[4]) {
    const double ends[4][2] = {{low[0], low[1]}, {high[0], low[1]}, {high[0], high[1]}, {low[0], high[1]}};
    for (int i = 0; i < 4; i++) {
        const double p = ends[i][0], q = ends[i][1], both = ways[6] * p + ways[7] * q;
        const double u = 0.5 * (p - ways[0] - ways[1] * p - ways[2] * q - p * both + 1.0);
        const double v = 0.5 * (q - ways[3] - ways[4] * p - ways[5] * q - q * both + 1.0);
        const double w = h[6] * u + h[7] * v + h[8];
        corners[i] = (Point){(h[0] * u + h[1] * v + h[2]) / w, (h[3] * u + h[4] * v + h[5]) / w};
    }
}

double ledpi_panel_compose(const double h[9], const double *ways, double gain, Point corners[4]) {
    double moved[WAYS], most = 0.0;
    for (int k = 0; k < WAYS; k++) most = fmax(most, fabs(moved[k] = ways[k] / fmax(gain, LEAST_GAIN)));
    const double share = fmin(1.0, MOST_MOVE / most);
    for (int k = 0; k < WAYS; k++) moved[k] *= share;
    ledpi_panel_move(h, moved, (double[]){-1.0, -1.0}, (double[]){1.0, 1.0}, corners);
    return most;
}

/* Which side's rim says how far within the lattice's end each side (4) ends: its own; where something hides it the second
 * least. All are built alike; no more than two are hidden. */
static void put_ends(const double rim[4], int of[4]) {
    double sorted[4] = {rim[0], rim[1], rim[2], rim[3]};
    qsort(sorted, 4, sizeof *sorted, ledpi_ascending);
    int usual = 0;
    while (rim[usual] != sorted[1] && usual < 3) usual++; /* there is none where one is no number */
    for (int k = 0; k < 4; k++) of[k] = rim[k] > sorted[1] + HIDDEN ? usual : k;
}

/* The same of what is lit, which ends within the lattice's end by the rim (4): left, right, above, below, in cells; each side
 * by the rim `of` one of them. */
static void move_lit(const double h[9], const double *ways, const double *rim, const int of[4], ptrdiff_t cells, Point corners[4]) {
    const double share = 2.0 / (double)cells;
    ledpi_panel_move(h, ways, (double[]){share * rim[of[0]] - 1.0, share * rim[of[2]] - 1.0},
         (double[]){1.0 - share * rim[of[1]], 1.0 - share * rim[of[3]]}, corners);
}

void ledpi_panel_put_lit(Fitting *fit, const double h[9], double hidden[4]) {
    const double *const rim = fit->unknown + RIM;
    int of[4];
    put_ends(rim, of);
    move_lit(h, (double[WAYS]){0.0}, rim, of, fit->panel.cells, fit->lit);
    for (int k = 0; k < 4; k++) hidden[k] = of[k] == k ? 0.0 : rim[k];
}

/* Each unknown takes one block's mean up. */
double ledpi_panel_inflation(const Fitting *fit, const Work *work) {
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

void ledpi_panel_eliminate_right(const Fitting *fit, const double *matrix, double right[COMMON]) {
    const ptrdiff_t size = fit->size;
    for (ptrdiff_t k = 0; k < COMMON; k++) {
        const double *row = matrix + (fit->owns + k) * (size + 1) + fit->owns;
        for (ptrdiff_t i = k + 1; i < COMMON; i++) right[i] -= row[i] / row[k] * right[k];
    }
}

void ledpi_panel_put_slopes(const Fitting *fit, const double h[9], double by[8][COMMON]) {
    const ptrdiff_t cells = fit->panel.cells;
    const double little = 1e-4, none[WAYS] = {0.0}, *rim = fit->unknown + RIM;
    int of[4]; /* as they are: where another side is taken for hidden, corners jump, which is no slope */
    Point here[4], moved[4];
    memset(by, 0, 8 * sizeof *by);
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
    for (int i = 0; fit->view.lens && i < 4; i++) { /* so far by rays, from here on by pixels */
        double seen[2], by_ray[2][2];
        ledpi_distort(fit->view.lens, here[i].x, here[i].y, seen, by_ray);
        for (int k = 0; k < COMMON; k++) {
            const double x = by[2 * i][k], y = by[2 * i + 1][k];
            by[2 * i][k] = by_ray[0][0] * x + by_ray[0][1] * y;
            by[2 * i + 1][k] = by_ray[1][0] * x + by_ray[1][1] * y;
        }
    }
}

void ledpi_panel_put_covariance(Fitting *fit, const double h[9], Work *work) {
    const double scale = ledpi_panel_inflation(fit, work) / fit->inflation;
    double by[8][COMMON];
    ledpi_panel_put_slopes(fit, h, by);
    for (int i = 0; i < 8; i++) ledpi_panel_eliminate_right(fit, work->matrix, by[i]);
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 8; j++) {
            double sum = 0.0;
            for (ptrdiff_t k = 0; k < COMMON; k++) sum += by[i][k] * by[j][k] / work->matrix[(fit->owns + k) * (fit->size + 2)];
            fit->covariance[8 * i + j] = scale * sum;
        }
}

void ledpi_panel_put_rim_variance(const Fitting *fit, const Work *work, double variance[4]) {
    const double scale = ledpi_panel_inflation(fit, work) / fit->inflation;
    for (int side = 0; side < 4; side++) {
        double by[COMMON] = {0.0};
        by[RIM + side] = 1.0, variance[side] = 0.0;
        ledpi_panel_eliminate_right(fit, work->matrix, by);
        for (ptrdiff_t k = 0; k < COMMON; k++) variance[side] += scale * by[k] * by[k] / work->matrix[(fit->owns + k) * (fit->size + 2)];
    }
}
