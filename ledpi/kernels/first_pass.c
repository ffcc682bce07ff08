/* The first pass over a panel's samples, all of its steps in one call: `first_pass` of decode/identify/first_pass.py. */
#include "core.h"

#include <math.h>
#include <stdlib.h>

#include "simd.h"

/* Whether the light of one of the cells is less than this share of their mean. */
static bool any_unlit(ptrdiff_t cells, ptrdiff_t points, const float *light, double share) {
    double total = 0.0, least = INFINITY;
    for (ptrdiff_t c = 0; c < cells; c++) {
        const double own = ledpi_sum(light + c * points, points);
        total += own;
        least = fmin(least, own);
    }
    return least < share / (double)cells * total;
}

/* `light` and picture `rows` (cells, points) of a panel whose bands have so many `waves`, of `a_row` cycles a row each, and
 * the variance `prior` (2·waves,); which of `codewords` (count, cells) are the `most` likeliest. `numbers`: score, information
 * and three more as `ledpi_single_evidence` has them, by samples so many `aside` and `below` without the `rim`; the inflation,
 * by which the evidence is divided, from what is `expected` of white noise; then what `ledpi_rank_codewords`
 * has. Where a sample shows that it is covered, if it `may_be_occluded`, or a cell is `unlit` (0: not tested), it
 * returns LEDPI_PASS_NEEDS_STEPS. */
int ledpi_first_pass(const Grid *grid, const float *light, const float *rows, double independence, ptrdiff_t waves,
               double first_a_row, double second_a_row, const double *prior, const float *codewords, ptrdiff_t count,
               ptrdiff_t most, bool may_be_occluded, double unlit, ptrdiff_t aside, ptrdiff_t below, ptrdiff_t rim,
               const WhiteNoise *expected, int64_t *chosen, uint8_t *erased, double *numbers) {
    const ptrdiff_t cells = grid->side * grid->side, points = grid->k * grid->k, samples = cells * points;
    const ptrdiff_t size = 2 * waves * cells;
    double *score = numbers, *information = score + size, *of_fit = information + size * size;
    if (unlit > 0.0 && any_unlit(cells, points, light, unlit)) return LEDPI_PASS_NEEDS_STEPS;
    float *cosines = malloc(sizeof(float) * (size_t)(2 * waves * samples + points + cells));
    if (!cosines) return LEDPI_PASS_NO_MEMORY;
    int outcome = LEDPI_PASS_DONE;
    if (may_be_occluded && !ledpi_is_unoccluded(cells, points, light, NULL, grid->least, cosines + 2 * waves * samples))
        outcome = LEDPI_PASS_NEEDS_STEPS;
    for (ptrdiff_t i = 0; i < waves && outcome == LEDPI_PASS_DONE; i++) {
        float *to = cosines + 2 * i * samples;
        ledpi_waves(rows, samples, (float)(i ? second_a_row : first_a_row), 0.0f, to, to + samples);
    }
    if (outcome == LEDPI_PASS_DONE && !ledpi_single_evidence(grid->side, grid->k, 2 * waves, light, NULL, cosines, grid->along,
                                                    grid->source_count, grid->column, grid->first, grid->met, NULL, NULL,
                                                    NULL, independence, aside, below, rim, score, information,
                                                    of_fit))
        outcome = LEDPI_UNFIT;
    free(cosines);
    if (outcome != LEDPI_PASS_DONE) return outcome;
    double correlation[3];
    ledpi_correlation(expected, of_fit, correlation);
    const double inflation = of_fit[3] = ledpi_variance_inflation(correlation[0], correlation[1], correlation[2]);
    if (inflation > 1.0)
        for (ptrdiff_t i = 0; i < size * (size + 1); i++) numbers[i] *= 1.0 / inflation;
    return ledpi_rank_codewords(cells, 2 * waves, score, information, prior, codewords, count, most, chosen, erased,
                           of_fit + 4) ? LEDPI_PASS_DONE : LEDPI_PASS_NO_MEMORY;
}
