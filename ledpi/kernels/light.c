/* Light between pixels, from the frame as it is: only the pixels that are asked for are linearised. */
#include "kernels.h"

/* A coordinate's pixel before, 0 … size − 2, and the share of the way to the next; beyond the picture that of its end.
 * What is not a number counts as 0, which is as good as any other place. */
static inline ptrdiff_t before(float at, ptrdiff_t size, float *share) {
    if (!(at > 0.0f)) {
        *share = 0.0f;
        return 0;
    }
    if (at >= (float)(size - 1)) {
        *share = 1.0f;
        return size - 2;
    }
    ptrdiff_t pixel = (ptrdiff_t)at;
    *share = at - (float)pixel;
    return pixel;
}

float ledpi_light_between(const Picture *picture, float x, float y) {
    float right, down;
    ptrdiff_t column = before(x, picture->width, &right), row = before(y, picture->height, &down);
    const uint8_t *above = picture->pixels + row * picture->stride + column, *below = above + picture->stride;
    const float *light = picture->light;
    float upper = light[above[0]] + right * (light[above[1]] - light[above[0]]);
    float lower = light[below[0]] + right * (light[below[1]] - light[below[0]]);
    return upper + down * (lower - upper);
}

/* `light` (count) at `points` (count, 2: x, y). */
void ledpi_light_at(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                    const float *points, ptrdiff_t count, float *light) {
    const Picture picture = {pixels, height, width, stride, table};
    for (ptrdiff_t i = 0; i < count; i++)
        light[i] = ledpi_light_between(&picture, points[2 * i], points[2 * i + 1]);
}
