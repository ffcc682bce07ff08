/* The picture of a panel: what the files panel_*.c share. docs/algorithm.md has the equation. */
#ifndef LEDPI_PANEL_H
#define LEDPI_PANEL_H

#include <math.h>
#include "core.h"
#include "kernels.h"
#include "normal.h"
#include "lens.h"
#include "unknowns.h"

enum {
    RESIDUAL = COMMON, DENSE = 40, /* columns of a sample: COMMON, its residual, and what pads them */
    MOST_CELLS = LEDPI_MOST_SIDE, MOST_ROWS = 512,
    MOST_OWN = OWN * MOST_CELLS * MOST_CELLS, MOST_UNKNOWN = COMMON + MOST_OWN,
};

#define NO_LIGHT 1e-3f /* × a cell's own: less is none */

/* Light (rows, columns) of a part of the picture, each of `shrink` pixels a side, the first one's centre at `first`. */
typedef struct {
    const float *light;
    ptrdiff_t rows, columns;
    double first_x, first_y, shrink, saturated, focal[2], centre[2];
    const Lens *lens; /* NULL: there is none */
    bool cubic; /* light between pixels is interpolated by cubics, not by straight lines */
} View;

typedef struct {
    ptrdiff_t cells;
    const float *waves; /* (2, WAVE_STEPS): either class's wave as the exposure leaves it, less its mean, over its mean */
    double cycles_a_row[2], sight[2], scale, dark; /* the fit's light is (what is seen − dark)·scale */
} Panel;

/* A line of the grid: the light there of the two nearest cells, and how it changes with place, blur, gap and the rim before
 * the first cell and after the last; the profile's harmonics, even and odd, and their slopes; what is before the first cell
 * and after the last. Of one line, and of eight side by side. */
#define LINE(number) \
    number light[2], slope[2], blurred[2], gapped[2], rimmed[2][2], harmonic[2][HARMONICS + 1], steep[2][HARMONICS + 1], \
        shifted[2], glowing[2], by_smear, odd[2], odd_steep[2], beside[2], falls[2], spread[2]
typedef struct {
    LINE(float);
    int32_t cell[2]; /* −1: there is none, and no light */
} Line;
typedef struct {
    LINE(Floats);
    Floats at; /* 0..1 across the panel */
    int32_t cell[2][LEDPI_WIDTH];
    bool is_between, is_beside; /* the second cells count, and what is before and after */
} Lines;

/* A class's wave in a row, of a phase in row 0, in cycles; and its slope by phase. */
static inline float ledpi_panel_wave(const Panel *panel, ptrdiff_t k, float phase, float row, float *later) {
    const float *table = panel->waves + k * WAVE_STEPS;
    const float cycles = phase + row * (float)panel->cycles_a_row[k];
    const float at = (cycles - floorf(cycles)) * WAVE_STEPS;
    const int32_t step = (int32_t)at;
    const float here = table[step & (WAVE_STEPS - 1)], rise = table[(step + 1) & (WAVE_STEPS - 1)] - here;
    *later = rise * WAVE_STEPS;
    return here + (at - (float)step) * rise;
}

/* The model at eight places: the slopes of what is predicted by COMMON, and the residual, all weighted; by the OWN
 * of the cells that meet there (the nearest down and across, then the next), not weighted. */
typedef struct {
    Floats by[DENSE], own[2][2][OWN], seen, predicted, weight, row, outside; /* row of the picture; share beside the panel */
    bool valid[LEDPI_WIDTH]; /* within the view and not saturated */
} Samples;

/* The harmonics, across and down, of each of the SHAPES: as many LEDs along a cell make spots. */
static const int8_t LEDPI_SHAPE[SHAPES][2] = {{1, 0}, {0, 1}, {2, 0}, {0, 2}, {3, 0}, {0, 3}, {4, 0},
                                              {0, 4}, {1, 1}, {2, 1}, {1, 2}, {2, 2}, {3, 3}};

/* The profile along a line down, for each of its cells: factors of the harmonics across, and their slopes down. */
typedef struct {
    float by[2][HARMONICS + 1], steep[2][HARMONICS + 1];
} Profile;

Profile ledpi_panel_profile(const float *unknown, const Line *down);

/* Along one direction, in cells: the gap between cells, how far light ends within the lattice at either end; how far walls stand
 * before the diffuser, how much their faces glow beside it, and how far aside lines of sight go for each step inwards. */
typedef struct {
    double gap, rim[2], depth, glow, sight;
} Walls;

/* Across a line, in cells; and how its logarithm changes with that of the picture's blur along rows over that along columns. */
typedef struct {
    double sigma, by_smear;
} Blur;

/* The line at `at`, in cells from the panel's first side (panel_light.c). */
Line ledpi_panel_line(double at, ptrdiff_t cells, Blur blur, const Walls *walls);

/* Puts lines side by side; the last one repeats where they are fewer than eight (panel_light.c). */
void ledpi_panel_lines(const Line *lines, const double *along, ptrdiff_t count, ptrdiff_t cells, Lines *out);

/* The samples where eight lines across meet one down, at v (0..1), by homography h and the unknowns; `profile` is that of the
 * one down (panel_light.c). */
void ledpi_panel_sample(const Panel *panel, const View *view, const float *h, const float *unknown, const Profile *profile,
                        const Lines *across, const Line *down, float v, Samples *out);

/* Samples at eight places u, v of the panel (0..1): `seen`, `row` and `valid` (panel_light.c). */
void ledpi_panel_look(const Panel *panel, const View *view, const float *h, const float *u, float v, Samples *out);

/* Squares of the light that bands explain, and that they should. */
typedef struct {
    double seen, expected;
} Bands;

/* The phases (2,) in row 0 that explain most where each cell may show any mix of both waves: `squares` and `products` (cells²,
 * rows) of a steady cell's light, with itself and with what is seen, by row of the view; `ridge`, a sample's variance over
 * that of a cell's mix (panel_phases.c). What is expected is what either class's wave, whichever shows less, would explain in
 * each cell. */
Bands ledpi_panel_phases(const Panel *panel, const View *view, ptrdiff_t rows, const float *squares, const float *products,
                         float ridge, double phases[2]);

/* Corners of a square that reaches from `low` to `high`, (across, down) each, in −1..1, once the homography has been wrong by
 * these WAYS (panel_corners.c). */
void ledpi_panel_move(const double h[9], const double *ways, const double low[2], const double high[2], Point corners[4]);

/* Moves a square by the inverse of what its template would (inverse composition): by `ways` over the `gain` of its light, but only
 * as far as slopes hold. Returns by how much of half its side it should (panel_corners.c). */
double ledpi_panel_compose(const double h[9], const double *ways, double gain, Point corners[4]);

#endif
