/* Bright blobs (blobs.c) and the lattices that they form (lattices.c). */
#ifndef LEDPI_BLOBS_H
#define LEDPI_BLOBS_H

#include "core.h"

/* Pixels side by side, `from` … `to` − 1, and the first run of the blob that they are in. */
typedef struct {
    int32_t row, from, to, root;
} BlobRun;

/* Its pixels' number, middle, and second moments about that. */
typedef struct {
    double area, x, y, xx, xy, yy;
} Blob;

enum { LATTICE_REACH = (LEDPI_LATTICE_SPAN - 1) / 2 };

#endif
