/* The four sides of things by their outlines. An outline's hull is boiled down to its most significant corners (Douglas and
 * Peucker): four make a square seen from anywhere; of five one side may cut a corner off that is dead or hidden. */
#include <math.h>
#include <string.h>

#include "find.h"

static double cross(const double o[2], const double a[2], const double b[2]) {
    return (a[0] - o[0]) * (b[1] - o[1]) - (b[0] - o[0]) * (a[1] - o[1]);
}

static double apart(const double a[2], const double b[2]) {
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]));
}

static double twice_area(double c[4][2]) {
    return (c[2][0] - c[0][0]) * (c[3][1] - c[1][1]) - (c[3][0] - c[1][0]) * (c[2][1] - c[0][1]);
}

static double shortest_side(double c[4][2]) {
    return fmin(fmin(apart(c[0], c[1]), apart(c[1], c[2])), fmin(apart(c[2], c[3]), apart(c[3], c[0])));
}

/* Adds a corner to a convex chain, without those before it that are no corners then. */
static ptrdiff_t chain(double (*hull)[2], ptrdiff_t from, ptrdiff_t count, double x, double y) {
    const double next[2] = {x, y};
    if (count && hull[count - 1][0] == x && hull[count - 1][1] == y) return count;
    while (count >= from + 2 && cross(hull[count - 2], hull[count - 1], next) <= 0.0) count--;
    hull[count][0] = x, hull[count][1] = y;
    return count + 1;
}

/* The corners of an outline's hull, clockwise in the picture: down the right ends of its rows, and up the left ends.
 * `ends` (rows, 2) is room for these. */
static ptrdiff_t hull_of(const int32_t (*points)[2], const Outline *outline, int32_t (*ends)[2], double (*hull)[2]) {
    const int32_t rows = outline->bottom - outline->top + 1;
    for (int32_t y = 0; y < rows; y++) ends[y][0] = outline->right, ends[y][1] = outline->left;
    for (int32_t i = 0; i < outline->length; i++) {
        int32_t *const end = ends[points[i][1] - outline->top];
        if (points[i][0] < end[0]) end[0] = points[i][0];
        if (points[i][0] > end[1]) end[1] = points[i][0];
    }
    ptrdiff_t count = 0;
    for (int32_t y = 0; y < rows; y++) count = chain(hull, 0, count, ends[y][1], outline->top + y);
    const ptrdiff_t turn = count - 1;
    for (int32_t y = rows; y-- > 0;) count = chain(hull, turn, count, ends[y][0], outline->top + y);
    while (count > 1 && hull[count - 1][0] == hull[0][0] && hull[count - 1][1] == hull[0][1]) count--;
    return count;
}

/* Round a hull. (A remainder would take longer than all else that is asked of a corner.) */
static inline ptrdiff_t next_of(ptrdiff_t i, ptrdiff_t count) { return i + 1 < count ? i + 1 : 0; }

/* The hull's corner that is farthest from the chord between two of them, of those after `from` and before `to`. */
typedef struct {
    ptrdiff_t from, to, at;
    double away;
} Chord;

static Chord chord_of(double (*hull)[2], ptrdiff_t count, ptrdiff_t from, ptrdiff_t to) {
    Chord chord = {from, to, from, 0.0};
    for (ptrdiff_t i = next_of(from, count); i != to; i = next_of(i, count)) {
        const double away = fabs(cross(hull[from], hull[to], hull[i]));
        if (away > chord.away) chord.away = away, chord.at = i;
    }
    if (chord.away > 0.0) chord.away /= apart(hull[from], hull[to]);
    return chord;
}

static ptrdiff_t farthest_from(double (*hull)[2], ptrdiff_t count, ptrdiff_t from) {
    ptrdiff_t farthest = from;
    double most = 0.0;
    for (ptrdiff_t i = next_of(from, count); i != from; i = next_of(i, count)) {
        const double x = hull[i][0] - hull[from][0], y = hull[i][1] - hull[from][1], away = x * x + y * y;
        if (away > most) most = away, farthest = i;
    }
    return farthest;
}

/* The hull's (count, 2) most significant corners: four of them, five, and how far out the fourth to the sixth are. */
typedef struct {
    double four[4][2], five[5][2], away[3];
} Significant;

static void significant(double (*hull)[2], ptrdiff_t count, Significant *found) {
    Chord chords[6];
    const ptrdiff_t first = farthest_from(hull, count, farthest_from(hull, count, 0));
    const ptrdiff_t second = farthest_from(hull, count, first);
    chords[0] = chord_of(hull, count, first, second);
    chords[1] = chord_of(hull, count, second, first);
    found->away[0] = found->away[1] = found->away[2] = 0.0;
    for (int n = 2; n < 6; n++) {
        int best = 0;
        for (int k = 1; k < n; k++)
            if (chords[k].away > chords[best].away) best = k;
        const Chord split = chords[best];
        if (!(split.away > 0.0)) return;
        if (n > 2) found->away[n - 3] = split.away;
        if (n == 5) return;
        memmove(chords + best + 2, chords + best + 1, sizeof(Chord) * (size_t)(n - best - 1));
        chords[best] = chord_of(hull, count, split.from, split.at);
        chords[best + 1] = chord_of(hull, count, split.at, split.to);
        for (int k = 0; k <= n && n > 2; k++)
            memcpy(n == 3 ? found->four[k] : found->five[k], hull[chords[k].from], sizeof(double[2]));
    }
}

