/* Every function of the compiled core that Python calls. cffi makes the bindings from this file (build_core.py, in the
 * project's root), so it holds plain declarations, and no directives but those that guard and include.
 *
 * Arrays are as numpy lays them out (C order). The functions keep none of them, and touch no element beyond the sizes that
 * they are given. Numbers that are not finite are legal everywhere. What each does is said where it is defined. */
#ifndef LEDPI_CORE_H
#define LEDPI_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- Codewords and other patterns (codewords.c, neighbours.c, hill_climb.c, parts.c) */

enum { LEDPI_MOST_CELLS = 64 }; /* in a pattern: a bit for each */

ptrdiff_t ledpi_rank_codewords(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                          const double *prior, const float *codewords, ptrdiff_t count, ptrdiff_t most, int64_t *chosen,
                          uint8_t *erased, double *numbers);

double ledpi_class_flip_gains(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                            const double *shown, const double *other, double *gain, double *room);

double ledpi_near_pattern_likelihood(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                           const double *prior, const float *codeword, ptrdiff_t nearest, ptrdiff_t furthest);

double ledpi_likeliest_far_pattern(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                              const double *prior, const float *codeword, ptrdiff_t correctable, float *pattern);

double ledpi_likeliest_part(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                            const double *prior, const float *codewords, ptrdiff_t codeword_count, ptrdiff_t best, double enough);

/* ---- Proposals: outlines of four-sided things (find.c), lattices of cells (lattice_squares.c) */

enum { LEDPI_MOST_LEVELS = 10, LEDPI_MOST_SHARES = 2, LEDPI_SQUARE = 11, LEDPI_MOST_SQUARES = 4096 };

/* A picture, a pixel of which is `scale` of the frame's; which grey levels something that is lit there is brighter than, or
 * by which shares of the contrast it is, in 256ths; and the shortest way around what is. */
typedef struct {
    const uint8_t *picture;
    ptrdiff_t height, width, scale, levels, shares;
    int32_t brighter_than[LEDPI_MOST_LEVELS], lit_by[LEDPI_MOST_SHARES], shortest;
} FindLevel;

/* Limits of an outline; `Limits` of decode/finding/outlines.py has their values, and explains them. */
typedef struct {
    double min_contrast, narrowest, min_area, min_lit, min_solidity, significant, alike, min_side, max_cut_off;
    double max_misfit, pixel_misfit, tolerance, blur_misfit, near, like, same_corners, least_cell, most_cell;
} Limits;

/* Search: squares of at least `smallest_px`, of `cells` along a side. */
typedef struct {
    double smallest_px;
    ptrdiff_t cells;
    Limits limits;
} FindWanted;

/* Squares (most, LEDPI_SQUARE): four corners' x and y, side_px, misfit, tolerance_px; which of them are of different
 * things, the best first; and how often something was dropped, and for what. */
typedef struct {
    double *squares;
    int64_t *distinct;
    ptrdiff_t most, distinct_count, at_border, not_four_sided, too_small;
} FindResult;

ptrdiff_t ledpi_find_room(ptrdiff_t height, ptrdiff_t width);
void ledpi_find(const FindLevel *levels, ptrdiff_t count, const FindWanted *wanted, uint8_t *room, FindResult *result);

/* A picture of a pyramid: the first is the frame, each further one half of the one before. */
typedef struct {
    const uint8_t *pixels;
    ptrdiff_t height, width;
} PyramidPicture;

ptrdiff_t ledpi_lattice_room(ptrdiff_t height, ptrdiff_t width);
ptrdiff_t ledpi_lattice_squares(const PyramidPicture *pictures, ptrdiff_t count, ptrdiff_t cells, uint8_t *room, ptrdiff_t most,
                                double *corners);

/* ---- A glance at candidates, by one template (glance.c) */

/* Hypothesis: its mean light (size), and the directions (ranks, size) in which that varies: each as long as the root of
 * the share of its variance that is not noise. */
typedef struct {
    const float *mean, *directions;
    ptrdiff_t ranks;
} GlanceHypothesis;

