/* One square of each thing, without a panel's cells. */
#include <math.h>
#include <stdlib.h>

#include "find.h"

/* Bands of rows for the middles of squares: those that are the same are in bands near each other. */
enum { BANDS = 128, BAND_PX = 16 };

static double cost(const Square *square, const Limits *limits) {
    return square->misfit + limits->blur_misfit * square->tolerance_px;
}

/* The square of the way from a corner of one square to the nearest of the other, at most. */
static double farthest2(const Square *a, const Square *b) {
    double most = 0.0;
    for (int i = 0; i < 4; i++) {
        double least = HUGE_VAL;
        for (int k = 0; k < 4; k++) {
            const double x = a->corners[i][0] - b->corners[k][0], y = a->corners[i][1] - b->corners[k][1];
            least = least < x * x + y * y ? least : x * x + y * y;
        }
        most = most > least ? most : least;
    }
    return most;
}

static bool same(const Square *a, const Square *b, const Limits *limits) {
    const double larger = fmax(a->side_px, b->side_px), smaller = fmin(a->side_px, b->side_px);
    double apart[2] = {0.0, 0.0};
    if (!(smaller > limits->like * larger)) return false;
    for (int k = 0; k < 8; k++) apart[k % 2] += 0.25 * (a->corners[k / 2][k % 2] - b->corners[k / 2][k % 2]);
    const double near = limits->near * larger, same_corners = limits->same_corners * larger;
    return apart[0] * apart[0] + apart[1] * apart[1] < near * near && farthest2(a, b) < same_corners * same_corners;
}

static int by_cost(const void *one, const void *other) {
    const Ranked *const a = one, *const b = other;
    if (a->cost != b->cost) return a->cost < b->cost ? -1 : 1;
    return a->at < b->at ? -1 : 1; /* those that are alike as they came */
}

static ptrdiff_t band_at(double y) { return y < 0.0 ? 0 : y < BANDS * BAND_PX ? (ptrdiff_t)(y / BAND_PX) : BANDS - 1; }

ptrdiff_t ledpi_distinct(const Square *squares, ptrdiff_t count, const Limits *limits, Ranked *ranked, int64_t *kept) {
    ptrdiff_t distinct = 0, bands[BANDS]; /* the square kept last in each; `before` leads on from there */
    for (ptrdiff_t i = 0; i < BANDS; i++) bands[i] = -1;
    for (ptrdiff_t i = 0; i < count; i++) {
        const double(*c)[2] = squares[i].corners;
        ranked[i] = (Ranked){cost(squares + i, limits), 0.25 * (c[0][1] + c[1][1] + c[2][1] + c[3][1]), i, -1};
    }
    qsort(ranked, (size_t)count, sizeof(Ranked), by_cost);
    for (ptrdiff_t i = 0; i < count; i++) {
        const Square *const own = squares + ranked[i].at;
        const double middle = ranked[i].middle, reach = limits->near * own->side_px / limits->like;
        const ptrdiff_t last = band_at(middle + reach);
        bool seen = false;
        for (ptrdiff_t band = band_at(middle - reach); band <= last && !seen; band++)
            for (ptrdiff_t k = bands[band]; k >= 0 && !seen; k = ranked[k].before)
                seen = same(own, squares + ranked[k].at, limits);
        if (seen) continue;
        ptrdiff_t *const band = bands + band_at(middle);
        ranked[i].before = *band, *band = i;
        kept[distinct++] = ranked[i].at;
    }
    return distinct;
}

/* True if a square's middle lies within another, whose corners run clockwise in the picture. */
static bool is_within(const Square *square, const Square *other) {
    double middle[2] = {0.0, 0.0};
    for (int k = 0; k < 8; k++) middle[k % 2] += 0.25 * square->corners[k / 2][k % 2];
    for (int k = 0; k < 4; k++) {
        const double *const a = other->corners[k], *const b = other->corners[(k + 1) % 4];
        if (!((b[0] - a[0]) * (middle[1] - a[1]) - (b[1] - a[1]) * (middle[0] - a[0]) > 0.0)) return false;
    }
    return true;
}

static bool is_cell(const Square *square, const Square *panel, ptrdiff_t cells, const Limits *limits) {
    const double pitches = square->side_px * (double)cells / panel->side_px;
    return pitches > limits->least_cell && pitches < limits->most_cell && is_within(square, panel);
}

ptrdiff_t ledpi_drop_cells(const Square *squares, ptrdiff_t count, ptrdiff_t cells, const Limits *limits,
                              int64_t *kept) {
    bool dropped[MOST_COMPARED] = {false};
    ptrdiff_t left = 0;
    if (count > MOST_COMPARED) return count;
    for (ptrdiff_t i = 0; i < count; i++) {
        const Square *const panel = squares + kept[i];
        ptrdiff_t within = 0;
        for (ptrdiff_t k = 0; k < count; k++) within += is_cell(squares + kept[k], panel, cells, limits);
        if (within < cells) continue;
        for (ptrdiff_t k = 0; k < count; k++) dropped[k] |= is_cell(squares + kept[k], panel, cells, limits);
    }
    for (ptrdiff_t i = 0; i < count; i++)
        if (!dropped[i]) kept[left++] = kept[i];
    return left;
}
