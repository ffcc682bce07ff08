/* Light between pixels, from the frame as it is: only the pixels that are asked for are linearised. */
#include "kernels.h"
#include "wide.h"

enum { AT_ONCE = 64 };

LEDPI_WIDE void ledpi_light_at_all(const Picture *picture, const float *x, const float *y, ptrdiff_t count, float *light) {
    const float most_x = (float)(picture->width - 1), most_y = (float)(picture->height - 1), *const table = picture->light;
    const int32_t last_column = (int32_t)picture->width - 2, last_row = (int32_t)picture->height - 2;
    const int32_t stride = (int32_t)picture->stride;
    for (; count > 0; count -= AT_ONCE, x += AT_ONCE, y += AT_ONCE, light += AT_ONCE) {
        const ptrdiff_t here = count < AT_ONCE ? count : AT_ONCE;
        float right[AT_ONCE], down[AT_ONCE];
        int32_t pixel[AT_ONCE];
        for (ptrdiff_t i = 0; i < here; i++) { /* as `ledpi_before` has it */
            float at_x = x[i] > 0.0f ? x[i] : 0.0f, at_y = y[i] > 0.0f ? y[i] : 0.0f;
            at_x = at_x < most_x ? at_x : most_x, at_y = at_y < most_y ? at_y : most_y;
            int32_t column = (int32_t)at_x, row = (int32_t)at_y;
            column = column < last_column ? column : last_column, row = row < last_row ? row : last_row;
            right[i] = at_x - (float)column, down[i] = at_y - (float)row;
            pixel[i] = row * stride + column;
        }
        for (ptrdiff_t i = 0; i < here; i++) {
            const uint8_t *above = picture->pixels + pixel[i], *below = above + picture->stride;
            const float upper = table[above[0]] + right[i] * (table[above[1]] - table[above[0]]);
            const float lower = table[below[0]] + right[i] * (table[below[1]] - table[below[0]]);
            light[i] = upper + down[i] * (lower - upper);
        }
    }
}

/* The same, of a picture that Python has. */
void ledpi_light_at(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                    const float *x, const float *y, ptrdiff_t count, float *light) {
    const Picture picture = {pixels, height, width, stride, table};
    ledpi_light_at_all(&picture, x, y, count, light);
}
