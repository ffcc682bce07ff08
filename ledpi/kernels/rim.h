/* A rim's filters, as decode/corners/rim.py makes them, and kernels/edges.py packs them. */
#ifndef LEDPI_RIM_H
#define LEDPI_RIM_H

#include <stddef.h>

enum { RIM_T = 10 }; /* light values across a side */
#define RIM_FIRST_ACROSS (-3.0)
#define PAIRS_ALIKE 0.9

typedef struct {
    double made; /* 0 until it is */
    double single[RIM_T][2], single_offset;
    double both[2][RIM_T], both_offset[2];
    double apart[RIM_T];
    double both_variance, apart_variance;
} Filter;

/* All of them by pitch and blur, and how these are told apart. */
typedef struct {
    const Filter *filters;
    ptrdiff_t pitches, blurs, first_pitch, first_blur;
    double pitch_step, blur_step; /* of their logarithms */
    double least_pitch_px, most_pitch_px, least_blur_px, most_blur_px, usual_blur_px;
} Filters;

/* The one for this pitch and blur; where it is not made, its number, counted from 1, goes into `missing` (looks.c). */
const Filter *ledpi_filter_for(const Filters *all, double pitch_px, double blur_px, ptrdiff_t *missing);

#endif
