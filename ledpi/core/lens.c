/* Between rays and pixels: OpenCV's models of a lens, and the one place that knows them.
 *
 * A ray (x/z, y/z) = (x, y) of r² = x² + y² is seen at f·(x·L + tangential + thin prism) + c, where L lengthens it:
 * (1 + k1 r² + k2 r⁴ + k3 r⁶) / (1 + k4 r² + k5 r⁴ + k6 r⁶), or for an equidistant lens (Kannala and Brandt 2006, cv2.fisheye)
 * θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) / r with θ = atan r. */
#include <math.h>

#include "core.h"
#include "lens.h"

enum { ROUNDS_ALONG = 60, ROUNDS = 5 }; /* along the radius, bracketed: 5 are usual; then by Newton */
#define SEEN_AGAIN_PX 1e-3 /* a ray is that of a pixel if it is seen so near it */

/* L, and its slope by r². */
static double lengthening(const Lens *l, double r2, double *slope) {
    if (l->equidistant != 0.0) {
        const double r = sqrt(r2), t = atan(r), t2 = t * t;
        const double bent = t * (1.0 + t2 * (l->k1 + t2 * (l->k2 + t2 * (l->k3 + t2 * l->k4))));
        const double by_r = (1.0 + t2 * (3.0 * l->k1 + t2 * (5.0 * l->k2 + t2 * (7.0 * l->k3 + t2 * 9.0 * l->k4)))) / (1.0 + r2);
        *slope = r2 > 1e-8 ? (by_r - bent / r) / (2.0 * r2) : l->k1 - 1.0 / 3.0;
        return r2 > 1e-8 ? bent / r : 1.0 + *slope * r2;
    }
    const double over = 1.0 / (1.0 + r2 * (l->k4 + r2 * (l->k5 + r2 * l->k6)));
    const double length = (1.0 + r2 * (l->k1 + r2 * (l->k2 + r2 * l->k3))) * over;
    *slope = (l->k1 + r2 * (2.0 * l->k2 + r2 * 3.0 * l->k3) - length * (l->k4 + r2 * (2.0 * l->k5 + r2 * 3.0 * l->k6))) * over;
    return length;
}

/* The pixel of a ray, and its derivative by the ray. */
static void bend(const Lens *l, double x, double y, double pixel[2], double by[2][2]) {
    const double r2 = x * x + y * y, xy = x * y;
    double slope;
    const double length = lengthening(l, r2, &slope), steep = 2.0 * slope; /* dL/dx = steep · x */
    const double both = steep * xy + 2.0 * (l->p1 * x + l->p2 * y);
    const double right = 2.0 * (l->s1 + 2.0 * l->s2 * r2), down = 2.0 * (l->s3 + 2.0 * l->s4 * r2);
    pixel[0] = l->fx * (x * length + 2.0 * l->p1 * xy + l->p2 * (r2 + 2.0 * x * x) + r2 * (l->s1 + l->s2 * r2)) + l->cx;
    pixel[1] = l->fy * (y * length + l->p1 * (r2 + 2.0 * y * y) + 2.0 * l->p2 * xy + r2 * (l->s3 + l->s4 * r2)) + l->cy;
    by[0][0] = l->fx * (length + steep * x * x + 2.0 * l->p1 * y + 6.0 * l->p2 * x + right * x);
    by[0][1] = l->fx * (both + right * y);
    by[1][0] = l->fy * (both + down * x);
    by[1][1] = l->fy * (length + steep * y * y + 6.0 * l->p1 * y + 2.0 * l->p2 * x + down * y);
}

void ledpi_distort(const Lens *lens, double x, double y, double pixel[2], double by[2][2]) {
    bend(lens, x, y, pixel, by);
    if (x * x + y * y > lens->most_r2) pixel[0] = pixel[1] = NAN;
}

void ledpi_project(const Lens *lens, const double at[3], double pixel[2], double slope[2][3]) {
    const double depth = at[2] != 0.0 ? 1.0 / at[2] : 1.0, x = at[0] * depth, y = at[1] * depth;
    double by[2][2];
    ledpi_distort(lens, x, y, pixel, by);
    for (int i = 0; i < 2; i++) {
        slope[i][0] = depth * by[i][0], slope[i][1] = depth * by[i][1];
        slope[i][2] = -depth * (by[i][0] * x + by[i][1] * y);
    }
}

/* How far from the axis (tan θ) something is that is seen `away` from there, in focal lengths, if L alone bends it. */
static double radius_seen_at(const Lens *lens, double away) {
    double low = 0.0, high = sqrt(lens->most_r2);
    double r = lens->equidistant != 0.0 ? tan(fmin(away, 1.5)) : away;
    r = fmin(r, high);
    for (int round = 0; round < ROUNDS_ALONG; round++) {
        double slope;
        const double length = lengthening(lens, r * r, &slope), off = r * length - away;
        if (off > 0.0) high = r;
        else low = r;
        double next = r - off / (length + 2.0 * r * r * slope);
        if (!(next >= low && next <= high)) next = 0.5 * (low + high);
        if (fabs(next - r) <= 1e-12 * (1.0 + r)) return next;
        r = next;
    }
    return r;
}

void ledpi_ray_of(const Lens *lens, const double pixel[2], double ray[2]) {
    const double x0 = (pixel[0] - lens->cx) / lens->fx, y0 = (pixel[1] - lens->cy) / lens->fy, away = sqrt(x0 * x0 + y0 * y0);
    const double share = away > 0.0 ? radius_seen_at(lens, away) / away : 1.0;
    double x = share * x0, y = share * y0, seen[2], by[2][2];
    for (int round = 0; round < ROUNDS; round++) {
        bend(lens, x, y, seen, by);
        const double ex = seen[0] - pixel[0], ey = seen[1] - pixel[1];
        const double determinant = by[0][0] * by[1][1] - by[0][1] * by[1][0];
        x -= (by[1][1] * ex - by[0][1] * ey) / determinant;
        y -= (by[0][0] * ey - by[1][0] * ex) / determinant;
        const double within = sqrt(lens->most_r2 / (x * x + y * y));
        if (within < 1.0) x *= within, y *= within;
    }
    bend(lens, x, y, seen, by);
    const bool is_seen = fabs(seen[0] - pixel[0]) + fabs(seen[1] - pixel[1]) < SEEN_AGAIN_PX;
    ray[0] = is_seen ? x : NAN, ray[1] = is_seen ? y : NAN;
}

/* Pixels (count, 2) of points (count, 3) in the camera's frame, and their derivatives (count, 2, 3) by the point. */
void ledpi_project_points(const double *lens, ptrdiff_t count, const double *points, double *pixels, double *slopes) {
    for (ptrdiff_t i = 0; i < count; i++)
        ledpi_project((const Lens *)lens, points + 3 * i, pixels + 2 * i, (double(*)[3])(slopes + 6 * i));
}

/* Pixels (count, 2) of rays (count, 2), and the other way round; not a number where there is none. */
void ledpi_distort_rays(const double *lens, ptrdiff_t count, const double *rays, double *pixels) {
    double by[2][2];
    for (ptrdiff_t i = 0; i < 2 * count; i += 2) ledpi_distort((const Lens *)lens, rays[i], rays[i + 1], pixels + i, by);
}

void ledpi_undistort_pixels(const double *lens, ptrdiff_t count, const double *pixels, double *rays) {
    for (ptrdiff_t i = 0; i < 2 * count; i += 2) ledpi_ray_of((const Lens *)lens, pixels + i, rays + i);
}
