/* A lens and its projections (lens.c). */
#ifndef LEDPI_LENS_H
#define LEDPI_LENS_H

#include <stddef.h>

/* As `Intrinsics`, for each of its models: coefficients that a model lacks are 0. Rays of a larger r² than `most_r2` are not
 * seen: there the picture would fold. */
typedef struct {
    double fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, equidistant, most_r2;
} Lens;

/* The pixel of a point in the camera's frame, and its derivative by the point. */
void ledpi_project(const Lens *lens, const double at[3], double pixel[2], double slope[2][3]);

/* The pixel of a ray (x/z, y/z) with its derivative by the ray, and the ray of a pixel; not a number where there is none. */
void ledpi_distort(const Lens *lens, double x, double y, double pixel[2], double by[2][2]);
void ledpi_ray_of(const Lens *lens, const double pixel[2], double ray[2]);

#endif
