/* Spots, and those that are alike and neighbours: `spots_in` and `groups` of decode/finding/spots.py. */
#include <math.h>
#include <string.h>

#include "find.h"
#include "wide.h"

/* Which of a row's pixels, AROUND from either end, are as bright as any beside them, and brighter than `least`. */
static inline void tops_in(const uint8_t *here, ptrdiff_t width, uint8_t least, uint8_t *restrict tops) {
    const uint8_t *const over = here - width, *const under = here + width;
    for (ptrdiff_t x = AROUND; x < width - AROUND; x++) {
        const uint8_t own = here[x];
        tops[x] = (own > least) & (own > over[x - 1]) & (own > over[x]) & (own > over[x + 1]) & (own > here[x - 1]) &
                  (own >= here[x + 1]) & (own >= under[x - 1]) & (own >= under[x]) & (own >= under[x + 1]);
    }
}

/* Whether what is AROUND a pixel is that much darker. */
static bool stands_out(const uint8_t *pixel, ptrdiff_t width, double max_around) {
    int sum = 0;
    for (ptrdiff_t k = -AROUND; k < AROUND; k++) /* four sides, each without its last corner */
        sum += pixel[-AROUND * width + k] + pixel[k * width + AROUND] + pixel[AROUND * width - k] + pixel[-k * width - AROUND];
    return sum < max_around * (8 * AROUND) * *pixel;
}

/* How far the pixel at x, y is above the darkest of those around, where it is lit by `share` of their contrast; else 0. */
static int lit_by(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, ptrdiff_t x, ptrdiff_t y, int share, int least) {
    const ptrdiff_t left = x < REACH ? 0 : x - REACH, right = x + REACH < width ? x + REACH : width - 1;
    const ptrdiff_t top = y < REACH ? 0 : y - REACH, bottom = y + REACH < height ? y + REACH : height - 1;
    uint8_t darkest = 255, brightest = 0;
    for (ptrdiff_t row = top; row <= bottom; row++)
        for (ptrdiff_t column = left; column <= right; column++) {
            const uint8_t here = picture[row * width + column];
            darkest = here < darkest ? here : darkest;
            brightest = here > brightest ? here : brightest;
        }
    const int above = picture[y * width + x] - darkest, threshold = ((brightest - darkest) * share) >> 8;
    return above > threshold && above > least ? above : 0;
}

LEDPI_WIDE_BYTES ptrdiff_t ledpi_spots(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, int share,
                                       const Limits *limits, uint8_t *row, Spot *spots) {
    const int least = (int)limits->min_contrast;
    ptrdiff_t count = 0;
    memset(row, 0, (size_t)width);
    for (ptrdiff_t y = AROUND; y < height - AROUND; y++) {
        const uint8_t *const here = picture + y * width;
        tops_in(here, width, (uint8_t)least, row);
        for (const uint8_t *top = row; (top = memchr(top, 1, (size_t)(row + width - top))) != NULL; top++) {
            const ptrdiff_t x = top - row;
            if (!stands_out(here + x, width, limits->max_around)) continue;
            const int above = lit_by(picture, height, width, x, y, share, least);
            if (!above) continue;
            spots[count++] = (Spot){(double)x, (double)y, above};
            if (count > MAX_SPOTS) return count;
        }
    }
    return count;
}

static bool alike(const Spot *a, const Spot *b, const Limits *limits) {
    return fmax(a->height, b->height) < limits->like_spots * fmin(a->height, b->height);
}

/* The square of the distance. */
static double apart(const Spot *a, const Spot *b) {
    const double x = a->x - b->x, y = a->y - b->y;
    return x * x + y * y;
}

/* The square of the distance from a spot to the nearest that is alike. They come row by row: from where one is further up or
 * down than the nearest so far, all are further off. */
static double nearest_to(const Spot *spots, ptrdiff_t count, ptrdiff_t own, const Limits *limits) {
    double least = HUGE_VAL;
    for (int way = -1; way <= 1; way += 2)
        for (ptrdiff_t k = own + way; k >= 0 && k < count; k += way) {
            const double rows = spots[k].y - spots[own].y;
            if (rows * rows > least) break;
            if (alike(spots + own, spots + k, limits)) least = fmin(least, apart(spots + own, spots + k));
        }
    return least;
}

static ptrdiff_t first_of(const ptrdiff_t *before, ptrdiff_t spot) {
    while (before[spot] != spot) spot = before[spot];
    return spot;
}

ptrdiff_t ledpi_groups(const Spot *spots, ptrdiff_t count, ptrdiff_t least, ptrdiff_t most, const Limits *limits,
                       Spot *members, double *groups) {
    double nearest[MAX_SPOTS];
    ptrdiff_t before[MAX_SPOTS], sizes[MAX_SPOTS] = {0}, found = 0;
    double number = 0.0;
    if (count < least || count > MAX_SPOTS) return 0;
    for (ptrdiff_t i = 0; i < count; i++) {
        before[i] = i;
        nearest[i] = nearest_to(spots, count, i, limits);
    }
    for (ptrdiff_t i = 0; i < count; i++)
        for (ptrdiff_t k = i; k-- > 0;) {
            const double up = spots[i].y - spots[k].y;
            if (up * up > limits->link * limits->link * nearest[i]) break;
            if (!alike(spots + i, spots + k, limits)) continue;
            if (!(apart(spots + i, spots + k) < limits->link * limits->link * fmin(nearest[i], nearest[k]))) continue;
            const ptrdiff_t a = first_of(before, i), b = first_of(before, k);
            before[a > b ? a : b] = a > b ? b : a;
        }
    for (ptrdiff_t i = 0; i < count; i++) sizes[first_of(before, i)]++;
    for (ptrdiff_t first = 0; first < count; first++) {
        if (sizes[first] < least || sizes[first] >= most) continue;
        for (ptrdiff_t i = first; i < count; i++) {
            if (first_of(before, i) != first) continue;
            members[found] = spots[i];
            groups[found++] = number;
        }
        number += 1.0;
    }
    return found;
}
