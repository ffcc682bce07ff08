/* Grids by the places where their cells meet: `lattice_grids` of decode/finding/crossings.py. */
#include <math.h>
#include <string.h>

#include "kernels.h"

enum { MOST_SIDE = 8, MOST_REACH = MOST_SIDE - 3, MOST_AT = (2 * MOST_REACH + 1) * (2 * MOST_REACH + 1), MOST_GRIDS = 24 };
enum { MOST_MEMBERS = (MOST_SIDE - 1) * (MOST_SIDE - 1), SIZE = 8, NONE = -1, MISSING = 1 };
#define OFF_LATTICE 0.2
#define SINGULAR 1e-9 /* determinant */

/* Members of a lattice or of a grid: which of the points, and where in it. */
typedef struct {
    ptrdiff_t count, point[MOST_AT];
    int x[MOST_AT], y[MOST_AT];
} Members;

static Point through(const double h[9], double x, double y) {
    const double across = 1.0 / (h[6] * x + h[7] * y + h[8]);
    return (Point){(h[0] * x + h[1] * y + h[2]) * across, (h[3] * x + h[4] * y + h[5]) * across};
}

static double determinant(const double h[9]) {
    return h[0] * (h[4] * h[8] - h[5] * h[7]) - h[1] * (h[3] * h[8] - h[5] * h[6]) + h[2] * (h[3] * h[7] - h[4] * h[6]);
}

static void invert(const double h[9], double inverse[9]) {
    const double whole = 1.0 / determinant(h);
    inverse[0] = (h[4] * h[8] - h[5] * h[7]) * whole, inverse[1] = (h[2] * h[7] - h[1] * h[8]) * whole;
    inverse[2] = (h[1] * h[5] - h[2] * h[4]) * whole, inverse[3] = (h[5] * h[6] - h[3] * h[8]) * whole;
    inverse[4] = (h[0] * h[8] - h[2] * h[6]) * whole, inverse[5] = (h[2] * h[3] - h[0] * h[5]) * whole;
    inverse[6] = (h[3] * h[7] - h[4] * h[6]) * whole, inverse[7] = (h[1] * h[6] - h[0] * h[7]) * whole;
    inverse[8] = (h[0] * h[4] - h[1] * h[3]) * whole;
}

static void add_square(const double row[SIZE], double right, double matrix[SIZE][SIZE + 1]) {
    for (int i = 0; i < SIZE; i++) {
        for (int j = i; j < SIZE; j++) matrix[i][j] += row[i] * row[j];
        matrix[i][SIZE] += row[i] * right;
    }
}

/* The homography from where members are in their lattice to their points, by linear least squares. */
static bool fitted(const Point *points, const Members *members, double h[9]) {
    const Point origin = points[members->point[0]];
    double matrix[SIZE][SIZE + 1] = {{0.0}};
    for (ptrdiff_t k = 0; k < members->count; k++) {
        const double u = members->x[k], v = members->y[k];
        const double x = points[members->point[k]].x - origin.x, y = points[members->point[k]].y - origin.y;
        add_square((double[SIZE]){u, v, 1.0, 0.0, 0.0, 0.0, -x * u, -x * v}, x, matrix);
        add_square((double[SIZE]){0.0, 0.0, 0.0, u, v, 1.0, -y * u, -y * v}, y, matrix);
    }
    for (int j = 0; j < SIZE; j++) {
        if (!(matrix[j][j] > 0.0)) return false;
        for (int i = j + 1; i < SIZE; i++) {
            const double factor = matrix[j][i] / matrix[j][j];
            for (int m = i; m <= SIZE; m++) matrix[i][m] -= factor * matrix[j][m];
        }
    }
    h[8] = 1.0;
    for (int j = SIZE - 1; j >= 0; j--) {
        h[j] = matrix[j][SIZE];
        for (int i = j + 1; i < SIZE; i++) h[j] -= matrix[j][i] * h[i];
        h[j] /= matrix[j][j];
    }
    for (int i = 0; i < 3; i++) h[i] += origin.x * h[6 + i], h[3 + i] += origin.y * h[6 + i];
    return true;
}

/* The points that are on a lattice so far from its middle, the nearest to each of its places. */
static void members_of(const Point *points, ptrdiff_t count, const double to_picture[9], int reach, Members *members) {
    ptrdiff_t at[MOST_AT];
    double nearest[MOST_AT], inverse[9];
    const int size = 2 * reach + 1;
    for (int k = 0; k < size * size; k++) at[k] = NONE;
    invert(to_picture, inverse);
    for (ptrdiff_t i = 0; i < count; i++) {
        const Point seen = through(inverse, points[i].x, points[i].y), whole = {rint(seen.x), rint(seen.y)};
        const double off = fmax(fabs(seen.x - whole.x), fabs(seen.y - whole.y));
        if (!(off < OFF_LATTICE && fabs(whole.x) <= reach && fabs(whole.y) <= reach)) continue;
        const int k = ((int)whole.x + reach) * size + (int)whole.y + reach;
        if (at[k] == NONE || off < nearest[k]) at[k] = i, nearest[k] = off;
    }
    members->count = 0;
    for (int k = 0; k < size * size; k++) {
        if (at[k] == NONE) continue;
        members->point[members->count] = at[k];
        members->x[members->count] = k / size - reach, members->y[members->count++] = k % size - reach;
    }
}

