/* A panel's fit under way: what the files panel_fit.c, panel_sums.c, panel_step.c, panel_corners.c and panel_jackknife.c share. */
#ifndef LEDPI_PANEL_FIT_H
#define LEDPI_PANEL_FIT_H

#include "normal.h"
#include "panel.h"
#include "simd.h"

enum {
    BLOCKS = 3, /* that are weighed together, along a cell */
    MOST_BLOCKS = MOST_CELLS * MOST_CELLS * BLOCKS * BLOCKS + 4 * MOST_CELLS,
};
/* A fit under way. */
typedef struct {
    View view;
    Panel panel;
    Point corners[4], lit[4];
    const PanelFit *asked;
    const double *along, *prior;
    ptrdiff_t lines, reweightings, own, owns, size; /* unknowns of a cell that are sought, of all cells, in all */
    double *unknown, *covariance, explained, variance, inflation, sought[2]; /* phases, as the grid has them */
} Fitting;

/* The OWN of a cell, side by side; the fourth is none. */
typedef float Four __attribute__((vector_size(16), aligned(4)));

/* Sums of products of the columns; of COMMON, of each cell's OWN with COMMON, and of these with each cell's. */
typedef struct {
    float common[DENSE * DENSE], mixed[MOST_OWN][DENSE];
    Four own[MOST_OWN][MOST_CELLS * MOST_CELLS];
} Products;

typedef struct {
    Line grid[2][LEDPI_MOST_LINES];
    Lines across[LEDPI_MOST_LINES / LEDPI_WIDTH];
    float numbers[9], unknown[MOST_UNKNOWN]; /* the homography's; as they are before this round */
    float columns[(LEDPI_AT_ONCE + LEDPI_MOST_LINES + LEDPI_WIDTH) * DENSE];
    Products products;
    double matrix[MOST_UNKNOWN * (MOST_UNKNOWN + 1)], step[MOST_UNKNOWN];
    float by_row[2][MOST_CELLS * MOST_CELLS * MOST_ROWS];
    int16_t block[LEDPI_MOST_LINES][LEDPI_MOST_LINES]; /* the grid's places, down and across */
    double weight[MOST_BLOCKS], squares[MOST_BLOCKS], sum[MOST_BLOCKS], count[MOST_BLOCKS];
    double left, inside, used, light, light2; /* sums, weighed: of squared residuals, of weights, of light and its square */
    double decrease; /* part of the squared residuals that the step should bring: a share of them */
    ptrdiff_t samples, sampled; /* in this round, in all */
} Work;

static inline ptrdiff_t ledpi_panel_rows(const Fitting *fit) { return fit->view.rows < MOST_ROWS ? fit->view.rows : MOST_ROWS; }

static inline int ledpi_ascending(const void *a, const void *b) {
    const double one = *(const double *)a, other = *(const double *)b;
    return (one > other) - (one < other);
}

/* A cell that a sample shows, and the sample's slopes by its OWN. */
typedef struct {
    ptrdiff_t cell;
    Four by;
} Owned;

/* Weighted slopes of eight samples by the OWN of the cells that meet there: by the cell down, the lane, the cell across. */
typedef struct {
    float by[2][LEDPI_WIDTH][2][4];
} Owns;

static LEDPI_INLINE void ledpi_panel_put_owns(const Samples *s, Owns *owns) {
    for (int j = 0; j < 2; j++) {
#if LEDPI_WIDTH == 4
        for (int i = 0; i < 2; i++) {
            Floats rows[LEDPI_WIDTH] = {{0}};
            for (int k = 0; k < OWN; k++) rows[k] = s->weight * s->own[j][i][k];
            ledpi_transpose(rows);
            for (int lane = 0; lane < LEDPI_WIDTH; lane++) *(Floats *)owns->by[j][lane][i] = rows[lane];
        }
#else
        Floats rows[LEDPI_WIDTH] = {{0}};
        for (int i = 0; i < 2; i++)
            for (int k = 0; k < OWN; k++) rows[4 * i + k] = s->weight * s->own[j][i][k];
        ledpi_transpose(rows);
        for (int lane = 0; lane < LEDPI_WIDTH; lane++) *(Floats *)owns->by[j][lane] = rows[lane];
#endif
    }
}

