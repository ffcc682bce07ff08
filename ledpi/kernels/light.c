/* Light between pixels, from the frame as it is: only the pixels that are asked for are linearised. */
#include "kernels.h"

/* `light` (count) at `points` (count, 2: x, y). */
void ledpi_light_at(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                    const float *points, ptrdiff_t count, float *light) {
    const Picture picture = {pixels, height, width, stride, table};
    for (ptrdiff_t i = 0; i < count; i++)
        light[i] = ledpi_light_between(&picture, points[2 * i], points[2 * i + 1]);
}
