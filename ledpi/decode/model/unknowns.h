/* The layout of a fit's unknowns: those of the panel, then each cell's OWN. cffi reads this file, too, for prior.py. */
#ifndef LEDPI_UNKNOWNS_H
#define LEDPI_UNKNOWNS_H

enum {
    WAYS = 8, /* in which a homography can be wrong */
    HARMONICS = 4, SHAPES = 13, /* in a cell's profile along a cell, and in both together */
    OWN = 3, /* unknowns of a cell: its gain, and how much it shows of either class's wave */
    BLUR = WAYS, GAP, RIM, SHAPE = RIM + 4, PHASE = SHAPE + SHAPES, BESIDE = PHASE + 2, DARK = BESIDE + 4, ASIDE, DEPTH = ASIDE + 2, GLOW, SMEAR, COMMON,
    WAVE_STEPS = 512, /* in a period of a class's wave */
};

#endif