/* The quad of a pentagon whose one side cuts off its corner, dead or hidden. False where no side does. */
static bool with_corner(double five[5][2], double size, const Limits *limits, double four[4][2]) {
    double least = limits->max_cut_off * size * size;
    bool found = false;
    for (int k = 0; k < 5; k++) { /* bc is to go: ab and dc meet */
        const double *a = five[k], *b = five[(k + 1) % 5], *c = five[(k + 2) % 5], *d = five[(k + 3) % 5];
        const double turn = (b[0] - a[0]) * (c[1] - d[1]) - (b[1] - a[1]) * (c[0] - d[0]);
        if (fabs(turn) < 1e-9) continue;
        const double share = ((d[0] - a[0]) * (c[1] - d[1]) - (d[1] - a[1]) * (c[0] - d[0])) / turn;
        const double at[2] = {a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])};
        const double added = 0.5 * fabs(cross(at, c, b));
        /* Beyond b and beyond c, else they meet on the other side. */
        const bool beyond = share > 1.0 && (at[0] - c[0]) * (c[0] - d[0]) + (at[1] - c[1]) * (c[1] - d[1]) > 0.0;
        if (!(beyond && added < least)) continue;
        const double *after = five[(k + 4) % 5];
        const double quad[4][2] = {{at[0], at[1]}, {d[0], d[1]}, {after[0], after[1]}, {a[0], a[1]}};
        memcpy(four, quad, sizeof quad);
        least = added;
        found = true;
    }
    return found && shortest_side(four) >= limits->min_side * size;
}

/* Corners of the four-sided figure that the hull of an outline is about. False where it is none. */
static bool four_sides_of(double (*hull)[2], ptrdiff_t count, double size, const Limits *limits, double corners[4][2]) {
    Significant found;
    const double least = limits->significant * size, *const away = found.away;
    significant(hull, count, &found);
    if (away[1] > least && away[2] <= fmax(least, limits->alike * away[1]) &&
        with_corner(found.five, size, limits, corners))
        return true;
    if (!(away[0] > least)) return false;
    memcpy(corners, found.four, sizeof found.four);
    /* With a side this short it is a triangle with a corner cut off. */
    return shortest_side(corners) > limits->min_side * size;
}

/* Clockwise in the picture, first the corner nearest the top left. */
static void put_in_order(double corners[4][2]) {
    double ordered[4][2];
    const bool clockwise = twice_area(corners) > 0.0;
    int nearest = 0;
    for (int k = 0; k < 4; k++) memcpy(ordered[k], corners[clockwise ? k : 3 - k], sizeof ordered[k]);
    for (int k = 1; k < 4; k++)
        if (ordered[k][0] + ordered[k][1] < ordered[nearest][0] + ordered[nearest][1]) nearest = k;
    for (int k = 0; k < 4; k++) memcpy(corners[k], ordered[(nearest + k) % 4], sizeof corners[k]);
}

bool ledpi_square_of(const int32_t (*points)[2], const Outline *outline, double scale, const Limits *limits,
                     int32_t (*ends)[2], double (*hull)[2], Square *square) {
    const double area = outline->area, size = sqrt(area);
    const ptrdiff_t count = hull_of(points, outline, ends, hull);
    double of_hull = 0.0, middle[2] = {0.0, 0.0};
    for (ptrdiff_t i = 2; i < count; i++) of_hull += 0.5 * cross(hull[0], hull[i - 1], hull[i]);
    double (*const corners)[2] = square->corners;
    if (area < limits->min_solidity * of_hull || !four_sides_of(hull, count, size, limits, corners)) return false;
    const double of_quad = 0.5 * fabs(twice_area(corners));
    square->misfit = fabs(log(fmax(of_quad, 1e-3) / area));
    if (square->misfit > limits->max_misfit + limits->pixel_misfit / size) return false;
    /* An outline runs through the centres of the outermost lit pixels: half a pixel inside the edge. */
    const double growth = 1.0 + 1.0 / fmax(2.0, sqrt(of_quad));
    for (int k = 0; k < 8; k++) middle[k % 2] += 0.25 * corners[k / 2][k % 2];
    for (int k = 0; k < 8; k++) {
        const double grown = middle[k % 2] + (corners[k / 2][k % 2] - middle[k % 2]) * growth;
        corners[k / 2][k % 2] = (grown + 0.5) * scale - 0.5;
    }
    put_in_order(corners);
    square->side_px = (sqrt(of_quad) + 1.0) * scale;
    square->tolerance_px = limits->tolerance * scale;
    return true;
}
