/* Shared by the loops of poses. */
#ifndef LEDPI_POSE_H
#define LEDPI_POSE_H

#include "lens.h"

enum { MOST_STARTS = 2 };

/* Points of a body and where they are seen, four at a time with what makes their errors independent. */
typedef struct {
    ptrdiff_t points; /* a multiple of 4 */
    const double *place, *seen_px, *whiteners; /* (points, 3), (points, 2), (points/4, 8, 8) */
} Body;

typedef struct {
    double rotation[9], position[3], chi2, covariance[36];
} Fit;

/* When to stop: after so many rounds, where a step would change nothing, and what is beaten by so much of χ². Constants of
 * pose/refine.py. */
typedef struct {
    double rounds, converged, beaten_by;
} Stop;

/* Refines the poses that one body starts from: `starts` of them, at most MOST_STARTS. Those that are beaten by far are not
 * followed to their ends. `off_px` (starts, points, 2) of the residuals; `trial_px` (points, 2) is room to try in. */
void ledpi_fit(const Body *body, const Lens *lens, int starts, const Stop *stop, Fit *fits, double *off_px, double *trial_px);

#endif