/* The lattice around one point, as far as a grid may reach; false where there is none. */
static bool grown(const Point *points, ptrdiff_t count, Point middle, const Point steps[2], ptrdiff_t cells, Members *members) {
    double to_picture[9] = {steps[0].x, steps[1].x, middle.x, steps[0].y, steps[1].y, middle.y, 0.0, 0.0, 1.0};
    for (int reach = 1; reach < cells - 2; reach++) {
        members_of(points, count, to_picture, reach, members);
        if (members->count < 9 - MISSING || !fitted(points, members, to_picture)) return false;
        if (!(fabs(determinant(to_picture)) >= SINGULAR)) return false;
    }
    return true;
}

/* Those of a lattice's members that are within `side` places from (x, y) on, counted from there. */
static void window_of(const Members *lattice, int x, int y, int side, Members *window) {
    window->count = 0;
    for (ptrdiff_t k = 0; k < lattice->count; k++) {
        const int across = lattice->x[k] - x, down = lattice->y[k] - y;
        if (across < 0 || across >= side || down < 0 || down >= side) continue;
        window->point[window->count] = lattice->point[k];
        window->x[window->count] = across, window->y[window->count++] = down;
    }
}

/* What tells a grid from others: its members, whatever their order. */
typedef struct {
    ptrdiff_t count, point[MOST_MEMBERS];
} Sorted;

static void sort(const Members *members, Sorted *sorted) {
    sorted->count = 0;
    for (ptrdiff_t k = 0; k < members->count; k++) {
        ptrdiff_t at = sorted->count++;
        for (; at > 0 && sorted->point[at - 1] > members->point[k]; at--) sorted->point[at] = sorted->point[at - 1];
        sorted->point[at] = members->point[k];
    }
}

static bool is_known(const Sorted *one, const Sorted *known, ptrdiff_t count) {
    for (ptrdiff_t k = 0; k < count; k++)
        if (known[k].count == one->count && !memcmp(known[k].point, one->point, sizeof(ptrdiff_t) * (size_t)one->count)) return true;
    return false;
}

/* Clockwise from the one nearest the picture's top left. */
static void put_corners(const double h[9], ptrdiff_t cells, Point corners[4]) {
    const double low = -1.0, high = (double)cells - 1.0;
    const Point rim[4] = {through(h, low, low), through(h, high, low), through(h, high, high), through(h, low, high)};
    const bool clockwise = (rim[2].x - rim[0].x) * (rim[3].y - rim[1].y) - (rim[2].y - rim[0].y) * (rim[3].x - rim[1].x) >= 0;
    int first = 0;
    for (int k = 0; k < 4; k++) corners[k] = rim[clockwise ? k : 3 - k];
    for (int k = 1; k < 4; k++)
        if (corners[k].x + corners[k].y < corners[first].x + corners[first].y) first = k;
    Point turned[4];
    for (int k = 0; k < 4; k++) turned[k] = corners[(first + k) % 4];
    memcpy(corners, turned, sizeof turned);
}

/* Into `corners` (MOST_GRIDS, 4) those of the grids of cells × cells, at most MOST_SIDE, around `middles` of `points` (count,),
 * with `steps` (middle_count, 2) along their axes; returns how many. */
ptrdiff_t ledpi_grids(const Point *points, ptrdiff_t count, const ptrdiff_t *middles, const Point (*steps)[2],
                      ptrdiff_t middle_count, ptrdiff_t cells, Point (*corners)[4]) {
    Sorted known[MOST_GRIDS];
    const int side = (int)cells - 1, reach = (int)cells - 3;
    ptrdiff_t found = 0;
    for (ptrdiff_t k = 0; k < middle_count; k++) {
        Members lattice, window;
        if (!grown(points, count, points[middles[k]], steps[k], cells, &lattice)) continue;
        for (int x = -reach; x + side <= reach + 1; x++)
            for (int y = -reach; y + side <= reach + 1; y++) {
                double h[9];
                window_of(&lattice, x, y, side, &window);
                if (window.count < side * side - MISSING) continue;
                sort(&window, &known[found]);
                if (is_known(&known[found], known, found) || !fitted(points, &window, h)) continue;
                put_corners(h, cells, corners[found]);
                if (++found == MOST_GRIDS) return found;
            }
    }
    return found;
}
