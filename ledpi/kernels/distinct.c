/* One square of each thing: `distinct` of decode/four_sides.py. */
#include <math.h>

#include "find.h"


static double cost(const Square *square, const Limits *limits) {
    return square->misfit + limits->blur_misfit * square->tolerance_px;
}

/* From a corner of one square to the nearest of the other, at most. */
static double farthest(const Square *a, const Square *b) {
    double most = 0.0;
    for (int i = 0; i < 4; i++) {
        double least = HUGE_VAL;
        for (int k = 0; k < 4; k++)
            least = fmin(least, hypot(a->corners[i][0] - b->corners[k][0], a->corners[i][1] - b->corners[k][1]));
        most = fmax(most, least);
    }
    return most;
}

static bool same(const Square *a, const Square *b, const Limits *limits) {
    const double larger = fmax(a->side_px, b->side_px), smaller = fmin(a->side_px, b->side_px);
    double apart[2] = {0.0, 0.0};
    if (!(smaller > limits->like * larger)) return false;
    for (int k = 0; k < 8; k++) apart[k % 2] += 0.25 * (a->corners[k / 2][k % 2] - b->corners[k / 2][k % 2]);
    return hypot(apart[0], apart[1]) < limits->near * larger && farthest(a, b) < limits->same_corners * larger;
}

ptrdiff_t ledpi_distinct(const Square *squares, ptrdiff_t count, const Limits *limits, ptrdiff_t *kept) {
    ptrdiff_t distinct = 0;
    for (ptrdiff_t i = 0; i < count; i++) { /* in order, those that are alike as they came */
        ptrdiff_t at = i;
        for (; at > 0 && cost(squares + kept[at - 1], limits) > cost(squares + i, limits); at--) kept[at] = kept[at - 1];
        kept[at] = i;
    }
    for (ptrdiff_t i = 0; i < count; i++) {
        bool seen = false;
        for (ptrdiff_t k = 0; k < distinct && !seen; k++) seen = same(squares + kept[i], squares + kept[k], limits);
        if (!seen) kept[distinct++] = kept[i];
    }
    return distinct;
}
