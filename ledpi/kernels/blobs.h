/* Bright blobs (blobs.c) and the lattices that they form (lattices.c). */
#ifndef LEDPI_BLOBS_H
#define LEDPI_BLOBS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Pixels side by side, `from` … `to` − 1, and the first run of the blob that they are in. */
typedef struct {
    int32_t row, from, to, root;
} BlobRun;

/* Its pixels' number, middle, and second moments about that. */
typedef struct {
    double area, x, y, xx, xy, yy;
} Blob;

/* Blobs (most) of the pixels (height, width) that are brighter than `around`, their neighbourhood, by more than `contrast`;
 * of 4-connected pixels, and no larger than `most_area`. `runs` (most_runs) and `sums` (most_runs, 6) are room. Returns how
 * many; what there is no room for is left out. */
ptrdiff_t ledpi_blobs(const uint8_t *pixels, const uint8_t *around, ptrdiff_t height, ptrdiff_t width, int contrast,
                      double most_area, ptrdiff_t most_runs, BlobRun *runs, double (*sums)[6], ptrdiff_t most, Blob *blobs);

enum { LATTICE_REACH = 8, LATTICE_SPAN = 2 * LATTICE_REACH + 1 };

/* Lattices (most, LATTICE_SPAN, LATTICE_SPAN) of at least `least` blobs (count): the number of each, −1 where there is none.
 * `used` (count) is room. Returns how many. */
ptrdiff_t ledpi_lattices(const Blob *blobs, ptrdiff_t count, ptrdiff_t least, uint8_t *used, ptrdiff_t most, int32_t *lattices);

#endif
