/* What the loops for a panel's lattice share: adjust.c, inner_lines.c. */
#ifndef LEDPI_LATTICE_H
#define LEDPI_LATTICE_H

#include "kernels.h"
#include "pose.h"

enum { MOST_CELLS = 8, MOST_INNER = 2 * MOST_CELLS * (MOST_CELLS - 1), MOVES = 8 };

#define NOT_SEEN_PX2 1e4 /* variance of what is not measured */

/* (u, v) of the unit square → where it is seen, and its derivatives by u and by v. */
typedef struct {
    double h[9];
} Homography;

static inline void ledpi_seen(const Homography *homography, double u, double v, Point *at, Point *by_u, Point *by_v) {
    const double *h = homography->h, across = 1.0 / (h[6] * u + h[7] * v + 1.0);
    *at = (Point){(h[0] * u + h[1] * v + h[2]) * across, (h[3] * u + h[4] * v + h[5]) * across};
    *by_u = (Point){(h[0] - h[6] * at->x) * across, (h[3] - h[6] * at->y) * across};
    *by_v = (Point){(h[1] - h[7] * at->x) * across, (h[4] - h[7] * at->y) * across};
}

/* Place i of the `line_places` of decode/corners/inner_lines.py. */
void ledpi_line_place(ptrdiff_t i, ptrdiff_t cells, double *u, double *v);

/* How far each of these is off, and its variance; `moves` are what the lens does to them, all in pixels. */
void ledpi_inner_lines(const Picture *picture, const Homography *homography, const double pitch_px[2], const Point *moves,
                       ptrdiff_t cells, double *off, double *variance);

/* ---- adjust.c */

/* Cholesky's L of a symmetric matrix (size, size), in its lower part; L⁻¹ and its transpose of a vector, in place. */
void ledpi_factor(double *matrix, int size);
void ledpi_forward(const double *lower, int size, double *vector);
void ledpi_backward(const double *lower, int size, double *vector);

/* How the eight small changes of a homography move a place along u, and along v. */
void ledpi_moves_at(double u, double v, double by_u[MOVES], double by_v[MOVES]);

/* The same across a line that is crossed by u, or by v, in pixels; returns pixels across it, by a unit of u or v. */
double ledpi_measure_at(const Homography *homography, double u, double v, bool along_u, double slopes[MOVES]);

/* `lens_moves` of decode/corners/inner_lines.py; none without a lens. */
void ledpi_lens_moves(const Lens *lens, const Homography *homography, const Point corners[4], ptrdiff_t cells,
                      Point *moves);

#endif
