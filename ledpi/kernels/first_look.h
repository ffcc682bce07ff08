/* The steps of a look at a panel's samples, in their order: first_look.c takes them all at once. */
#ifndef LEDPI_LOOK_H
#define LEDPI_LOOK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

void ledpi_waves(const float *rows, ptrdiff_t count, float a_row, float start, float *cosines, float *sines);

bool ledpi_all_uncovered(ptrdiff_t cells, ptrdiff_t points, const float *light, const uint8_t *valid,
                         const float *least, float *room);

bool ledpi_single_evidence(ptrdiff_t side, ptrdiff_t k, ptrdiff_t count, const float *light, const uint8_t *valid,
                           const float *waves, const float *along, ptrdiff_t source_count, const int64_t *column,
                           const int64_t *first, const int64_t *met, const float *shown, const float *of_class,
                           const uint8_t *white, double independence, ptrdiff_t aside, ptrdiff_t below, ptrdiff_t rim,
                           double *score, double *information, double *numbers);

ptrdiff_t ledpi_likeliest(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                          const double *prior, const float *words, ptrdiff_t count, ptrdiff_t most, int64_t *chosen,
                          uint8_t *silent, double *numbers);

#endif
