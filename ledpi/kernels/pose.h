/* What the poses' loops share. */
#ifndef LEDPI_POSE_H
#define LEDPI_POSE_H

#include <stdbool.h>
#include <stddef.h>

enum { MOST_STARTS = 2 };

/* As `Intrinsics`, for each of its models: coefficients that a model lacks are 0. Rays of a larger r² than `most_r2` are not
 * seen: there the picture would fold. */
typedef struct {
    double fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, equidistant, most_r2;
} Lens;

/* Points of a body and where they are seen, four at a time with what makes their errors independent. */
typedef struct {
    ptrdiff_t points; /* a multiple of 4 */
    const double *place, *seen_px, *whiteners; /* (points, 3), (points, 2), (points/4, 8, 8) */
} Body;

typedef struct {
    double rotation[9], position[3], chi2, covariance[36];
} Fit;

/* The pixel of a point in the camera's frame, and its derivative by the point (lens.c). */
void ledpi_project(const Lens *lens, const double at[3], double pixel[2], double slope[2][3]);

/* The pixel of a ray (x/z, y/z) with its derivative by the ray, and the ray of a pixel; not a number where there is none (lens.c). */
void ledpi_distort(const Lens *lens, double x, double y, double pixel[2], double by[2][2]);
void ledpi_ray_of(const Lens *lens, const double pixel[2], double ray[2]);

/* When to stop: after so many rounds, where a step would change nothing, and what is beaten by so much of χ². Constants of
 * pose/refine.py. */
typedef struct {
    double rounds, converged, beaten_by;
} Stop;

/* Refines the poses that one body starts from: `starts` of them, at most MOST_STARTS. Those that are beaten by far are not
 * followed to their ends. `off_px` (starts, points, 2) of the residuals; `trial_px` (points, 2) is room to try in. */
void ledpi_fit(const Body *body, const Lens *lens, int starts, const Stop *stop, Fit *fits, double *off_px, double *trial_px);

#endif
