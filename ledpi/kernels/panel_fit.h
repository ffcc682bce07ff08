/* A panel's picture fitted to light (panel_fit.c). */
#ifndef LEDPI_PANEL_FIT_H
#define LEDPI_PANEL_FIT_H

#include "panel.h"

typedef struct {
    /* What is given. */
    View view;
    Panel panel;
    ptrdiff_t lines;
    const double *along; /* (lines,) of the grid, in cells from the first corner, the same across and down */
    const double *prior; /* (2, COMMON + OWN·cells²): what unknowns are expected to be, and one over the variance */
    ptrdiff_t rounds, reweightings, phasing; /* at most; how often blocks are weighed; whether phases are sought first, */
    double tolerance; /* of half the side: a step that moves corners by less is the last */
    ptrdiff_t must_blink; /* and what is surely no panel of these frequencies is left at that */
    /* Where it begins, and what fits best. */
    Point corners[4]; /* of the lattice of cells */
    double *unknown;  /* as the prior; the first WAYS are not used */
    /* What follows from it. */
    Point lit[4];          /* corners of what is lit */
    double covariance[64]; /* of its corners, x and y of each */
    double explained;      /* share of the light's squares about their mean, */
    double variance;       /* of residuals, in the unit of a sample of full light */
} PanelFit;

typedef enum { DIVERGED, FITTED, WITHOUT_BANDS } Outcome;

/* Fits it; `room` has `ledpi_panel_work()` bytes. */
Outcome ledpi_fit_panel(PanelFit *fit, void *room);
size_t ledpi_panel_work(void);

#endif
