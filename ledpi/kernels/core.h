/* Every function of the compiled core that Python calls. cffi makes the bindings from this file (build_core.py, in the project's root), so it holds
 * plain declarations, and no directives but those that guard and include.
 *
 * Arrays are as numpy lays them out (C order). The functions keep none of them, and touch no element beyond the sizes that
 * they are told. Numbers that are not finite are legal everywhere. What each does is said where it is defined. */
#ifndef LEDPI_CORE_H
#define LEDPI_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- The light of a panel's cells (cells.c) */

enum { LEDPI_NONE_SATURATED, LEDPI_SOME_SATURATED, LEDPI_OUTSIDE, LEDPI_NOT_SAMPLED };

int ledpi_sample_cells(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                       const double *corners, double bend_px, const double *lens, ptrdiff_t cells, ptrdiff_t k,
                       const float *along, const float *kernel, ptrdiff_t steps, float *light, float *picture_rows,
                       double *least);

/* ---- Evidence (waves.c, uncovered.c, single_frame.c, comparison.c, noise.c, expect.c) */

void ledpi_waves(const float *rows, ptrdiff_t count, float a_row, float start, float *cosines, float *sines);

void ledpi_square_waves(const float *rows, ptrdiff_t count, double a_row, double start, ptrdiff_t averaged, double apart,
                        double exposed, double duty, double fundamental, float *bands, float *later);

bool ledpi_all_uncovered(ptrdiff_t cells, ptrdiff_t points, const float *light, const uint8_t *valid, const float *least,
                         float *room);

bool ledpi_single_evidence(ptrdiff_t side, ptrdiff_t k, ptrdiff_t count, const float *light, const uint8_t *valid,
                           const float *waves, const float *along, ptrdiff_t source_count, const int64_t *column,
                           const int64_t *first, const int64_t *met, const float *shown, const float *of_class,
                           const uint8_t *white, double independence, ptrdiff_t aside, ptrdiff_t below, ptrdiff_t rim,
                           double *score, double *information, double *numbers);

bool ledpi_compared_evidence(ptrdiff_t side, ptrdiff_t k, ptrdiff_t count, const float *light, const uint8_t *valid,
                             const float *new_waves, const float *picture, const float *counts, const float *mean_waves,
                             const float *along, double independence, ptrdiff_t aside, ptrdiff_t below, ptrdiff_t rim,
                             double *score, double *information, double *numbers);

/* Of white noise: as `Expected` in decode/evidence/noise.py. */
typedef struct {
    double white, growth, chance, once, twice, least_free;
} Expected;

void ledpi_correlation(const Expected *expected, const double *of_fit, double *correlation);

double ledpi_volume(double excess, double deviation, double growth);

enum { LEDPI_WAYS = 9 }; /* in which a panel's gain and corners may be wrong */

void ledpi_expectation(ptrdiff_t side, ptrdiff_t k, ptrdiff_t waves, const float *picture, const float *count,
                       const float *mean_waves, const float *along, const double *bands, float *root, float *basis,
                       float *left_bands, float *room);

void ledpi_expected(ptrdiff_t cells, ptrdiff_t points, ptrdiff_t ways, const float *picture, const float *root,
                    const float *basis, const float *left_bands, const float *depth, const double *hz, const double *phase,
                    double since_s, double row_time_s, const float *light, const uint8_t *valid, const float *rows,
                    double independence, double ridge, float *room, double *of);

/* ---- Words and other patterns (words.c, neighbours.c, climb.c) */

enum { LEDPI_MOST_CELLS = 64 }; /* of a pattern: a bit for each */

ptrdiff_t ledpi_likeliest(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                          const double *prior, const float *words, ptrdiff_t count, ptrdiff_t most, int64_t *chosen,
                          uint8_t *silent, double *numbers);

double ledpi_gain_by_others(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                            const double *shown, const double *other, double *gain, double *room);

double ledpi_of_neighbours(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                           const double *prior, const float *word, ptrdiff_t nearest, ptrdiff_t furthest);

double ledpi_likeliest_beyond(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                              const double *prior, const float *word, ptrdiff_t correctable, float *pattern);

/* ---- A first look at a panel: evidence and words at once (first_look.c) */

/* What all panels of side × side cells, with k × k points in each, have in common: as `ledpi_single_evidence` and
 * `ledpi_all_uncovered` take it. */
typedef struct {
    ptrdiff_t side, k, source_count;
    const float *along;
    const int64_t *column, *first, *met;
    const float *least;
} Grid;

enum { LEDPI_LOOKED, LEDPI_NOT_PLAIN, LEDPI_UNFIT, LEDPI_NOT_LOOKED };

int ledpi_look(const Grid *grid, const float *light, const float *rows, double independence, ptrdiff_t waves,
               double first_a_row, double second_a_row, const double *prior, const float *words, ptrdiff_t count,
               ptrdiff_t most, bool may_be_covered, double unlit, ptrdiff_t aside, ptrdiff_t below, ptrdiff_t rim,
               const Expected *expected, int64_t *chosen, uint8_t *silent, double *numbers);

/* ---- Poses (planar.c, refine.c) */

void ledpi_whiteners(const double *errors, ptrdiff_t count, const double *corners_px, const double *sigma_px,
                     const double *size_sigma_px, const double *motions_px, double *whiteners);

void ledpi_solve_squares(const double *lens, const double *stop, const double *errors, ptrdiff_t count,
                         const double *corners_px, const double *sigma_px, const double *size_sigma_px,
                         const double *sides_m, const double *motions_px, double *solutions, uint8_t *solved);

ptrdiff_t ledpi_fit_body(const double *lens, ptrdiff_t points, const double *place, const double *seen_px,
                         const double *whiteners, ptrdiff_t starts, const double *rotations, const double *positions,
                         ptrdiff_t at_most, const double *stop, double *fits, double *off_px, double *room);

#endif
