/* The evidence of a panel's light under way: what panel_evidence.c and panel_noise.c share. */
#ifndef LEDPI_PANEL_EVIDENCE_H
#define LEDPI_PANEL_EVIDENCE_H

#include "panel_fit.h"

enum {
    MOST_EACH = LEDPI_MOST_EACH, LINES = MOST_EACH * MOST_CELLS, /* the grid's: along a cell, and in all */
    FREE = 5, MOST_FREE = FREE * MOST_CELLS * MOST_CELLS, /* a cell's gain, cosine and sine of either wave; all cells' */
    MOST_SUMS = DENSE + MOST_FREE, /* a multiple of LEDPI_WIDTH */
    PADDED = 8, /* a cell's FREE, padded to whole vectors */
};

/* The cells that meet at a sample, its slopes by their FREE, and the light that they show there without bands; none where the
 * sample tells nothing. */
typedef struct {
    int count;
    ptrdiff_t cell[4];
    float by[4][PADDED], shown;
} CellOverlap;

/* Sums over the grid: products of the samples' columns (COMMON, residual, padding) and the cells' FREE; and, at each place of a
 * cell, of what is shown there times all of these, times `norm`, one over its norm: what their products explain is `shared2`. All
 * samples are over their deviation, as `root` says. */
typedef struct {
    float columns[LINES][LINES][DENSE], left[LINES][LINES], root[LINES][LINES];
    CellOverlap overlap[LINES][LINES];
    float common[DENSE * DENSE], mixed[MOST_FREE][DENSE], own[MOST_FREE][MOST_CELLS * MOST_CELLS][PADDED];
    float shared[MOST_EACH * MOST_EACH * MOST_SUMS], norm[MOST_EACH * MOST_EACH], shared2[MOST_SUMS * MOST_SUMS];
    double matrix[MOST_SUMS * (MOST_SUMS + 1)], solution[MOST_SUMS];
    ptrdiff_t samples, places; /* samples that tell something, and places of a cell that have such */
    double fitted; /* number of unknowns that the samples decide, and not the prior */
} Sums;

typedef struct {
    Fitting fit;
    const PanelEvidence *asked;
    ptrdiff_t each, free, frees, width; /* samples along a cell; of a cell's FREE those that are sought; of all cells; DENSE with
                                         * these, padded */
} Weighing;

/* Index of one of all cells' FREE in the matrix: after COMMON the gains, then the bands, cell by cell. */
static inline ptrdiff_t ledpi_place_of(const Weighing *w, ptrdiff_t one) {
    const ptrdiff_t cell = one / w->free, k = one % w->free;
    if (w->asked->compared) return COMMON + one;
    return COMMON + (k ? w->frees / w->free + (w->free - 1) * cell + k - 1 : cell);
}

/* By how much bands meet more noise than if it were not alike in samples near each other (panel_noise.c). Takes the matrix
 * as the unknowns were eliminated from it. */
double ledpi_noise_inflation(const Weighing *w, const Sums *sums);

#endif