/* Samples are where `lines` across meet those down, `along` (lines) 0..1 from the panel's first corner; `size` is their number,
 * padded to eights. Of light, about dark in units of bright less dark: the cells' gains (cells², size) and the WAYS in which a
 * homography can be wrong (8, size), by least squares. */
typedef struct {
    ptrdiff_t cells, lines, size;
    const float *along, *gains, *ways;
    const uint8_t *inside; /* (size) whether it is in the panel */
    GlanceHypothesis panel, texture;
    double independent, log_volume; /* samples whose noise is; ln of how many more pictures may be a panel's than texture's */
} GlanceTemplate;

/* A candidate: its corners, and where a panel there fits best; how much likelier that is than texture, in nats. */
typedef struct {
    double corners[8], moved[8], side_px, evidence;
} Glimpse;

enum { LEDPI_GLIMPSE = 18 };

/* The pictures to search. Where a pyramid (count) has bands `bridged`, too the picture that shows them (else no pixels): there part of
 * a panel is darker than by `most_dimmed` of what is bright. */
typedef struct {
    const PyramidPicture *pyramid;
    ptrdiff_t count;
    PyramidPicture bridged;
    double most_dimmed;
} GlancePictures;

void ledpi_glance_at(const GlanceTemplate *glance, const GlancePictures *in, float *work, ptrdiff_t most, Glimpse *glimpses);
ptrdiff_t ledpi_glance(const GlanceTemplate *glance, const GlancePictures *in, double smallest_px, ptrdiff_t at_once, ptrdiff_t turn,
                       float *work, ptrdiff_t most, Glimpse *glimpses);

/* ---- Light of a part of a picture (window.c) */

/* Linear light (rows, columns) of a picture that is `width` wide, from a pixel on; each of `shrink` pixels a side. Levels of what is
 * dark there, of what is bright in the square with these corners, and of what is dark within that. */
typedef struct {
    const uint8_t *picture;
    ptrdiff_t width, left, top, rows, columns, shrink;
    const float *linear; /* (256) of each grey level */
    double corners[8];
    float *light, dark, bright, dimmed;
} PanelWindow;

bool ledpi_panel_window(PanelWindow *window);

/* ---- A panel's picture, fitted to light (panel_fit.c) */

typedef struct {
    /* Light (rows, columns) of a part of the picture, each of `shrink` pixels a side, the first one's centre at `first`. */
    const float *light;
    ptrdiff_t rows, columns;
    double first_x, first_y, shrink, saturated;
    const double *lens; /* NULL: there is none */
    double focal[2], centre[2]; /* x, y, in pixels */
    /* The panel: either class's wave (2, 512) as the exposure leaves it, less its mean, over its mean. The fit's light is
     * (what is seen − dark)·scale. */
    ptrdiff_t cells;
    const float *waves;
    double cycles_a_row[2], scale, dark;
    /* The grid, in cells from the first corner, the same across and down. And what unknowns are expected to be, and one
     * over the variance: (2, unknowns). */
    ptrdiff_t lines;
    const double *along, *prior;
    ptrdiff_t rounds, reweightings; /* at most; times that blocks are weighed */
    bool banded, phasing;           /* cells have bands, not gains only; phases are sought first */
    bool must_blink;                /* then what is surely no panel of these frequencies is left at that */
    double tolerance;               /* half sides: a step that moves corners by less is the last */
    double most_left, most_sigma;   /* early stop: larger share of the squares left, or less certain corners (pixels) */
    /* Start and result: corners of the lattice of cells; unknowns as the prior, the first WAYS not used. */
    double corners[8];
    double *unknown;
    double lit[8];         /* derived from it: corners of what is lit */
    double hidden[4];      /* cells of each side (left, right, above, below) that something hides */
    double covariance[64]; /* that of `lit` */
    double rim_variance[4]; /* cells², of `unknown`'s rims */
    double jackknife[64];  /* that of `lit`, by how far they move without any one of the cells, where blocks are weighed */
    double explained;      /* share of the light's squares about their mean */
    double variance;       /* mean of the rest */
    bool settled; /* the last step hardly moved anything */
    ptrdiff_t sampled; /* places, in all rounds: what it cost */
} PanelFit;

