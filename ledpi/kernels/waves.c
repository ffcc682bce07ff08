/* Cosine and sine of bands in each row. */
#include <stddef.h>

#include "wide.h"

/* sin 2πy for y within ±¼, by its series: off by less than 1e-7. */
static inline float sine(float y) {
    const float turn = 6.28318530717958648f * y, s = turn * turn;
    return turn * (1.0f + s * (-1.0f / 6 + s * (1.0f / 120 + s * (-1.0f / 5040 + s * (1.0f / 362880 - s / 39916800)))));
}

/* `cosines` and `sines` (count) of 2π(a_row·row + start) for each of `rows` (count). */
LEDPI_WIDE void ledpi_waves(const float *rows, ptrdiff_t count, float a_row, float start, float *cosines, float *sines) {
    const float round = 12582912.0f; /* 1.5·2²³: what is added to it loses all behind the point */
    for (ptrdiff_t i = 0; i < count; i++) {
        const float cycles = rows[i] * a_row + start, part = cycles - ((cycles + round) - round); /* within ±½ */
        const float size = part < 0.0f ? -part : part, off = size - 0.25f, folded = 0.25f - (off < 0.0f ? -off : off);
        cosines[i] = sine(-off);
        sines[i] = sine(part < 0.0f ? -folded : folded);
    }
}
