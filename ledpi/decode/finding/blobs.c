/* Bright blobs of a picture: runs of rows, joined where they touch. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "find.h"
#include "simd.h"

#define LEAST_AREA 5.0 /* pixels that have second moments worth the name */
#define LEAST_FULL 0.7 /* of the area of a parallelogram with its moments: what is bent or branched fills less */

static int32_t root_of(BlobRun *runs, int32_t i) {
    while (runs[i].root != i) i = runs[i].root = runs[runs[i].root].root;
    return i;
}

static void join(BlobRun *runs, int32_t one, int32_t other) {
    const int32_t a = root_of(runs, one), b = root_of(runs, other);
    if (a < b) runs[b].root = a;
    if (b < a) runs[a].root = b;
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

static ptrdiff_t put_runs(const uint8_t *lit, ptrdiff_t height, ptrdiff_t width, ptrdiff_t most, BlobRun *runs) {
    ptrdiff_t count = 0, above = 0;
    for (ptrdiff_t y = 0; y < height; y++, lit += width) {
        const ptrdiff_t first = count;
        const uint8_t *const end = lit + width, *from, *to = lit;
        for (ptrdiff_t k = above; (from = memchr(to, 255, (size_t)(end - to))); count++) {
            if (!(to = memchr(from, 0, (size_t)(end - from)))) to = end;
            if (count == most) return count;
            runs[count] = (BlobRun){(int32_t)y, (int32_t)(from - lit), (int32_t)(to - lit), (int32_t)count};
            while (k < first && runs[k].to <= runs[count].from) k++;
            for (ptrdiff_t j = k; j < first && runs[j].from < runs[count].to; j++) join(runs, (int32_t)j, (int32_t)count);
        }
        above = first;
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

ptrdiff_t ledpi_blobs(uint8_t *lit, ptrdiff_t height, ptrdiff_t width, double most_area, ptrdiff_t most_runs, BlobRun *runs,
                      double (*sums)[LEDPI_BLOB], ptrdiff_t most, Blob *blobs) {
    take_single_out(lit, height, width);
    const ptrdiff_t count = put_runs(lit, height, width, most_runs, runs);
    ptrdiff_t found = 0;
    for (ptrdiff_t i = 0; i < count; i++) {
        const int32_t root = root_of(runs, (int32_t)i); /* the first of its runs */
        double *const s = sums[root];
        if (root == i) memset(s, 0, sizeof *sums);
        const double y = runs[i].row, n = runs[i].to - runs[i].from, x = 0.5 * (runs[i].from + runs[i].to - 1);
        s[0] += n, s[1] += n * x, s[2] += n * y;
        s[3] += n * x * x + n * (n * n - 1.0) / 12.0, s[4] += n * x * y, s[5] += n * y * y;
    }
    for (ptrdiff_t i = 0; i < count && found < most; i++) {
        if (runs[i].root != i || sums[i][0] < LEAST_AREA || sums[i][0] > most_area) continue;
        const Blob blob = blob_of(sums[i]);
        const double full = 12.0 * sqrt(fmax(blob.xx * blob.yy - blob.xy * blob.xy, 0.0));
        if (blob.area >= LEAST_FULL * full) blobs[found++] = blob;
    }
    qsort(blobs, (size_t)found, sizeof *blobs, from_the_top);
    return found;
}
