/* Where the light around places has its middle, and how much of what is around is lit: `_centres` of decode/corners/spot_centres.py. */
#include <math.h>

#include "kernels.h"

/* What is within `reach` of a place, as whole pixels. */
typedef struct {
    ptrdiff_t left, top, right, bottom; /* right and bottom: the first that are beyond */
    float half;                         /* half-way from the darkest to the brightest */
} Surroundings;

static bool surroundings_of(const Picture *picture, double x, double y, double reach, Surroundings *found) {
    const double left = nearbyint(x - reach), right = nearbyint(x + reach) + 1.0;
    const double top = nearbyint(y - reach), bottom = nearbyint(y + reach) + 1.0;
    if (!(left >= 0.0 && top >= 0.0 && right <= (double)picture->width && bottom <= (double)picture->height)) return false;
    if (!(right - left >= 3.0 && bottom - top >= 3.0)) return false;
    *found = (Surroundings){(ptrdiff_t)left, (ptrdiff_t)top, (ptrdiff_t)right, (ptrdiff_t)bottom, 0.0f};
    uint8_t darkest = 255, brightest = 0; /* the table rises */
    for (ptrdiff_t row = found->top; row < found->bottom; row++) {
        const uint8_t *const pixels = picture->pixels + row * picture->stride;
        for (ptrdiff_t column = found->left; column < found->right; column++) {
            darkest = pixels[column] < darkest ? pixels[column] : darkest;
            brightest = pixels[column] > brightest ? pixels[column] : brightest;
        }
    }
    found->half = 0.5f * (picture->light[darkest] + picture->light[brightest]);
    return true;
}

/* Of each place `at` (count, 2: x, y) the centre of the light around that is more than half of the brightest, and which share
 * of what is around is so bright, in `found` (count, 3); not a number where there is nothing. */
void ledpi_centres(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                   const double *at, ptrdiff_t count, double reach, double *found) {
    const Picture picture = {pixels, height, width, stride, table};
    for (ptrdiff_t i = 0; i < count; i++, at += 2, found += 3) {
        Surroundings around;
        found[0] = found[1] = found[2] = NAN;
        if (!surroundings_of(&picture, at[0], at[1], reach, &around)) continue;
        double light = 0.0, across = 0.0, down = 0.0, lit = 0.0, all = 0.0;
        for (ptrdiff_t row = around.top; row < around.bottom; row++)
            for (ptrdiff_t column = around.left; column < around.right; column++) {
                const double x = (double)column - at[0], y = (double)row - at[1];
                const double window = 1.0 - (x * x + y * y) / (reach * reach);
                if (!(window > 0.0)) continue;
                const double over = (double)(table[pixels[row * stride + column]] - around.half);
                all += window;
                if (!(over > 0.0)) continue;
                lit += window;
                light += over * window;
                across += over * window * x;
                down += over * window * y;
            }
        if (!(light > 0.0)) continue;
        found[0] = at[0] + across / light, found[1] = at[1] + down / light, found[2] = lit / all;
    }
}
