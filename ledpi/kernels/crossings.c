/* Places where four cells may meet, and those with others in a square around: `crosses_in` of decode/finding/crossings.py. */
#include <math.h>
#include <string.h>

#include "kernels.h"
#include "wide.h"

enum { AROUND_PX = 2, MARGIN_PX = 3, MOST_PLACES = 800, NEAREST = 8, MISSING = 1 };
#define DEPTH 0.05
#define LEAST_AROUND 16.0
#define NEAREST_PX 2.5
#define FARTHEST_PX 18.0
#define OPPOSITE 0.25
#define ACROSS 0.4
#define OFF_LATTICE 0.2
#define LIKE 3.0
#define ROWS_OFF 2.0 /* places are within a pixel of the lowest one, row by row */

typedef struct {
    double x, y, depth;
} Place;

/* Of each pixel but the outermost, with its eight neighbours. */
LEDPI_WIDE_BYTES static void sums_of_nine(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, uint16_t *sums) {
    for (ptrdiff_t y = 1; y < height - 1; y++) {
        const uint8_t *here = picture + y * width, *above = here - width, *below = here + width;
        uint16_t *restrict into = sums + y * width;
        for (ptrdiff_t x = 1; x < width - 1; x++)
            into[x] = (uint16_t)(above[x - 1] + above[x] + above[x + 1] + here[x - 1] + here[x] + here[x + 1] + below[x - 1] +
                                 below[x] + below[x + 1]);
    }
}

/* Which of a row's sums are no higher than any beside them. */
LEDPI_WIDE_BYTES static void lowest_in(const uint16_t *here, ptrdiff_t width, uint8_t *restrict lowest) {
    const uint16_t *const above = here - width, *const below = here + width;
    for (ptrdiff_t x = MARGIN_PX; x < width - MARGIN_PX; x++) {
        const uint16_t own = here[x];
        lowest[x] = (own <= above[x - 1]) & (own <= above[x]) & (own <= above[x + 1]) & (own <= here[x - 1]) &
                    (own <= here[x + 1]) & (own <= below[x - 1]) & (own <= below[x]) & (own <= below[x + 1]);
    }
}

/* Mean of the sums AROUND_PX around. */
static double mean_around(const uint16_t *at, ptrdiff_t width) {
    int32_t sum = 0;
    for (ptrdiff_t k = -AROUND_PX; k < AROUND_PX; k++) /* four sides, each without its last corner */
        sum += at[-AROUND_PX * width + k] + at[k * width + AROUND_PX] + at[AROUND_PX * width - k] + at[-k * width - AROUND_PX];
    return sum / (8.0 * AROUND_PX);
}

static double within_one(double value) { return value < -1.0 ? -1.0 : value > 1.0 ? 1.0 : value; }

/* Where the quadratic through 3 × 3 sums is lowest, from the middle one. */
static Point lowest(const uint16_t *at, ptrdiff_t width) {
    double rows[3] = {0.0}, columns[3] = {0.0};
    for (int y = -1; y <= 1; y++)
        for (int x = -1; x <= 1; x++) rows[y + 1] += at[y * width + x], columns[x + 1] += at[y * width + x];
    const double by_x = (columns[2] - columns[0]) / 6, by_y = (rows[2] - rows[0]) / 6;
    const double xx = (columns[0] - 2 * columns[1] + columns[2]) / 3, yy = (rows[0] - 2 * rows[1] + rows[2]) / 3;
    const double xy = ((double)at[-width - 1] - at[-width + 1] - at[width - 1] + at[width + 1]) / 4;
    const double turn = fmax(xx * yy - xy * xy, 1e-3);
    return (Point){within_one((xy * by_y - yy * by_x) / turn), within_one((xy * by_x - xx * by_y) / turn)};
}

/* `row` (width) is room. */
static ptrdiff_t places_in(const uint16_t *sums, ptrdiff_t height, ptrdiff_t width, uint8_t *row, Place *places) {
    ptrdiff_t count = 0;
    memset(row, 0, (size_t)width);
    for (ptrdiff_t y = MARGIN_PX; y < height - MARGIN_PX; y++) {
        lowest_in(sums + y * width, width, row);
        for (const uint8_t *low = row; (low = memchr(low, 1, (size_t)(row + width - low))) != NULL; low++) {
            const uint16_t *const at = sums + y * width + (low - row);
            const double around = mean_around(at, width);
            if (!(*at < (1 - DEPTH) * around && around > 9 * LEAST_AROUND)) continue;
            const Point off = lowest(at, width);
            places[count++] = (Place){(double)(low - row) + off.x, (double)y + off.y, 1 - *at / around};
            if (count == MOST_PLACES) return count;
        }
    }
    return count;
}

static double square(Point way) { return way.x * way.x + way.y * way.y; }

/* Ways from `middle` to the nearest others that are about as deep, the shortest first, and the squares of their lengths;
 * `first` to `last` are in reach. */
static int ways_from(const Place *middle, const Place *first, const Place *last, Point ways[NEAREST],
                     double squares[NEAREST]) {
    int found = 0;
    for (const Place *other = first; other < last; other++) {
        const Point way = {other->x - middle->x, other->y - middle->y};
        if (fabs(way.x) > FARTHEST_PX || fabs(way.y) > FARTHEST_PX) continue;
        const double far = square(way);
        if (!(far >= NEAREST_PX * NEAREST_PX && far <= FARTHEST_PX * FARTHEST_PX)) continue;
        if (!(other->depth < LIKE * middle->depth && middle->depth < LIKE * other->depth)) continue;
        if (found == NEAREST && !(far < squares[NEAREST - 1])) continue;
        int at = found < NEAREST ? found++ : NEAREST - 1;
        for (; at > 0 && squares[at - 1] > far; at--) ways[at] = ways[at - 1], squares[at] = squares[at - 1];
        ways[at] = way, squares[at] = far;
    }
    return found;
}

