/* Spots, and those that are alike and neighbours: `spots_in` and `groups` of decode/spots.py. */
#include <math.h>
#include <string.h>

#include "find.h"
#include "wide.h"

/* Which of a row's pixels, AROUND from either end, are lit and as bright as any beside them. */
static inline void tops_in(const uint8_t *here, const uint8_t *above, const uint8_t *contrast, ptrdiff_t width, int share,
                           uint8_t least, uint8_t *restrict tops) {
    const uint8_t *const over = here - width, *const under = here + width;
    for (ptrdiff_t x = AROUND; x < width - AROUND; x++) {
        const uint8_t own = here[x], threshold = (uint8_t)((uint16_t)(contrast[x] * share) >> 8);
        tops[x] = (above[x] > threshold) & (above[x] > least) & (own > over[x - 1]) & (own > over[x]) &
                  (own > over[x + 1]) & (own > here[x - 1]) & (own >= here[x + 1]) & (own >= under[x - 1]) &
                  (own >= under[x]) & (own >= under[x + 1]);
    }
}

/* Whether what is AROUND a pixel is that much darker. */
static bool stands_out(const uint8_t *pixel, ptrdiff_t width, double max_around) {
    int sum = 0;
    for (ptrdiff_t k = -AROUND; k < AROUND; k++) /* four sides, each without its last corner */
        sum += pixel[-AROUND * width + k] + pixel[k * width + AROUND] + pixel[AROUND * width - k] + pixel[-k * width - AROUND];
    return sum < max_around * (8 * AROUND) * *pixel;
}

LEDPI_WIDE_BYTES ptrdiff_t ledpi_spots(const uint8_t *picture, const uint8_t *above, const uint8_t *contrast,
                                       ptrdiff_t height, ptrdiff_t width, int share, const Limits *limits, uint8_t *row,
                                       Spot *spots) {
    ptrdiff_t count = 0;
    memset(row, 0, (size_t)width);
    for (ptrdiff_t y = AROUND; y < height - AROUND; y++) {
        const ptrdiff_t at = y * width;
        tops_in(picture + at, above + at, contrast + at, width, share, (uint8_t)limits->min_contrast, row);
        for (const uint8_t *top = row; (top = memchr(top, 1, (size_t)(row + width - top))) != NULL; top++) {
            const ptrdiff_t x = top - row;
            if (!stands_out(picture + at + x, width, limits->max_around)) continue;
            spots[count++] = (Spot){(double)x, (double)y, above[at + x]};
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
        nearest[i] = HUGE_VAL;
        for (ptrdiff_t k = 0; k < count; k++)
            if (k != i && alike(spots + i, spots + k, limits)) nearest[i] = fmin(nearest[i], apart(spots + i, spots + k));
    }
    for (ptrdiff_t i = 0; i < count; i++)
        for (ptrdiff_t k = 0; k < i; k++) {
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
