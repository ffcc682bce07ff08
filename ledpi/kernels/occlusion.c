/* Whether something stands before a panel's cells: the first question of decode/evidence/occlusion.py. */
#include "core.h"
#include "simd.h"

/* Whether each sample of `light` (cells, points), over the mean of its cell, shows the share `least` (cells, points) of what
 * the cells show there on average. `valid` unless that is NULL. `room` (points + cells) is room to work in. */
LEDPI_SIMD bool ledpi_is_unoccluded(ptrdiff_t cells, ptrdiff_t points, const float *light, const uint8_t *valid,
                                    const float *least, float *room) {
    float *mean = room, *gain = room + points;
    for (ptrdiff_t p = 0; p < points; p++) mean[p] = 0.0f;
    for (ptrdiff_t c = 0; c < cells; c++) {
        const float *own = light + c * points;
        gain[c] = (float)((double)points / ledpi_sum(own, points));
        for (ptrdiff_t p = 0; p < points; p++) mean[p] += own[p] * gain[c];
    }
    for (ptrdiff_t p = 0; p < points; p++) mean[p] *= 1.0f / (float)cells;
    uint8_t covered = 0;
    for (ptrdiff_t c = 0, i = 0; c < cells; c++)
        for (ptrdiff_t p = 0; p < points; p++, i++)
            covered |= (uint8_t)((valid ? valid[i] : 1) & !(light[i] * gain[c] >= least[i] * mean[p]));
    return !covered;
}
