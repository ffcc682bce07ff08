/* The cells of a panel, and what each of their samples is explained by: a row of columns (columns.c). */
#ifndef LEDPI_CELLS_H
#define LEDPI_CELLS_H

#include <stdint.h>

#include "normal.h"

enum {
    SLOPES = 8, /* ways in which a homography can be wrong */
    MOST_COLUMNS = 16,
};

/* cells = side × side, points = k × k in each; `waves` parameters of bands to a cell. */
typedef struct {
    ptrdiff_t side, k, waves, cells, points, samples;
    const uint8_t *valid; /* (cells, points); NULL: all are */
    const float *along; /* (side·k,) */
} Panel;

/* A sample's columns: its cell's gain, then bands, then SLOPES, and last what is left to explain. */
static inline ptrdiff_t first_slope(const Panel *panel) { return 1 + panel->waves; }
static inline ptrdiff_t of_residual(const Panel *panel) { return 1 + panel->waves + SLOPES; }
static inline ptrdiff_t padded(ptrdiff_t count) { return (count + LEDPI_WIDTH - 1) / LEDPI_WIDTH * LEDPI_WIDTH; }
static inline ptrdiff_t width_of(const Panel *panel) { return padded(of_residual(panel) + 1); }

/* Unknowns in the order of the matrix: each cell's gain, SLOPES, then each cell's bands. */
static inline ptrdiff_t unknowns(const Panel *panel) { return panel->cells + SLOPES + panel->cells * panel->waves; }

/* The ways in which a homography can be wrong, of a place (u, v) in −1..1 where light changes so much across and down. */
static inline void put_slopes(float u, float v, float by_u, float by_v, float slopes[SLOPES]) {
    const float both = u * by_u + v * by_v;
    slopes[0] = by_u, slopes[1] = u * by_u, slopes[2] = v * by_u;
    slopes[3] = by_v, slopes[4] = u * by_v, slopes[5] = v * by_v;
    slopes[6] = u * both, slopes[7] = v * both;
}

/* How the logarithm of `picture` changes across the panel and down it, per unit of either: `across` and `down` (cells,
 * points). `room` (samples + 3·side·k) is to work in. */
void ledpi_slopes(const Panel *panel, const float *picture, float *room, float *across, float *down);

/* What each sample is explained by, all (cells, points): what a wrong gain adds, `weight`; what bands add for each of
 * `waves` (waves, cells, points), `bands`; how the picture changes; and what is left to explain, `residual`. */
typedef struct {
    const float *weight, *bands, *waves, *across, *down, *residual;
} Terms;

/* Puts each sample's columns (samples, width), and adds what those of each cell are among themselves to the matrix (size,
 * size + 1), the last column of which is the right side. To first order a homography can differ in SLOPES ways: by
 * 1, x, y in either direction, and by (x², xy) and (xy, y²). Returns the square of what is left to explain. */
double ledpi_add_cells(const Panel *panel, const Terms *terms, float *columns, double *matrix);

#endif
