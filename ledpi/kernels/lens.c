/* Between rays and pixels: OpenCV's model of a lens, radial k1 k2 k3 and tangential p1 p2. */

#include "core.h"
#include "pose.h"

#define ROUNDS 4

void ledpi_distort(const Lens *lens, double x, double y, double pixel[2]) {
    double r2 = x * x + y * y, xy = x * y, radial = 1.0 + r2 * (lens->k1 + r2 * (lens->k2 + r2 * lens->k3));
    pixel[0] = lens->fx * (x * radial + 2.0 * lens->p1 * xy + lens->p2 * (r2 + 2.0 * x * x)) + lens->cx;
    pixel[1] = lens->fy * (y * radial + lens->p1 * (r2 + 2.0 * y * y) + 2.0 * lens->p2 * xy) + lens->cy;
}

void ledpi_project(const Lens *lens, const double at[3], double pixel[2], double slope[2][3]) {
    double depth = at[2] != 0.0 ? 1.0 / at[2] : 1.0, x = at[0] * depth, y = at[1] * depth, r2 = x * x + y * y, xy = x * y;
    double radial = 1.0 + r2 * (lens->k1 + r2 * (lens->k2 + r2 * lens->k3));
    double steep = 2.0 * (lens->k1 + r2 * (2.0 * lens->k2 + r2 * 3.0 * lens->k3)); /* d radial / dx = steep · x */
    double both = steep * xy + 2.0 * (lens->p1 * x + lens->p2 * y); /* the same both ways */
    double xx = radial + steep * x * x + 2.0 * lens->p1 * y + 6.0 * lens->p2 * x;
    double yy = radial + steep * y * y + 6.0 * lens->p1 * y + 2.0 * lens->p2 * x;
    double fx = lens->fx * depth, fy = lens->fy * depth;
    ledpi_distort(lens, x, y, pixel);
    slope[0][0] = fx * xx, slope[0][1] = fx * both, slope[0][2] = -fx * (xx * x + both * y);
    slope[1][0] = fy * both, slope[1][1] = fy * yy, slope[1][2] = -fy * (both * x + yy * y);
}

void ledpi_ray_of(const Lens *lens, const double pixel[2], double ray[2]) {
    double at[3] = {(pixel[0] - lens->cx) / lens->fx, (pixel[1] - lens->cy) / lens->fy, 1.0};
    for (int round = 0; round < ROUNDS; round++) {
        double seen[2], slope[2][3];
        ledpi_project(lens, at, seen, slope);
        double ex = seen[0] - pixel[0], ey = seen[1] - pixel[1];
        double determinant = slope[0][0] * slope[1][1] - slope[0][1] * slope[1][0];
        at[0] -= (slope[1][1] * ex - slope[0][1] * ey) / determinant;
        at[1] -= (slope[0][0] * ey - slope[1][0] * ex) / determinant;
    }
    ray[0] = at[0], ray[1] = at[1];
}