/* The cells that meet at a sample, by their number. Returns how many. */
static LEDPI_INLINE int ledpi_panel_met(const Owns *owns, int lane, const Lines *across, const Line *down, ptrdiff_t cells, Owned met[4]) {
    const int above = down->cell[1] < down->cell[0], left = across->cell[1][lane] < across->cell[0][lane];
    int count = 0;
    for (int n = 0; n < 4; n++) {
        const int j = (n / 2) ^ above, i = (n % 2) ^ left;
        if (!(across->light[i][lane] * down->light[j] > NO_LIGHT)) continue;
        met[count++] = (Owned){down->cell[j] * cells + across->cell[i][lane], *(const Four *)owns->by[j][lane][i]};
    }
    return count;
}

/* A fit as it is asked for, before its first round (panel_fit.c). */
Fitting ledpi_panel_begun(const PanelFit *asked, PanelFit *into);

/* Puts the blocks that places of the grid are weighed with (panel_sums.c). */
void ledpi_panel_put_blocks(const Fitting *fit, Work *work);

/* Puts the lines of the grid where homography h and the unknowns have them (panel_sums.c). */
void ledpi_panel_put_grid(Fitting *fit, const double h[9], Work *work);

/* The samples on the grid's lines across from the i-th on, and the j-th down; `profile` is that of this one. */
static LEDPI_INLINE void ledpi_panel_sample_at(const Fitting *fit, const Work *work, const Profile *profile, ptrdiff_t i, ptrdiff_t j,
                                               Samples *s) {
    ledpi_panel_sample(&fit->panel, &fit->view, work->numbers, work->unknown, profile, work->across + i / LEDPI_WIDTH, &work->grid[1][j],
                       (float)(fit->along[j] / (double)fit->panel.cells), s);
}

/* Sums over the grid; by rows where `phasing`. */
void ledpi_panel_sum_up(const Fitting *fit, bool phasing, Work *work);

/* Weighs each block by how large its residuals are beside the usual ones of the cells' blocks. */
void ledpi_panel_weigh_blocks(ptrdiff_t cells, Work *work);

/* By how much residuals that are alike in a block make its mean vary more than if they were independent: of weighed blocks light
 * counts by as much less beside what is known beforehand, or it would have corners go with blur, gap and rims together. */
double ledpi_panel_inflation(const Fitting *fit, const Work *work);

/* The step, in the matrix's order of unknowns; leaves what that was eliminated to (panel_step.c). `holding`: what is at a
 * limit stays there; a covariance is had without, as a limit is no knowledge of how far within it an unknown is. */
bool ledpi_panel_solve_step(Fitting *fit, bool holding, Work *work);

/* Takes the step. Returns how far it moves the homography. */
double ledpi_panel_take_step(Fitting *fit, const double h[9], Work *work);

/* Corners of what is lit, and how many cells of each side (left, right, above, below) something hides. */
void ledpi_panel_put_lit(Fitting *fit, const double h[9], double hidden[4]);

/* Slopes of the coordinates of the lit square's corners by COMMON. */
void ledpi_panel_put_slopes(const Fitting *fit, const double h[9], double by[8][COMMON]);

/* A right side that is zero but for COMMON, eliminated as the matrix A is: of two, bᵀA⁻¹c is the sum of products over pivots. */
void ledpi_panel_eliminate_right(const Fitting *fit, const double *matrix, double right[COMMON]);

/* The corners' covariance by what is known of all unknowns. */
void ledpi_panel_put_covariance(Fitting *fit, const double h[9], Work *work);

/* Puts the variance of each rim, in cells². */
void ledpi_panel_put_rim_variance(const Fitting *fit, const Work *work, double variance[4]);

/* The same by how far corners would move without any one of the cells (panel_jackknife.c). */
void ledpi_panel_put_jackknife(Fitting *fit, const double h[9], Work *work, double covariance[64]);

#endif
