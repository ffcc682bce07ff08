/* What becomes of one quad after the other: its sides (looks.c), what is hidden of it (whole.c), its lattice (adjust.c); and
 * all of that (edges.c). */
#ifndef LEDPI_QUADS_H
#define LEDPI_QUADS_H

#include "kernels.h"
#include "pose.h"
#include "rim.h"

/* How light along a quad is explained by cells of which so much is hidden, as decode/corners/whole.py makes it: orthonormal `bases`
 * (columns, places), those of explanation e from column first[e] to first[e + 1]. NULL until they are made. */
typedef struct {
    const double *bases;
    const ptrdiff_t *first;
} Explanations;

/* Constants of decode/corners/looks.py, whole.py, edges.py and adjust.py, where they are explained. */
typedef struct {
    double least_height, near_px, settled_px, settled_blur, first_look_px, more_looks, converged_px, steepest, max_move,
        max_blur_change;
    double near_edge, share_step, first_share, most, no_rim_wall, rim_wall, gap, blur_px, blur_step, better, little_left, clearly_better,
        nothing_left, cells_show, least_shown;
    double max_spread_px, min_used, min_side_px, border_px, hidden_sigma, min_pitch_px, least_cells;
} Refining;

/* What is made beforehand; as kernels/edges.py has it. */
typedef struct {
    const Approaching *approaching;
    const Refining *refining;
    Filters filters;
    Shares profiles, coarse;     /* across the sides: looked at closely, and from further off */
    const float *templates;      /* of the step there */
    const double *cubics;        /* (2, places) by what the sides' bends move each place along a quad */
    const Explanations *explanations;
    ptrdiff_t first_blur, blurs; /* logarithms of a gap's blur that these are for, in steps */
    ptrdiff_t cells;             /* along a side */
} Tables;

/* What is wanted and not made yet, counted from 1; 0 where nothing is missing. */
typedef struct {
    ptrdiff_t filter, explanations;
} Missing;

/* Where the sides near corners are, and how sure that is. */
typedef struct {
    Point corners[4];
    bool seen;                            /* all sides show edges */
    double used, spread_px, sigma_px;     /* share of the profiles that are; of their edges; of the corners */
    double size_sigma_px;                 /* of that, what all sides share */
} Found;

/* Below, `bends` (4, 2, 2) are what the lens does to a quad's sides: `bends` of decode/corners/sides.py. */

void ledpi_find_sides(const Picture *picture, const Tables *tables, const Point near[4], const double *bends, Found *found,
                      Missing *missing);

/* The share of the panel's side that a quad lacks: at the left and right, then at the top and bottom; as `hidden_shares`.
 * Whether its cells show. */
bool ledpi_hidden(const Picture *picture, const Tables *tables, const Point corners[4], const double *bends,
                  double hidden[2][2], Missing *missing);

/* A whole panel's corners by all lines of its lattice, the deviation of their coordinates, and what all sides share of it; how
 * far beyond the sides that were seen the lattice ends. */
typedef struct {
    Point corners[4];
    double sigma_px, size_sigma_px, rim_wall;
} Adjusted;

/* The deviations are not a number where the lines are no panel's that ends with its lattice. */
void ledpi_adjust(const Picture *picture, const Tables *tables, const Point corners[4], const double *bends,
                  const Lens *lens, Adjusted *better, Missing *missing);

#endif
