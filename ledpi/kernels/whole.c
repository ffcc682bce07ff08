/* Light along quads, and what is left of it once it is explained by cells: decode/whole.py. */
#include <math.h>

#include "kernels.h"

enum { ALONG = 40 };
#define ACROSS_FIRST 0.3 /* of a cell: where the light along the quad is taken, and averaged */
#define ACROSS_SECOND 0.7

/* Light (2, ALONG) from left to right and from top to bottom of a quad, its mean 1. `bends` (4, 2, 2) of its sides, along
 * and inward; `cubics` (2, ALONG) how much of either moves each place. */
static void light_along(const Picture *picture, const Point corners[4], const double *bends, const double *cubics,
                        ptrdiff_t cells, double *light) {
    double h[9];
    ledpi_unit_square_to(corners, h);
    for (int axis = 0; axis < 2; axis++) {
        double *into = light + axis * ALONG, sum = 0.0;
        double length = hypot(corners[axis + 1].x - corners[axis].x, corners[axis + 1].y - corners[axis].y);
        const double *onward = bends + 4 * axis, *back = bends + 4 * (axis + 2); /* that side runs the other way */
        double first = 0.5 * (onward[0] - back[2]) / length, second = 0.5 * (onward[2] - back[0]) / length;
        for (int i = 0; i < ALONG; i++) {
            double along = (i + 0.5) / ALONG + first * cubics[i] + second * cubics[ALONG + i], total = 0.0;
            for (ptrdiff_t line = 0; line < 2 * cells; line++) {
                double across = ((double)(line / 2) + (line % 2 ? ACROSS_SECOND : ACROSS_FIRST)) / (double)cells;
                double u = axis ? across : along, v = axis ? along : across, w = h[6] * u + h[7] * v + h[8];
                total += ledpi_light_between(picture, (float)((h[0] * u + h[1] * v + h[2]) / w),
                                             (float)((h[3] * u + h[4] * v + h[5]) / w));
            }
            into[i] = total / (2.0 * (double)cells);
            sum += into[i];
        }
        for (int i = 0; i < ALONG; i++) into[i] /= fmax(sum / ALONG, 1e-6);
    }
}

/* `light` (quads, 2, ALONG) along quads with `corners` (quads, 4, 2); and of each how long its sides are, and how far the
 * lens bends them inward, at most, in pixels: `sizes` (quads, 2). */
void ledpi_light_along(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                       ptrdiff_t cells, ptrdiff_t quads, const Point *corners, const double *bends, const double *cubics,
                       double *light, double *sizes) {
    const Picture picture = {pixels, height, width, stride, table};
    for (ptrdiff_t i = 0; i < quads; i++) {
        light_along(&picture, corners + 4 * i, bends + 16 * i, cubics, cells, light + 2 * ALONG * i);
        sizes[2 * i] = sqrt(fabs(ledpi_area(corners + 4 * i)));
        sizes[2 * i + 1] = 0.0;
        for (int j = 1; j < 16; j += 2) sizes[2 * i + 1] = fmax(sizes[2 * i + 1], fabs(bends[16 * i + j]));
    }
}

/* Mean square that an orthonormal basis (columns, ALONG) leaves of `light`, of which `all` is the sum of squares. */
static double unexplained(const double *light, double all, const double *basis, ptrdiff_t columns, double places) {
    for (ptrdiff_t c = 0; c < columns; c++) {
        double product = 0.0;
        for (int i = 0; i < ALONG; i++) product += light[i] * basis[c * ALONG + i];
        all -= product * product;
    }
    return fmax(all, 1e-9) / places;
}

/* What each of `explanations` leaves (2, explanations) of `light` (2, ALONG), both ways. `bases` (columns, ALONG), those
 * of explanation e from column first[e] to first[e + 1]; `counted` (ALONG,) is 0 where light does not count. An axis of
 * which the explanation `whole` leaves no more than `little` is left out. Returns 1 and 2, added, for those that are not. */
int ledpi_unexplained(const double *light, const double *bases, const ptrdiff_t *first, ptrdiff_t explanations,
                      const double *counted, ptrdiff_t whole, double little, double *left) {
    int axes = 0;
    double places = 0.0;
    for (int i = 0; i < ALONG; i++) places += counted[i];
    for (int axis = 0; axis < 2; axis++, light += ALONG, left += explanations) {
        double all = 0.0;
        for (int i = 0; i < ALONG; i++) all += light[i] * light[i] * counted[i];
        if (!(unexplained(light, all, bases + first[whole] * ALONG, first[whole + 1] - first[whole], places) > little))
            continue;
        for (ptrdiff_t e = 0; e < explanations; e++)
            left[e] = unexplained(light, all, bases + first[e] * ALONG, first[e + 1] - first[e], places);
        axes |= 1 << axis;
    }
    return axes;
}