/* The shortest steps along two lines on which there are others straight on both ways. */
static bool axes_of(const Point *ways, const double *squares, int count, Point axes[2]) {
    Point steps[NEAREST * (NEAREST - 1) / 2];
    int found = 0, first = 0;
    for (int i = 0; i < count; i++)
        for (int k = i + 1; k < count; k++) {
            const Point off = {ways[i].x + ways[k].x, ways[i].y + ways[k].y};
            if (!(square(off) < OPPOSITE * OPPOSITE * fmin(squares[i], squares[k]))) continue;
            steps[found++] = (Point){0.5 * (ways[i].x - ways[k].x), 0.5 * (ways[i].y - ways[k].y)};
        }
    for (int i = 1; i < found; i++)
        if (square(steps[i]) < square(steps[first])) first = i;
    double shortest = HUGE_VAL;
    for (int i = 0; i < found; i++) {
        const double far = square(steps[i]), turn = steps[first].x * steps[i].y - steps[first].y * steps[i].x;
        if (!(turn * turn > ACROSS * ACROSS * square(steps[first]) * far && far < shortest)) continue;
        axes[0] = steps[first], axes[1] = steps[i], shortest = far;
    }
    return shortest < HUGE_VAL;
}

/* How many of the nine around `middle` are there. */
static int nine_of(const Place *middle, const Place *first, const Place *last, const Point axes[2]) {
    const double turn = axes[0].x * axes[1].y - axes[0].y * axes[1].x;
    const double right = (1 + OFF_LATTICE) * (fabs(axes[0].x) + fabs(axes[1].x)); /* none is further off */
    const double down = (1 + OFF_LATTICE) * (fabs(axes[0].y) + fabs(axes[1].y));
    int found = 0;
    for (const Place *other = first; other < last; other++) {
        const double x = other->x - middle->x, y = other->y - middle->y;
        if (fabs(x) > right || fabs(y) > down) continue;
        const double a = (x * axes[1].y - y * axes[1].x) / turn, b = (y * axes[0].x - x * axes[0].y) / turn;
        if (fabs(rint(a)) > 1 || fabs(rint(b)) > 1) continue;
        found += fabs(a - rint(a)) < OFF_LATTICE && fabs(b - rint(b)) < OFF_LATTICE;
    }
    return found;
}

/* A lattice that is seen from the side has a diagonal that is shorter than a step: of the axes that the two shortest ways make,
 * those with the most of nine. False where more than MISSING of these are not there. */
static bool best_axes(const Place *middle, const Place *first, const Place *last, Point axes[2]) {
    const Point u = axes[0], v = axes[1], sum = {u.x + v.x, u.y + v.y}, difference = {v.x - u.x, v.y - u.y};
    const Point all[5][2] = {{u, v}, {u, sum}, {u, difference}, {v, sum}, {v, difference}};
    int most = 0;
    for (int k = 0; k < 5; k++) {
        if (square(all[k][1]) > FARTHEST_PX * FARTHEST_PX) continue;
        const int found = nine_of(middle, first, last, all[k]);
        if (found > most) most = found, axes[0] = all[k][0], axes[1] = all[k][1];
    }
    return most >= 9 - MISSING;
}

/* A part of the list, in which the rows are that `reach` from one place: they are in order but for ROWS_OFF. */
typedef struct {
    const Place *first, *last;
} Part;

static void slide(Part *part, const Place *middle, const Place *end, double reach) {
    while (part->first->y < middle->y - reach - ROWS_OFF) part->first++;
    while (part->last < end && part->last->y <= middle->y + reach + ROWS_OFF) part->last++;
}

/* Into `places` (MOST_PLACES) what is there, `count` of them; returns how many of those are `middles` of a square of nine,
 * with the steps along its axes. `sums` (height, width) and `row` (width) are room. */
ptrdiff_t ledpi_crosses(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, uint16_t *sums, uint8_t *row,
                        Place *places, ptrdiff_t *count, ptrdiff_t *middles, Point (*steps)[2]) {
    *count = 0;
    if (height <= 2 * MARGIN_PX || width <= 2 * MARGIN_PX) return 0;
    sums_of_nine(picture, height, width, sums);
    *count = places_in(sums, height, width, row, places);
    ptrdiff_t found = 0;
    Part beside = {places, places}, around = {places, places}; /* within a step, and within two */
    for (ptrdiff_t middle = 0; middle < *count; middle++) {
        Point ways[NEAREST], axes[2];
        double squares[NEAREST];
        const Place *here = places + middle;
        slide(&beside, here, places + *count, FARTHEST_PX);
        slide(&around, here, places + *count, 2 * (1 + OFF_LATTICE) * FARTHEST_PX);
        const int near = ways_from(here, beside.first, beside.last, ways, squares);
        if (!axes_of(ways, squares, near, axes) || !best_axes(here, around.first, around.last, axes)) continue;
        middles[found] = middle;
        steps[found][0] = axes[0], steps[found][1] = axes[1];
        found++;
    }
    return found;
}
