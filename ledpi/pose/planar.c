/* The two poses that a square's corners allow, from pixels to the best of each: pose/planar.py, pose/corners.py. */
#include <math.h>

#include "core.h"
#include "pose.h"

/* A solution as numpy takes it. */
typedef struct {
    double position[3], quaternion[4], reprojection_px, chi2, covariance[36];
} Solution;

/* Both rotations and the position that a square's corners leave open, (x/z, y/z) in the marker's order; false where these
 * have no area. Infinitesimal plane-based pose estimation (Collins & Bartoli, IJCV 2014): the homography's value and slope at
 * the square's centre (Heckbert 1989) give the pose but for a sign. OpenCV's own loses rotations of half a turn. */
static bool ippe(double c[4][2], double side_m, Fit starts[2]) {
    double x0 = c[0][0], y0 = c[0][1], x1 = c[1][0], y1 = c[1][1], x2 = c[2][0], y2 = c[2][1], x3 = c[3][0], y3 = c[3][1];
    double d1x = x1 - x2, d1y = y1 - y2, d2x = x3 - x2, d2y = y3 - y2, sx = x0 - x1 + x2 - x3, sy = y0 - y1 + y2 - y3;
    double area = d1x * d2y - d1y * d2x;
    if (!(fabs(area) >= 1e-12)) return false;
    double g = (sx * d2y - sy * d2x) / area, h = (d1x * sy - d1y * sx) / area;
    double ax = x1 - x0 + g * x1, ay = y1 - y0 + g * y1, bx = x3 - x0 + h * x3, by = y3 - y0 + h * y3;
    double w = 1.0 + 0.5 * (g + h);
    if (!(w > 0)) return false;
    double qx = (0.5 * (ax + bx) + x0) / w, qy = (0.5 * (ay + by) + y0) / w, per_m = 1.0 / (w * side_m);
    double j00 = (ax - g * qx) * per_m, j10 = (ay - g * qy) * per_m, j01 = (h * qx - bx) * per_m, j11 = (h * qy - by) * per_m;
    /* The view is turned until the centre is straight ahead: V takes z there, and the slope becomes A = R₂₂/depth. */
    double n = sqrt(1.0 + qx * qx + qy * qy), a = qx / n, b = qy / n, z = 1.0 / n, k = 1.0 / (1.0 + z);
    double v00 = 1.0 - a * a * k, v01 = -a * b * k, v11 = 1.0 - b * b * k;
    double b00 = v00 + qx * a, b01 = v01 + qx * b, b10 = v01 + qy * a, b11 = v11 + qy * b, det = b00 * b11 - b01 * b10;
    double a00 = (b11 * j00 - b01 * j10) / det, a01 = (b11 * j01 - b01 * j11) / det;
    double a10 = (b00 * j10 - b10 * j00) / det, a11 = (b00 * j11 - b10 * j01) / det;
    /* The larger singular value of A is 1/depth; R's columns have length 1 and are square to each other. */
    double squares = a00 * a00 + a01 * a01 + a10 * a10 + a11 * a11, product = a00 * a11 - a01 * a10;
    double depth = 1.0 / sqrt(0.5 * (squares + sqrt(fmax(0.0, squares * squares - 4.0 * product * product))));
    double r00 = a00 * depth, r01 = a01 * depth, r10 = a10 * depth, r11 = a11 * depth;
    double r20 = sqrt(fmax(0.0, 1.0 - r00 * r00 - r10 * r10));
    double r21 = copysign(sqrt(fmax(0.0, 1.0 - r01 * r01 - r11 * r11)), -(r00 * r01 + r10 * r11));
    for (int i = 0; i < 2; i++) {
        double e = i ? -r20 : r20, f = i ? -r21 : r21;
        double nx = r10 * f - e * r11, ny = e * r01 - r00 * f, nz = r00 * r11 - r10 * r01;
        const double turn[9] = {v00 * r00 + v01 * r10 + a * e, v00 * r01 + v01 * r11 + a * f, v00 * nx + v01 * ny + a * nz,
                                v01 * r00 + v11 * r10 + b * e, v01 * r01 + v11 * r11 + b * f, v01 * nx + v11 * ny + b * nz,
                                z * e - a * r00 - b * r10,     z * f - a * r01 - b * r11,     z * nz - a * nx - b * ny};
        for (int j = 0; j < 9; j++) starts[i].rotation[j] = turn[j];
        starts[i].position[0] = qx * depth, starts[i].position[1] = qy * depth, starts[i].position[2] = depth;
    }
    return true;
}

/* Unit quaternion (w, x, y, z), w ≥ 0, by Shepperd's method: the largest part first. */
static void quaternion_of(const double r[9], double q[4]) {
    const double squares[4] = {1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8], 1 - r[0] + r[4] - r[8], 1 - r[0] - r[4] + r[8]};
    int largest = 0;
    for (int i = 1; i < 4; i++)
        if (squares[i] > squares[largest]) largest = i;
    double s = 2.0 * sqrt(squares[largest]), quarter = s / 4.0;
    double wx = (r[7] - r[5]) / s, wy = (r[2] - r[6]) / s, wz = (r[3] - r[1]) / s;
    double xy = (r[1] + r[3]) / s, xz = (r[2] + r[6]) / s, yz = (r[5] + r[7]) / s;
    const double rows[4][4] = {{quarter, wx, wy, wz}, {wx, quarter, xy, xz}, {wy, xy, quarter, yz}, {wz, xz, yz, quarter}};
    const double *row = rows[largest];
    double length = copysign(sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2] + row[3] * row[3]), row[0]);
    for (int i = 0; i < 4; i++) q[i] = row[i] / length;
}

/* Poses of `count` squares with `sides_m` (count,), seen at `corners_px` (count, 4, 2), whose errors `whiteners` (count, 8, 8) make
 * independent: two `solutions` each (count, 2), and whether there are any (count,). */
void ledpi_solve_squares(const double *lens_numbers, const double *stop, ptrdiff_t count, const double *corners_px,
                         const double *whiteners, const double *sides_m, double *numbers, uint8_t *solved) {
    const Lens *lens = (const Lens *)lens_numbers;
    Solution *solutions = (Solution *)numbers;
    for (ptrdiff_t i = 0; i < count; i++, corners_px += 8, whiteners += 64, solutions += 2) {
        double rays[4][2], off_px[16], trial_px[8], half = 0.5 * sides_m[i];
        const double place[12] = {-half, half, 0, half, half, 0, half, -half, 0, -half, -half, 0};
        const Body body = {4, place, corners_px, whiteners};
        Fit fits[2];
        for (int k = 0; k < 4; k++) ledpi_ray_of(lens, corners_px + 2 * k, rays[k]);
        solved[i] = ippe(rays, sides_m[i], fits);
        if (!solved[i]) continue;
        ledpi_fit(&body, lens, 2, (const Stop *)stop, fits, off_px, trial_px);
        for (int k = 0; k < 2; k++) {
            double squares = 0.0;
            for (int j = 0; j < 8; j++) squares += off_px[8 * k + j] * off_px[8 * k + j];
            for (int j = 0; j < 3; j++) solutions[k].position[j] = fits[k].position[j];
            quaternion_of(fits[k].rotation, solutions[k].quaternion);
            solutions[k].reprojection_px = sqrt(squares / 4);
            solutions[k].chi2 = fits[k].chi2;
            for (int j = 0; j < 36; j++) solutions[k].covariance[j] = fits[k].covariance[j];
        }
    }
}
