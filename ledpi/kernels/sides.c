/* The four sides of quads: straight lines through what was found across them, corners. As decode/corners/sides.py does it. */
#include <math.h>

#include "kernels.h"

#define BIWEIGHT 4.7
#define LEAST_SPREAD_PX 0.03
#define MIN_STEP 0.3
#define MIN_EDGE 0.2

static double cross(Point a, Point b) { return a.x * b.y - a.y * b.x; }

static Point minus(Point a, Point b) { return (Point){a.x - b.x, a.y - b.y}; }

void ledpi_sides_of(const Point corners[4], Side sides[4]) {
    for (int k = 0; k < 4; k++) {
        Point along = minus(corners[(k + 1) & 3], corners[k]);
        double length = ledpi_length(along.x, along.y), scale = 1.0 / fmax(length, 1e-9);
        sides[k] = (Side){corners[k], along, {-along.y * scale, along.x * scale}, length};
    }
}

void ledpi_moved(const Side sides[4], const double middle[4], const double slope[4], Point corners[4]) {
    Point start[4], along[4];
    for (int k = 0; k < 4; k++) {
        double by = middle[k] - 0.5 * slope[k];
        Point inward = sides[k].inward;
        start[k] = (Point){sides[k].start.x + inward.x * by, sides[k].start.y + inward.y * by};
        along[k] = (Point){sides[k].along.x + inward.x * slope[k], sides[k].along.y + inward.y * slope[k]};
    }
    for (int k = 0; k < 4; k++) {
        int b = (k + 3) & 3;
        double share = cross(minus(start[k], start[b]), along[k]) / cross(along[b], along[k]);
        corners[k] = (Point){start[b].x + along[b].x * share, start[b].y + along[b].y * share};
    }
}

void ledpi_fit_line(const Shares *shares, const double *found, const double *weights, double *middle, double *slope) {
    double n = 0, x1 = 0, x2 = 0, y0 = 0, y1 = 0;
    for (ptrdiff_t p = 0; p < shares->count; p++) {
        double x = shares->share[p] - 0.5, w = weights[p], wx = w * x;
        n += w;
        x1 += wx;
        x2 += wx * x;
        y0 += w * found[p];
        y1 += wx * found[p];
    }
    *slope = (n * y1 - x1 * y0) / fmax(n * x2 - x1 * x1, 1e-12);
    *middle = (y0 - *slope * x1) / fmax(n, 1e-12);
}

/* Quickselect; what is not a number compares as nothing does, and only makes the order arbitrary. */
double ledpi_kth(double *numbers, ptrdiff_t count, ptrdiff_t k) {
    ptrdiff_t low = 0, high = count - 1;
    while (low < high) {
        double pivot = numbers[low + (high - low) / 2];
        numbers[low + (high - low) / 2] = numbers[high];
        ptrdiff_t less = low;
        for (ptrdiff_t i = low; i < high; i++) { /* without a branch, which would be guessed wrong every other time */
            double here = numbers[i];
            numbers[i] = numbers[less];
            numbers[less] = here;
            less += here < pivot;
        }
        numbers[high] = numbers[less];
        numbers[less] = pivot;
        if (less == k) break;
        if (less < k)
            low = less + 1;
        else
            high = less - 1;
    }
    return numbers[k];
}

/* The lower median of the good ones; infinite where there is none. */
static double median_of_good(ptrdiff_t count, const double *numbers, const bool *good) {
    double chosen[MOST_PROFILES];
    ptrdiff_t n = 0;
    for (ptrdiff_t p = 0; p < count; p++)
        if (good[p]) chosen[n++] = numbers[p];
    return n ? ledpi_kth(chosen, n, (n - 1) / 2) : INFINITY;
}

void ledpi_near_median(ptrdiff_t count, const double *found, const bool *good, double distance, double *weights) {
    double median = median_of_good(count, found, good);
    if (!isfinite(median)) median = 0.0;
    for (ptrdiff_t p = 0; p < count; p++) weights[p] = good[p] && fabs(found[p] - median) < distance ? 1.0 : 0.0;
}

double ledpi_deviation(const Shares *shares, const double *found, const bool *good, double middle, double slope,
                       double *weights) {
    double away[MOST_PROFILES];
    for (ptrdiff_t p = 0; p < shares->count; p++)
        away[p] = fabs(found[p] - middle - slope * (shares->share[p] - 0.5));
    double spread = fmin(1.4826 * median_of_good(shares->count, away, good), 1e3);
    double limit = BIWEIGHT * fmax(spread, LEAST_SPREAD_PX);
    for (ptrdiff_t p = 0; p < shares->count; p++) {
        double u = away[p] / limit, v = fmax(0.0, 1.0 - u * u);
        weights[p] = good[p] ? v * v : 0.0;
    }
    return spread;
}

bool ledpi_steps(ptrdiff_t count, const double *height, bool *good) {
    double ordered[4 * MOST_PROFILES];
    for (ptrdiff_t i = 0; i < 4 * count; i++) ordered[i] = height[i];
    double least = fmax(MIN_STEP * ledpi_kth(ordered, 4 * count, (ptrdiff_t)(0.9 * (double)(4 * count))), 1e-6);
    bool enough = true;
    for (int k = 0; k < 4; k++) {
        ptrdiff_t n = 0;
        for (ptrdiff_t p = 0; p < count; p++) n += good[k * count + p] = height[k * count + p] > least;
        enough = enough && (double)n >= MIN_EDGE * (double)count;
    }
    return enough;
}

double ledpi_area(const Point c[4]) { return 0.5 * cross(minus(c[2], c[0]), minus(c[3], c[1])); }

double ledpi_farthest(const Point a[4], const Point b[4]) {
    double farthest = 0.0;
    for (int k = 0; k < 4; k++) {
        double away = ledpi_length(a[k].x - b[k].x, a[k].y - b[k].y);
        if (!(away <= farthest)) farthest = away; /* also where it is not a number, which stays */
        if (isnan(farthest)) break;
    }
    return farthest;
}

void ledpi_unit_square_to(const Point c[4], double h[9]) {
    double dx1 = c[1].x - c[2].x, dx2 = c[3].x - c[2].x, dx3 = c[0].x - c[1].x + c[2].x - c[3].x;
    double dy1 = c[1].y - c[2].y, dy2 = c[3].y - c[2].y, dy3 = c[0].y - c[1].y + c[2].y - c[3].y;
    double det = dx1 * dy2 - dx2 * dy1;
    if (det == 0.0) det = NAN;
    double g = (dx3 * dy2 - dx2 * dy3) / det, k = (dx1 * dy3 - dx3 * dy1) / det;
    const double all[9] = {c[1].x - c[0].x + g * c[1].x, c[3].x - c[0].x + k * c[3].x, c[0].x,
                           c[1].y - c[0].y + g * c[1].y, c[3].y - c[0].y + k * c[3].y, c[0].y, g, k, 1.0};
    for (int i = 0; i < 9; i++) h[i] = all[i];
}
