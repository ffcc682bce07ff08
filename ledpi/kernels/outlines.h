/* What follows outlines (outlines.c), and what looks for four sides in them (four_sides.c) and tells things apart (distinct.c). */
#ifndef LEDPI_OUTLINES_H
#define LEDPI_OUTLINES_H

#include <stdint.h>

typedef struct {
    int32_t first, length; /* of its points */
    int32_t left, top, right, bottom;
    double area;
} Outline;

/* A four-sided thing in the picture, as a row of the `squares` of decode/four_sides.py. */
typedef struct {
    double corners[4][2], side_px, misfit, tolerance_px;
} Square;

#endif
