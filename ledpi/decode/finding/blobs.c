/* Bright blobs of a picture: runs of rows, joined where they touch. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "find.h"
#include "simd.h"

#define LEAST_AREA 5.0 /* pixels that have second moments worth the name */
#define LEAST_FULL 0.7 /* share of a parallelogram with its moments: what is bent or branched fills less */

/* The piece that a piece turned out to be a part of: the first of its blob. */
static int32_t first_of(BlobPiece *pieces, int32_t i) {
    while (pieces[i].part_of != i) i = pieces[i].part_of = pieces[pieces[i].part_of].part_of;
    return i;
}

/* Joins two pieces that are each the first of a blob. Returns the first of both. */
static int32_t join(BlobPiece *pieces, int32_t one, int32_t other) {
    if (one == other) return one;
    const int32_t first = one < other ? one : other, last = one < other ? other : one;
    for (int k = 0; k < LEDPI_BLOB; k++) pieces[first].sums[k] += pieces[last].sums[k];
    return pieces[last].part_of = first;
}

static void add_run(double *sums, ptrdiff_t row, const BlobRun *run) {
    const double y = (double)row, n = run->to - run->from, x = 0.5 * (run->from + run->to - 1);
    sums[0] += n, sums[1] += n * x, sums[2] += n * y;
    sums[3] += n * x * x + n * (n * n - 1.0) / 12.0, sums[4] += n * x * y, sums[5] += n * y * y;
}

typedef uint8_t Bytes __attribute__((vector_size(32), aligned(1)));

/* Takes out pixels that are lit by themselves, as noise leaves them: a third of all runs, and no blob. No other pixel has such a
 * one beside it, so it is all the same which is taken out first. */
LEDPI_SIMD_BYTES static void take_single_out(uint8_t *lit, ptrdiff_t height, ptrdiff_t width) {
    for (ptrdiff_t y = 1; y < height - 1; y++) {
        uint8_t *const row = lit + y * width;
        ptrdiff_t x = 1;
        for (; x + (ptrdiff_t)sizeof(Bytes) < width; x += (ptrdiff_t)sizeof(Bytes)) {
            const Bytes beside = *(const Bytes *)(row + x - 1) | *(const Bytes *)(row + x + 1);
            *(Bytes *)(row + x) &= beside | *(const Bytes *)(row + x - width) | *(const Bytes *)(row + x + width);
        }
        for (; x < width - 1; x++) row[x] &= row[x - 1] | row[x + 1] | row[x - width] | row[x + width];
    }
}

/* A bit of each of up to 64 pixels, the first one's lowest: of eight bytes at once by a product that adds each one's at its place. */
static uint64_t bits_of(const uint8_t *lit, ptrdiff_t count) {
    uint64_t bits = 0, bytes;
    ptrdiff_t x = 0;
    for (; x + 8 <= count && x < 64; x += 8) {
        memcpy(&bytes, lit + x, sizeof bytes);
        bits |= ((bytes & 0x0101010101010101) * 0x0102040810204080 >> 56) << x;
    }
    for (; x < count && x < 64; x++) bits |= (uint64_t)(lit[x] & 1) << x;
    return bits;
}

/* Puts a row's runs. Returns how many. */
static ptrdiff_t put_runs(const uint8_t *lit, ptrdiff_t width, BlobRun *runs) {
    ptrdiff_t ends = 0; /* so far: where a run begins, or is over */
    uint64_t before = 0;
    for (ptrdiff_t x = 0; x < width; x += 64) {
        const uint64_t bits = bits_of(lit + x, width - x);
        for (uint64_t changes = bits ^ (bits << 1 | before); changes; changes &= changes - 1, ends++) {
            const int32_t at = (int32_t)x + __builtin_ctzll(changes);
            *(ends % 2 ? &runs[ends / 2].to : &runs[ends / 2].from) = at; /* without a branch, which nothing foretells */
        }
        before = bits >> 63;
    }
    if (ends % 2) runs[ends++ / 2].to = (int32_t)width;
    return ends / 2;
}

/* Puts the pieces that rows, from the top down, add to: one begins where no run above touches. `runs` (2, width) are room. Returns
 * how many. */
static ptrdiff_t put_pieces(const uint8_t *lit, ptrdiff_t height, ptrdiff_t width, BlobRun *runs, ptrdiff_t most, BlobPiece *pieces) {
    ptrdiff_t count = 0, above_count = 0;
    BlobRun *row = runs, *above = runs + width;
    for (ptrdiff_t y = 0; y < height; y++) {
        const ptrdiff_t in_row = put_runs(lit + y * width, width, row);
        for (ptrdiff_t i = 0, k = 0; i < in_row; i++) {
            int32_t piece = -1;
            while (k < above_count && above[k].to <= row[i].from) k++;
            for (ptrdiff_t j = k; j < above_count && above[j].from < row[i].to; j++) {
                const int32_t touched = first_of(pieces, above[j].piece);
                piece = piece < 0 ? touched : join(pieces, piece, touched);
            }
            if (piece < 0) {
                if (count == most) return count;
                piece = (int32_t)count++;
                pieces[piece] = (BlobPiece){.part_of = piece};
            }
            add_run(pieces[piece].sums, y, row + i);
            row[i].piece = piece;
        }
        BlobRun *const done = row;
        row = above, above = done, above_count = in_row;
    }
    return count;
}

/* The moments of `sums` (6): of 1, x, y, x², xy, y². */
static Blob blob_of(const double *sums) {
    const double n = sums[0], x = sums[1] / n, y = sums[2] / n, pixel = 1.0 / 12.0;
    return (Blob){n, x, y, sums[3] / n - x * x + pixel, sums[4] / n - x * y, sums[5] / n - y * y + pixel};
}

static int from_the_top(const void *one, const void *other) {
    const double a = ((const Blob *)one)->y, b = ((const Blob *)other)->y;
    return (a > b) - (a < b);
}

ptrdiff_t ledpi_blobs(uint8_t *lit, ptrdiff_t height, ptrdiff_t width, double most_area, BlobRun *runs, ptrdiff_t most_pieces,
                      BlobPiece *pieces, ptrdiff_t most, Blob *blobs) {
    take_single_out(lit, height, width);
    const ptrdiff_t count = put_pieces(lit, height, width, runs, most_pieces, pieces);
    ptrdiff_t found = 0;
    for (ptrdiff_t i = 0; i < count && found < most; i++) {
        const double *const sums = pieces[i].sums;
        if (pieces[i].part_of != i || sums[0] < LEAST_AREA || sums[0] > most_area) continue;
        const Blob blob = blob_of(sums);
        const double full = 12.0 * sqrt(fmax(blob.xx * blob.yy - blob.xy * blob.xy, 0.0));
        if (blob.area >= LEAST_FULL * full) blobs[found++] = blob;
    }
    qsort(blobs, (size_t)found, sizeof *blobs, from_the_top);
    return found;
}
