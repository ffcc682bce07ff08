/* Binarization: the lit pixels of a picture. Rows are walked byte beside byte, with nothing that
 * depends on the one before, so that a compiler can take many at once. */
#include <string.h>

#include "find.h"
#include "simd.h"

static inline uint8_t larger(uint8_t a, uint8_t b) { return a > b ? a : b; }
static inline uint8_t smaller(uint8_t a, uint8_t b) { return a < b ? a : b; }

/* Each of `count` bytes and the one `on` bytes further, the larger or the smaller of them. */
static inline void join(const uint8_t *restrict bytes, ptrdiff_t on, ptrdiff_t count, bool most, uint8_t *restrict into) {
    const uint8_t *const further = bytes + on;
    if (most)
        for (ptrdiff_t i = 0; i < count; i++) into[i] = larger(bytes[i], further[i]);
    else
        for (ptrdiff_t i = 0; i < count; i++) into[i] = smaller(bytes[i], further[i]);
}

/* The extreme of each SPAN values that follow each other, `on` bytes apart: of pairs, of pairs of pairs, of eight, and of
 * two eights that overlap. `bytes` are overwritten. */
static inline void join_span(uint8_t *restrict bytes, ptrdiff_t on, ptrdiff_t count, bool most, uint8_t *restrict into) {
    join(bytes, on, count - on, most, into);
    join(into, 2 * on, count - 3 * on, most, bytes);
    join(bytes, 4 * on, count - 7 * on, most, into);
    join(into, (SPAN - 8) * on, count - (SPAN - 1) * on, most, bytes);
}

/* In the rows from `first` on, the extremes `into` (ROWS, stride) of the SPAN × SPAN pixels around each. Beyond the picture
 * there is nothing that could be one. `work` (STRIP, stride) is room. */
static inline void extremes(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, ptrdiff_t first, bool most,
                            uint8_t *work, uint8_t *into) {
    const int nothing = most ? 0 : 255;
    const ptrdiff_t stride = width + 2 * REACH;
    memset(into, nothing, (size_t)(STRIP * stride));
    for (ptrdiff_t i = 0, y = first - REACH; i < STRIP; i++, y++)
        if (y >= 0 && y < height) memcpy(into + i * stride + REACH, picture + y * width, (size_t)width);
    join_span(into, stride, STRIP * stride, most, work);
    join_span(into, 1, ROWS * stride, most, work);
}

/* Contrast of `count` pixels: how far they, and the brightest ones around, are above the darkest around. */
static inline void compare(const uint8_t *picture, const uint8_t *brightest, const uint8_t *darkest, ptrdiff_t count,
                    uint8_t *restrict above, uint8_t *restrict contrast) {
    for (ptrdiff_t i = 0; i < count; i++) {
        above[i] = picture[i] - darkest[i];
        contrast[i] = brightest[i] - darkest[i];
    }
}

/* A few rows at once, which stay in the cache. */
LEDPI_SIMD_BYTES void ledpi_contrast(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, uint8_t *room,
                                     uint8_t *above, uint8_t *contrast) {
    const ptrdiff_t stride = width + 2 * REACH;
    uint8_t *const brightest = room, *const darkest = room + STRIP * stride, *const work = darkest + STRIP * stride;
    for (ptrdiff_t first = 0; first < height; first += ROWS) {
        extremes(picture, height, width, first, true, work, brightest);
        extremes(picture, height, width, first, false, work, darkest);
        for (ptrdiff_t y = first; y < first + ROWS && y < height; y++) {
            const ptrdiff_t at = y * width, from = (y - first) * stride;
            compare(picture + at, brightest + from, darkest + from, width, above + at, contrast + at);
        }
    }
}

/* The brightest (or darkest) among each pixel and its eight neighbours; there are none beyond the picture. `row` (width + 2). */
static inline void neighbours(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, bool most, uint8_t *row,
                              uint8_t *into) {
    for (ptrdiff_t y = 0; y < height; y++) {
        const uint8_t *here = picture + y * width;
        const uint8_t *above = y ? here - width : here, *below = y + 1 < height ? here + width : here;
        uint8_t *const out = into + y * width;
        if (most)
            for (ptrdiff_t x = 0; x < width; x++) row[x + 1] = larger(larger(above[x], here[x]), below[x]);
        else
            for (ptrdiff_t x = 0; x < width; x++) row[x + 1] = smaller(smaller(above[x], here[x]), below[x]);
        row[0] = row[1], row[width + 1] = row[width];
        if (most)
            for (ptrdiff_t x = 0; x < width; x++) out[x] = larger(larger(row[x], row[x + 1]), row[x + 2]);
        else
            for (ptrdiff_t x = 0; x < width; x++) out[x] = smaller(smaller(row[x], row[x + 1]), row[x + 2]);
    }
}

LEDPI_SIMD_BYTES void ledpi_close(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, uint8_t *room,
                                  uint8_t *closed) {
    uint8_t *const row = room + height * width;
    neighbours(picture, height, width, true, row, room);
    neighbours(room, height, width, false, row, closed);
}

LEDPI_SIMD_BYTES void ledpi_brighter(const uint8_t *closed, ptrdiff_t count, int level, uint8_t *lit) {
    const uint8_t most = (uint8_t)level;
    for (ptrdiff_t i = 0; i < count; i++) lit[i] = closed[i] > most ? 255 : 0;
}

LEDPI_SIMD_BYTES void ledpi_lit(const uint8_t *above, const uint8_t *contrast, ptrdiff_t height, ptrdiff_t width, int share,
                                const Limits *limits, bool opened, uint8_t *room, uint8_t *lit) {
    uint8_t *const row = room + height * width;
    const uint8_t least = (uint8_t)limits->min_contrast;
    for (ptrdiff_t i = 0; i < height * width; i++) {
        const uint8_t threshold = (uint8_t)((uint16_t)(contrast[i] * share) >> 8);
        lit[i] = above[i] > larger(threshold, least) ? 255 : 0;
    }
    neighbours(lit, height, width, true, row, room);
    neighbours(room, height, width, false, row, lit);
    if (!opened) return;
    neighbours(lit, height, width, false, row, room);
    neighbours(room, height, width, true, row, lit);
}
