/* Outlines of what is lit: things are told apart by the runs of their rows, and only around those that may be panels is it
 * followed who is a neighbour of whom. As decode/outlines.py has it from OpenCV. */
#include "outlines.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>

/* Pixels side by side that are lit, from … to − 1, and the thing that they belong to. */
typedef struct {
    int32_t from, to, thing;
} Run;

/* What is connected. `same_as` is the number of another thing that it turned out to be a part of, or its own. */
typedef struct {
    int32_t same_as, left, top, right, bottom, lit, first; /* the first pixel of its top row; how many are lit */
} Thing;

/* The first pixel from x on that is lit otherwise than `lit`; `width` where there is none. */
static inline int32_t next_change(const uint8_t *row, int32_t x, int32_t width, bool lit) {
    uint64_t eight;
    for (const uint64_t all = lit ? ~(uint64_t)0 : 0; x + 8 <= width; x += 8) {
        memcpy(&eight, row + x, 8);
        if (eight == all) continue;
#if defined(__GNUC__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
        return x + (__builtin_ctzll(eight ^ all) >> 3);
#else
        break;
#endif
    }
    while (x < width && (row[x] != 0) == lit) x++;
    return x;
}

static int32_t whole_of(Thing *things, int32_t thing) {
    while (things[thing].same_as != thing) thing = things[thing].same_as = things[things[thing].same_as].same_as;
    return thing;
}

static int32_t smaller(int32_t a, int32_t b) { return a < b ? a : b; }
static int32_t larger(int32_t a, int32_t b) { return a > b ? a : b; }

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
        for (int32_t x = next_change(lit, 0, width, false); x < width; x = next_change(lit, x, width, false)) {
            Run *const run = here + count_here++;
            *run = (Run){x, next_change(lit, x, width, true), -1};
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

/* The outlines of what is lit in a picture of 0 and 255 (height, width), as far as they are wanted: the way around a thing's
 * box is not shorter than `shortest`, its width and height not less than `narrowest`, the outline's area at least
 * `least_area` of the box's, and of what is within `least_lit` is lit. Spots are things with a way around the box from
 * `shortest_spot` to below `longest_spot`; of them the middle of the box and the outline's length are told. `runs` (2, width), `things`, `outlines` and `spots` (most) are room; `most` is as
 * many as there can be. Returns how many; `counts`: how many are but for touching the picture's border, and the spots. */
ptrdiff_t ledpi_outlines(const uint8_t *lit, ptrdiff_t height, ptrdiff_t width, int32_t shortest, int32_t narrowest,
                         double least_area, double least_lit, int32_t shortest_spot, int32_t longest_spot, Run *runs,
                         Thing *things, int32_t (*points)[2], ptrdiff_t room, Outline *outlines, ptrdiff_t most,
                         double (*spots)[3], ptrdiff_t counts[2]) {
    const int32_t count = tell_apart(lit, (int32_t)height, (int32_t)width, runs, things, (int32_t)most);
    ptrdiff_t kept = 0, first = 0;
    counts[0] = counts[1] = 0;
    for (int32_t i = 0; i < count; i++) {
        const Thing *own = things + i;
        if (own->same_as != i) continue;
        const int32_t across = own->right - own->left + 1, down = own->bottom - own->top + 1;
        const int32_t around = 2 * (across + down) - 4;
        const bool wanted = around >= shortest && across >= narrowest && down >= narrowest;
        const bool small = around >= shortest_spot && around < longest_spot;
        if (own->left <= 0 || own->top <= 0 || own->right + 1 >= width || own->bottom + 1 >= height) {
            counts[0] += wanted;
            continue;
        }
        if (!wanted && !small) continue;
        Outline *const outline = outlines + kept;
        const int32_t length = follow(lit, width, own, points + first, room - first, &outline->area);
        if (small) {
            double *spot = spots[counts[1]++];
            spot[0] = 0.5 * (own->left + own->right);
            spot[1] = 0.5 * (own->top + own->bottom);
            spot[2] = length;
        }
        if (!wanted || first + length > room || outline->area < least_area * across * down) continue;
        /* Pick's theorem: so many pixels are on the outline or within. */
        if (own->lit < least_lit * (outline->area + 0.5 * length + 1.0)) continue;
        outline->first = (int32_t)first, outline->length = length;
        outline->left = own->left, outline->right = own->right;
        outline->top = own->top, outline->bottom = own->bottom;
        first += length;
        kept++;
    }
    return kept;
}
