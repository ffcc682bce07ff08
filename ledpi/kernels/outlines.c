/* Outlines of what is lit: Suzuki and Abe's border following (1985), as decode/outlines.py has it from OpenCV. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "outlines.h"

/* `mark` is 0 where nothing is lit, 1 where no border has passed, else the number of the component + 2; less than 0 where
 * a border has passed to the left of something dark. A row has `stride` marks, of which the outermost are dark. */
typedef struct {
    int32_t *mark;
    ptrdiff_t stride;
    ptrdiff_t way[16]; /* to the neighbours, twice around: right, then against the clock */
    int32_t (*points)[2];
    ptrdiff_t count, room;
} Borders;

static const int32_t right[8] = {1, 1, 0, -1, -1, -1, 0, 1}, down[8] = {0, -1, -1, -1, 0, 1, 1, 1};

/* Follows a border from the pixel (x, y); points are kept of an outer one, where there is room. Returns its length. */
static int32_t follow(Borders *borders, int32_t x, int32_t y, int32_t number, bool hole, Outline *outline) {
    const ptrdiff_t *const way = borders->way;
    int32_t *const start = borders->mark + (y + 1) * borders->stride + x + 1, *here = start, *before;
    const int32_t passed = number + 2;
    int32_t length = 0;
    int s = hole ? 0 : 4;
    const int around = s;
    do {
        s = (s - 1) & 7;
        before = start + way[s];
    } while (*before == 0 && s != around);
    const bool alone = *before == 0;
    double twice_area = 0.0;
    for (;;) {
        const int end = s;
        if (!alone) {
            while (here[way[++s]] == 0) {}
            s &= 7;
        }
        if (alone || (unsigned)(s - 1) < (unsigned)end)
            *here = -passed;
        else if (*here == 1)
            *here = passed;
        length++;
        if (!hole) {
            if (borders->count < borders->room) {
                borders->points[borders->count][0] = x;
                borders->points[borders->count++][1] = y;
            }
            outline->left = x < outline->left ? x : outline->left;
            outline->right = x > outline->right ? x : outline->right;
            outline->bottom = y > outline->bottom ? y : outline->bottom;
            twice_area += (double)x * down[s] - (double)y * right[s];
        }
        if (alone || (here + way[s] == start && here == before)) break;
        here += way[s];
        x += right[s];
        y += down[s];
        s = (s + 4) & 7;
    }
    if (!hole) outline->area = alone ? 0.0 : 0.5 * (twice_area < 0.0 ? -twice_area : twice_area);
    return length;
}

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

/* What is looked at more closely: the shortest outline, how long a hole's may be beside the outer one, the narrowest
 * width and height in pixels, and the least area beside that of the box around. And what is a spot: from the shortest to
 * below the longest outline. */
typedef struct {
    int32_t shortest, narrowest;
    double longest_hole, least_area;
    int32_t shortest_spot, longest_spot;
} Wanted;

/* The middles of spots, x and y, and how long their outlines are. */
typedef struct {
    double (*spots)[3];
    ptrdiff_t count;
} Spots;

/* Moves the outlines that are wanted to the front; counts those that are but for the picture's border. Spots apart. */
static ptrdiff_t choose(Outline *outlines, ptrdiff_t count, const Wanted *wanted, ptrdiff_t height, ptrdiff_t width,
                        ptrdiff_t *at_border, Spots *spots) {
    ptrdiff_t kept = 0;
    *at_border = 0;
    for (const Outline *own = outlines; own < outlines + count; own++) {
        const int32_t across = own->right - own->left + 1, down = own->bottom - own->top + 1;
        if (own->length >= wanted->shortest_spot && own->length < wanted->longest_spot) {
            double *spot = spots->spots[spots->count++];
            spot[0] = 0.5 * (own->left + own->right);
            spot[1] = 0.5 * (own->top + own->bottom);
            spot[2] = own->length;
        }
        if (own->length < wanted->shortest || own->longest_hole >= wanted->longest_hole * own->length) continue;
        if (across < wanted->narrowest || down < wanted->narrowest) continue;
        if (own->left <= 0 || own->top <= 0 || own->right + 1 >= width || own->bottom + 1 >= height)
            ++*at_border;
        else if (own->area >= wanted->least_area * across * down)
            outlines[kept++] = *own;
    }
    return kept;
}

/* The outlines of what is lit in a picture of 0 and 255 (height, width), as far as they are wanted. `mark` (height + 2,
 * width + 2), `outlines` (most) and `spots` (most) are room; `most` is as many as there can be. Returns how many; `counts`: how many
 * are but for touching the picture's border, and the spots. */
ptrdiff_t ledpi_outlines(const uint8_t *lit, ptrdiff_t height, ptrdiff_t width, int32_t shortest, int32_t narrowest,
                         double longest_hole, double least_area, int32_t shortest_spot, int32_t longest_spot,
                         int32_t *mark, int32_t (*points)[2], ptrdiff_t room, Outline *outlines, ptrdiff_t most,
                         double (*spots)[3], ptrdiff_t counts[2]) {
    const Wanted wanted = {shortest, narrowest, longest_hole, least_area, shortest_spot, longest_spot};
    Spots small = {spots, 0};
    Borders borders = {mark, width + 2, {0}, points, 0, room};
    for (int s = 0; s < 16; s++) borders.way[s] = down[s & 7] * borders.stride + right[s & 7];
    int32_t count = 0;
    memset(mark, 0, sizeof(int32_t) * (size_t)(borders.stride * (height + 2)));
    for (ptrdiff_t y = 0; y < height; y++)
        for (ptrdiff_t x = 0; x < width; x++) mark[(y + 1) * borders.stride + x + 1] = lit[y * width + x] & 1;
    for (int32_t y = 0; y < height; y++) {
        const uint8_t *row = lit + y * width;
        const int32_t *marks = mark + (y + 1) * borders.stride + 1;
        for (int32_t x = next_change(row, 0, (int32_t)width, false); x < width;) {
            if (marks[x] == 1) {
                if (count == most) break;
                Outline *own = outlines + count;
                *own = (Outline){(int32_t)borders.count, 0, x, y, x, y, 0, 0.0};
                own->length = follow(&borders, x, y, count++, false, own);
                if (borders.count == room) own->length = 0; /* cut short */
                if (own->length < shortest) borders.count = own->first;
            }
            Outline *own = outlines + (marks[x] < 0 ? -marks[x] : marks[x]) - 2;
            x = next_change(row, x, (int32_t)width, true);
            if (marks[x - 1] > 0) {
                const int32_t length = follow(&borders, x - 1, y, (int32_t)(own - outlines), true, own);
                if (length > own->longest_hole) own->longest_hole = length;
            }
            x = next_change(row, x, (int32_t)width, false);
        }
    }
    count = (int32_t)choose(outlines, count, &wanted, height, width, &counts[0], &small);
    counts[1] = small.count;
    return count;
}
