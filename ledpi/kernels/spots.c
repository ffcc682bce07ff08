/* Spots that are alike and neighbours: `groups` of decode/spots.py. */
#include <math.h>

#include "find.h"


static bool alike(const Spot *a, const Spot *b, const Limits *limits) {
    return fmax(a->length, b->length) < limits->like_spots * fmin(a->length, b->length);
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
