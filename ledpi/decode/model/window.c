/* Linear light of a part of a picture, averaged down by whole pixels, and its levels. */
#include <math.h>

#include "core.h"
#include "kernels.h"
#include "simd.h"

/* Places at which a row at `y` enters a square and leaves it: that before this, if they do not meet. */
static void put_crossings(const double corners[8], double y, double crossings[2]) {
    crossings[0] = INFINITY, crossings[1] = -INFINITY;
    for (int i = 0; i < 4; i++) {
        const double *const one = corners + 2 * i, *const next = corners + 2 * ((i + 1) % 4);
        if ((one[1] <= y) == (next[1] <= y)) continue;
        const double x = one[0] + (y - one[1]) * (next[0] - one[0]) / (next[1] - one[1]);
        crossings[0] = fmin(crossings[0], x), crossings[1] = fmax(crossings[1], x);
    }
}

/* Counts of grey levels: in the window, and within the square. */
typedef struct {
    int32_t all[256], inside[256];
} Counts;

static void add_row(const PanelWindow *window, ptrdiff_t row, const uint8_t *pixels, Counts *counts) {
    const ptrdiff_t columns = window->columns * window->shrink;
    double crossings[2];
    put_crossings(window->corners, (double)(window->top + row), crossings);
    const double left = (double)window->left, last = fmin(floor(crossings[1] - left), (double)(columns - 1));
    for (ptrdiff_t x = 0; x < columns; x += 2) counts->all[pixels[x]]++; /* half of them tell as well */
    for (double x = fmax(ceil(crossings[0] - left), 0.0); x <= last; x++) counts->inside[pixels[(ptrdiff_t)x]]++;
}

/* Light of a row of the window, of which `pixels` are the first. */
static LEDPI_INLINE void put_light(const PanelWindow *window, const uint8_t *pixels, const ptrdiff_t shrink, float *light) {
    const float share = 1.0f / (float)(shrink * shrink);
    for (ptrdiff_t i = 0; i < window->columns; i++, pixels += shrink) {
        float sum = 0.0f;
        for (ptrdiff_t y = 0; y < shrink; y++)
            for (ptrdiff_t x = 0; x < shrink; x++) sum += window->linear[pixels[y * window->width + x]];
        light[i] = share * sum;
    }
}

/* Puts light and levels; these by one row of pixels for each of the window. False where no pixel is within the square. */
bool ledpi_panel_window(PanelWindow *window) {
    Counts counts = {{0}, {0}};
    int32_t inside = 0;
    for (ptrdiff_t j = 0; j < window->rows; j++) {
        const ptrdiff_t row = j * window->shrink;
        const uint8_t *const pixels = window->picture + (window->top + row) * window->width + window->left;
        float *const light = window->light + j * window->columns;
        if (window->shrink == 1) put_light(window, pixels, 1, light);
        else if (window->shrink == 2) put_light(window, pixels, 2, light);
        else put_light(window, pixels, window->shrink, light);
        add_row(window, row + window->shrink / 2, pixels + window->shrink / 2 * window->width, &counts);
    }
    for (int i = 0; i < 256; i++) inside += counts.inside[i];
    window->dark = window->linear[ledpi_quantile(counts.all, LEDPI_DARK)];
    window->bright = window->linear[ledpi_quantile(counts.inside, LEDPI_BRIGHT)];
    window->dimmed = window->linear[ledpi_quantile(counts.inside, LEDPI_DARK)];
    return inside > 0;
}
