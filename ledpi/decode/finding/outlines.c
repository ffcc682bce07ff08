/* Outlines of what is lit: things are separated by the runs of their rows, and only around those that may be panels is it
 * followed who is a neighbour of whom. */
#include <string.h>

#include "find.h"

/* The first pixel from x on that is `lit` or not; `width` where there is none. */
static inline int32_t next_that_is(bool lit, const uint8_t *row, int32_t x, int32_t width) {
    const uint8_t *const found = memchr(row + x, lit ? 255 : 0, (size_t)(width - x));
    return found ? (int32_t)(found - row) : width;
}

static int32_t whole_of(Thing *things, int32_t thing) {
    while (things[thing].same_as != thing) thing = things[thing].same_as = things[things[thing].same_as].same_as;
    return thing;
}

static inline int32_t smaller(int32_t a, int32_t b) { return a < b ? a : b; }
static inline int32_t larger(int32_t a, int32_t b) { return a > b ? a : b; }

/* Makes one thing of two; returns its number. */
static int32_t unite(Thing *things, int32_t a, int32_t b) {
    a = whole_of(things, a), b = whole_of(things, b);
    if (a == b) return a;
    if (things[b].top < things[a].top) {
        const int32_t lower = a;
        a = b, b = lower;
    }
    Thing *const one = things + a;
    const Thing other = things[b];
    things[b].same_as = a;
    one->left = smaller(one->left, other.left);
    one->right = larger(one->right, other.right);
    one->bottom = larger(one->bottom, other.bottom);
    one->lit += other.lit;
    return a;
}

/* Tells the `things` (most) in a picture apart. `runs` (2, width) is room. Returns how many they are, parts included. */
static int32_t tell_apart(const uint8_t *lit, int32_t height, int32_t width, Run *runs, Thing *things, int32_t most) {
    Run *above = runs, *here = runs + width;
    int32_t count = 0, count_above = 0;
    for (int32_t y = 0; y < height; y++, lit += width) {
        int32_t count_here = 0, k = 0;
        for (int32_t x = next_that_is(true, lit, 0, width); x < width; x = next_that_is(true, lit, x, width)) {
            Run *const run = here + count_here++;
            *run = (Run){x, next_that_is(false, lit, x, width), -1};
            x = run->to;
            while (k < count_above && above[k].to < run->from) k++; /* one that ends there touches at a corner */
            for (int32_t j = k; j < count_above && above[j].from <= run->to; j++)
                run->thing = run->thing < 0 ? whole_of(things, above[j].thing) : unite(things, run->thing, above[j].thing);
            if (run->thing < 0) {
                if (count == most) return count;
                things[count] = (Thing){count, run->from, y, run->from, y, 0, run->from};
                run->thing = count++;
            }
            Thing *const own = things + run->thing;
            own->left = smaller(own->left, run->from);
            own->right = larger(own->right, run->to - 1);
            own->bottom = y;
            own->lit += run->to - run->from;
        }
        Run *const done = above;
        above = here, here = done, count_above = count_here;
    }
    return count;
}

/* Follows a thing's outline, against the clock from the first pixel of its top row (Moore's neighbours). It must not touch
 * the picture's border. Points beyond `room` are left out. Returns how many there are; twice their `area` is kept too. */
static int32_t follow(const uint8_t *lit, ptrdiff_t width, const Thing *thing, int32_t (*points)[2], ptrdiff_t room,
                      double *area) {
    static const int32_t right[8] = {1, 1, 0, -1, -1, -1, 0, 1}, down[8] = {0, -1, -1, -1, 0, 1, 1, 1};
    ptrdiff_t way[8];
    for (int s = 0; s < 8; s++) way[s] = down[s] * width + right[s];
    int32_t x = thing->first, y = thing->top, length = 0;
    const uint8_t *const start = lit + y * width + x, *here = start;
    int64_t twice_area = 0;
    int from = 4, first = -1; /* the way to a neighbour that is dark; the way that was gone first */
    for (;;) {
        unsigned neighbours = 0;
        for (int s = 0; s < 8; s++) neighbours |= (unsigned)(here[way[s]] & 1) << s;
        neighbours |= neighbours << 8;
        const unsigned onward = neighbours >> from;
        const int s = onward ? (from + __builtin_ctz(onward)) & 7 : -1;
        if (here == start && s == first) break; /* the first step again */
        if (length < room) points[length][0] = x, points[length][1] = y;
        length++;
        if (s < 0) break; /* alone */
        if (first < 0) first = s;
        twice_area += (int64_t)x * down[s] - (int64_t)y * right[s];
        here += way[s], x += right[s], y += down[s];
        from = (s + 6) & 7; /* the next after the one that was seen dark last */
    }
    *area = 0.5 * (double)(twice_area < 0 ? -twice_area : twice_area);
    return length;
}

Outlined ledpi_outlines(const uint8_t *lit, ptrdiff_t height, ptrdiff_t width, int32_t shortest, const Limits *limits,
                        Run *runs, Thing *things, int32_t (*points)[2], ptrdiff_t room, Outline *outlines,
                        ptrdiff_t most) {
    const int32_t count = tell_apart(lit, (int32_t)height, (int32_t)width, runs, things, (int32_t)most);
    Outlined found = {0, 0};
    ptrdiff_t first = 0;
    for (int32_t i = 0; i < count; i++) {
        const Thing *own = things + i;
        if (own->same_as != i) continue;
        const int32_t across = own->right - own->left + 1, down = own->bottom - own->top + 1;
        const int32_t around = 2 * (across + down) - 4;
        const bool wanted = around >= shortest && across >= limits->narrowest && down >= limits->narrowest;
        if (own->left <= 0 || own->top <= 0 || own->right + 1 >= width || own->bottom + 1 >= height) {
            found.at_border += wanted;
            continue;
        }
        if (!wanted) continue;
        double area;
        const int32_t length = follow(lit, width, own, points + first, room - first, &area);
        if (first + length > room || area < limits->min_area * across * down) continue;
        /* Pick's theorem: so many pixels are on the outline or within. */
        if (own->lit < limits->min_lit * (area + 0.5 * length + 1.0)) continue;
        outlines[found.outlines++] = (Outline){(int32_t)first, length, own->top, own->bottom, own->left, own->right, area};
        first += length;
    }
    return found;
}
