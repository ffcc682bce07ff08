/* The homography of a square, by its corners. */
#include "kernels.h"

void ledpi_unit_square_homography(const Point c[4], double h[9]) {
    double dx1 = c[1].x - c[2].x, dx2 = c[3].x - c[2].x, dx3 = c[0].x - c[1].x + c[2].x - c[3].x;
    double dy1 = c[1].y - c[2].y, dy2 = c[3].y - c[2].y, dy3 = c[0].y - c[1].y + c[2].y - c[3].y;
    double det = dx1 * dy2 - dx2 * dy1;
    if (det == 0.0) det = NAN;
    double g = (dx3 * dy2 - dx2 * dy3) / det, k = (dx1 * dy3 - dx3 * dy1) / det;
    const double all[9] = {c[1].x - c[0].x + g * c[1].x, c[3].x - c[0].x + k * c[3].x, c[0].x,
                           c[1].y - c[0].y + g * c[1].y, c[3].y - c[0].y + k * c[3].y, c[0].y, g, k, 1.0};
    for (int i = 0; i < 9; i++) h[i] = all[i];
}