enum { LEDPI_DIVERGED, LEDPI_FITTED, LEDPI_WITHOUT_BANDS, LEDPI_MISFIT, LEDPI_UNCERTAIN };
enum { LEDPI_MOST_SIDE = 8, LEDPI_MOST_LINES = 160, LEDPI_MOST_EACH = 16 };

int ledpi_fit_panel(PanelFit *fit, uint8_t *room);
ptrdiff_t ledpi_panel_room(void);

/* The evidence on the bands of a panel that `fit` has fitted, on a grid of equal steps within each cell. Of a frame by itself;
 * with a mean of frames on the same grid of that mean; or, where `compared`, of how the frame differs from it. */
typedef struct {
    PanelFit fit;
    ptrdiff_t waves;         /* as many as tell the classes apart */
    double cycles_before[2]; /* each wave's, from the moment that its phase is counted from to row 0 */
    double row_average[2];   /* share of each wave that is left in the mean of the rows that a pixel of `light` stands for */
    double phases[2];        /* in row 0, that `turns` are of */
    double step_px[2];       /* pixels of a step of the grid, across and down */
    const float *turns;      /* (waves, 2) turns a wave with its harmonics to a cosine of height 1; NULL: phases are open */
    const float *mean_light, *mean_count, *mean_wave; /* the mean's light, how many tell it, cosine and sine; NULL: none */
    bool compared;
    float *light, *valid, *wave; /* the frame's: light over the panel's, shifted where compared; 0 or 1; its waves */
    double *score, *information; /* (cells², 2·waves), (cells², 2·waves)², over the variance of what is left */
    double inflation, freedom;   /* by which noise that is alike inflates it; number of samples that were free */
} PanelEvidence;

bool ledpi_panel_evidence(PanelEvidence *evidence, uint8_t *room);
ptrdiff_t ledpi_panel_evidence_room(void);

/* A panel's own picture, as a fit had it, to follow it by. All is over the root of its variance. */
typedef struct {
    ptrdiff_t lines, width, unknowns, waves; /* the grid's, both ways; apart, a multiple of eight; a fit's, but for one gain */
    float *along;          /* (width) 0..1 from the first corner */
    float *weight, *light; /* (lines, width) one over the root of the variance; light without bands */
    float *slopes, *shown; /* the light's by each unknown; light of the cells that show each of the waves */
    const double *inverse; /* (unknowns, unknowns) inverse of the products of slopes with the prior; 0 for what is not free */
    const double *pull;    /* (unknowns) the prior's */
    double ridge[2];       /* a sample's variance over that of each wave */
    double covariance[64]; /* the lit corners', by the panel (0..1) */
} PanelPicture;

void ledpi_panel_picture(const PanelFit *fitted, const double *shares, PanelPicture *out, uint8_t *room);
bool ledpi_follow_panel(PanelFit *fit, const PanelPicture *panel, float *room);

/* ---- Rays and pixels (lens.c) */

void ledpi_project_points(const double *lens, ptrdiff_t count, const double *points, double *pixels, double *slopes);
void ledpi_distort_rays(const double *lens, ptrdiff_t count, const double *rays, double *pixels);
void ledpi_undistort_pixels(const double *lens, ptrdiff_t count, const double *pixels, double *rays);

/* ---- Poses (planar.c, refine.c) */

void ledpi_solve_squares(const double *lens, const double *stop, ptrdiff_t count, const double *corners_px,
                         const double *whiteners, const double *sides_m, double *solutions, uint8_t *solved);

ptrdiff_t ledpi_fit_body(const double *lens, ptrdiff_t points, const double *place, const double *seen_px,
                         const double *whiteners, ptrdiff_t starts, const double *rotations, const double *positions,
                         ptrdiff_t at_most, const double *stop, double *fits, double *off_px, double *room);

#endif
