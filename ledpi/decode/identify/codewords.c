/* Likelihoods: how well codewords explain the evidence of a panel's cells: decode/identify/codewords.py has the equations. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"
#include "normal.h"
#include "simd.h"
#include "codewords.h"

enum {
    NUMBERS = 5, /* a cell's sums for one wave: x, y; xx, xy, yy */
    LANES = 4, /* codewords that are weighed at a time */
    SHORTLIST = 16, /* codewords that are compared exactly, if the caller does not say */
};

typedef double Lanes __attribute__((vector_size(LANES * sizeof(double))));

#define MOST_GAIN 40.0 /* exponents of e; more is as sure */
#define SMALLEST_LOG (-600.0) /* the least a finite sum has */

/* Per cell, and in the last line of all together, NUMBERS for each wave. */
static void put_numbers(const Evidence *evidence, double *numbers) {
    const ptrdiff_t waves = evidence->parameters / 2, size = evidence->cells * evidence->parameters, each = waves * NUMBERS;
    double *total = numbers + evidence->cells * each;
    memset(numbers, 0, sizeof(double) * (size_t)((evidence->cells + 1) * each));
    for (ptrdiff_t c = 0; c < evidence->cells; c++)
        for (ptrdiff_t k = 0; k < waves; k++) {
            const ptrdiff_t i = c * evidence->parameters + 2 * k;
            const double *here = evidence->information + i * size + i;
            const double own[NUMBERS] = {evidence->score[i], evidence->score[i + 1], here[0], here[1], here[size + 1]};
            for (int n = 0; n < NUMBERS; n++) {
                numbers[c * each + k * NUMBERS + n] = own[n];
                total[k * NUMBERS + n] += own[n];
            }
        }
}

/* The prior alone: the inverse of it, and what it makes of a determinant. */
typedef struct {
    double inverse[MOST], determinant, log_determinant;
} Prior;

static Prior prior_of(const Evidence *evidence) {
    Prior prior = {.determinant = 1.0};
    for (ptrdiff_t i = 0; i < evidence->parameters; i++) {
        prior.inverse[i] = 1.0 / evidence->prior[i];
        prior.determinant *= prior.inverse[i];
        prior.log_determinant -= log(evidence->prior[i]);
    }
    return prior;
}

/* Squares that LANES codewords explain, and the determinants of their matrices, as far as each cell tells by itself:
 * from the numbers of all cells, and their sums over those that are white. */
static LEDPI_INLINE void weigh(const double *total, const Lanes *sums, const Prior *prior, Lanes *squares, Lanes *determinant,
                               const ptrdiff_t waves) {
    *squares = (Lanes){0};
    *determinant = (Lanes){1.0, 1.0, 1.0, 1.0};
    for (ptrdiff_t k = 0; k < waves; k++) {
        Lanes own[NUMBERS];
        for (int n = 0; n < NUMBERS; n++) {
            const Lanes in_white = sums[k * NUMBERS + n], all = (Lanes){0} + total[k * NUMBERS + n];
            own[n] = waves == 2 ? (k == 0 ? all - in_white : in_white) : (n < 2 ? all - 2.0 * in_white : all);
        }
        const Lanes x = own[0], y = own[1], b = own[3];
        const Lanes a = own[2] + prior->inverse[2 * k], d = own[4] + prior->inverse[2 * k + 1];
        const Lanes of_wave = a * d - b * b;
        *squares += (d * x * x - 2.0 * b * x * y + a * y * y) / of_wave;
        *determinant *= of_wave;
    }
}

/* The `most` of `codewords` (count, cells) that are likeliest roughly, as far as each cell tells by itself: what cells share
 * (profile, corners) takes about the same from every codeword, so the likeliest and its alternatives are among these; into
 * `shortlist`, and how likely, as a log-likelihood ratio to "no bands": `rough`. One that is no number is taken for infinite,
 * so that it is looked at exactly. Returns how many there are. */
static LEDPI_INLINE ptrdiff_t put_roughly(const Evidence *evidence, const double *numbers, const float *codewords, ptrdiff_t count,
                                          ptrdiff_t most, int64_t *shortlist, double *rough, const ptrdiff_t waves) {
    const ptrdiff_t cells = evidence->cells, each = waves * NUMBERS;
    const Prior prior = prior_of(evidence);
    ptrdiff_t found = 0;
    for (ptrdiff_t first = 0; first < count; first += LANES) {
        Lanes sums[MOST / 2 * NUMBERS] = {{0}}, squares, determinant;
        const float *of[LANES];
        for (ptrdiff_t w = 0; w < LANES; w++) of[w] = codewords + (first + w < count ? first + w : first) * cells;
        for (ptrdiff_t c = 0; c < cells; c++) {
            const Lanes white = {of[0][c], of[1][c], of[2][c], of[3][c]};
            for (ptrdiff_t n = 0; n < each; n++) sums[n] += white * numbers[c * each + n];
        }
        weigh(numbers + cells * each, sums, &prior, &squares, &determinant, waves);
        for (ptrdiff_t w = 0; w < LANES && first + w < count; w++) {
            const double at_most = 0.5 * (squares[w] - prior.log_determinant); /* needs no logarithm */
            if (found == most && determinant[w] >= prior.determinant && at_most <= rough[most - 1]) continue;
            const double own = 0.5 * (squares[w] - log(determinant[w]));
            found = ledpi_put(first + w, isnan(own) ? INFINITY : own, found, most, shortlist, rough);
        }
    }
    return found;
}

/* The rest is compiled for either number of parameters, as loops of a known length are unrolled. */
LEDPI_SIMD static ptrdiff_t roughly(const Evidence *evidence, const double *numbers, const float *codewords, ptrdiff_t count,
                                    ptrdiff_t most, int64_t *shortlist, double *rough) {
    return evidence->parameters == 4 ? put_roughly(evidence, numbers, codewords, count, most, shortlist, rough, 2)
                                     : put_roughly(evidence, numbers, codewords, count, most, shortlist, rough, 1);
}

static LEDPI_INLINE void gather_of(const Evidence *evidence, const double *shares, double matrix[MOST][MOST], double *right,
                             const ptrdiff_t parameters) {
    const ptrdiff_t size = evidence->cells * parameters;
    for (ptrdiff_t i = 0; i < parameters; i++) {
        double rows[MOST] = {0};
        for (ptrdiff_t c = i; c < size; c += parameters) {
            const double share = shares[c], *row = evidence->information + c * size;
            if (share == 0.0) continue;
            double sum[MOST] = {0}, more[MOST] = {0};
            ptrdiff_t d = 0;
            for (; d + 2 * parameters <= size; d += 2 * parameters)
                for (ptrdiff_t j = 0; j < parameters; j++) {
                    sum[j] += shares[d + j] * row[d + j];
                    more[j] += shares[d + parameters + j] * row[d + parameters + j];
                }
            for (; d < size; d += parameters)
                for (ptrdiff_t j = 0; j < parameters; j++) sum[j] += shares[d + j] * row[d + j];
            for (ptrdiff_t j = 0; j < parameters; j++) rows[j] += share * (sum[j] + more[j]);
            right[i] += share * evidence->score[c];
        }
        for (ptrdiff_t j = 0; j < parameters; j++) matrix[i][j] = rows[j];
    }
}

LEDPI_SIMD static void gather(const Evidence *evidence, const double *shares, double matrix[MOST][MOST], double *right) {
    memset(matrix, 0, sizeof(double) * MOST * MOST);
    memset(right, 0, sizeof(double) * MOST);
    if (evidence->parameters == 4)
        gather_of(evidence, shares, matrix, right, 4);
    else
        gather_of(evidence, shares, matrix, right, 2);
}

/* Log-likelihood ratio of a codeword to "no bands", depth and phase integrated out; the bands and their deviations.
 * `negated`: with all classes swapped. `shares` (cells, parameters) is room to work in. */
static double exactly(const Evidence *evidence, const float *white, bool negated, double *shares, double *bands,
                      double *deviation) {
    const ptrdiff_t parameters = evidence->parameters;
    double matrix[MOST][MOST], right[MOST], likelihood = 0.0;
    for (ptrdiff_t c = 0; c < evidence->cells; c++)
        for (ptrdiff_t i = 0; i < parameters; i++) {
            shares[c * parameters + i] = share_of(evidence, negated ? 1.0 - white[c] : white[c], i);
        }
    gather(evidence, shares, matrix, right);
    for (ptrdiff_t i = 0; i < parameters; i++) matrix[i][i] += 1.0 / evidence->prior[i];
    for (ptrdiff_t k = 0; k < parameters; k++) { /* Gauss and Jordan: the matrix becomes its inverse */
        const double pivot = matrix[k][k];
        likelihood -= 0.5 * log(pivot * evidence->prior[k]);
        matrix[k][k] = 1.0;
        for (ptrdiff_t j = 0; j < parameters; j++) matrix[k][j] /= pivot;
        for (ptrdiff_t i = 0; i < parameters; i++) {
            if (i == k) continue;
            const double factor = matrix[i][k];
            matrix[i][k] = 0.0;
            for (ptrdiff_t j = 0; j < parameters; j++) matrix[i][j] -= factor * matrix[k][j];
        }
    }
    for (ptrdiff_t i = 0; i < parameters; i++) {
        bands[i] = 0.0;
        for (ptrdiff_t j = 0; j < parameters; j++) bands[i] += matrix[i][j] * right[j];
        deviation[i] = sqrt(matrix[i][i]);
        likelihood += 0.5 * bands[i] * right[i];
    }
    return likelihood;
}

ptrdiff_t ledpi_put(int64_t codeword, double likelihood, ptrdiff_t count, ptrdiff_t most, int64_t *codewords, double *of) {
    if (count == most && !(likelihood > of[most - 1])) return count;
    ptrdiff_t at = count < most ? count : most - 1;
    for (; at > 0 && likelihood > of[at - 1]; at--) {
        codewords[at] = codewords[at - 1];
        of[at] = of[at - 1];
    }
    codewords[at] = codeword;
    of[at] = likelihood;
    return count < most ? count + 1 : most;
}

double ledpi_likeliest_codeword(const Evidence *evidence, const float *codewords, ptrdiff_t count) {
    double numbers[(LEDPI_MOST_CELLS + 1) * MOST / 2 * NUMBERS], shares[LEDPI_MOST_CELLS * MOST], rough[SHORTLIST], likeliest = -INFINITY;
    int64_t shortlist[SHORTLIST];
    put_numbers(evidence, numbers);
    const ptrdiff_t found = roughly(evidence, numbers, codewords, count, SHORTLIST, shortlist, rough);
    for (ptrdiff_t n = 0; n < found; n++) {
        double bands[MOST], deviation[MOST];
        const double own = exactly(evidence, codewords + shortlist[n] * evidence->cells, false, shares, bands, deviation);
        if (own > likeliest || isnan(own)) likeliest = own;
    }
    return likeliest;
}

/* The least sum of a row or column of numbers (cells,). */
static double least_of_rows(ptrdiff_t cells, const double *numbers) {
    ptrdiff_t side = 1;
    while (side * side < cells) side++;
    double least = INFINITY;
    for (ptrdiff_t i = 0; i < side; i++) {
        double across = 0.0, down = 0.0;
        for (ptrdiff_t j = 0; j < side; j++) across += numbers[i * side + j], down += numbers[j * side + i];
        if (across < least || isnan(across)) least = across;
        if (down < least || isnan(down)) least = down;
    }
    return least;
}

/* Gain of each cell by showing `other` bands (cells, parameters) in place of those `shown`: `gain` (cells,), given
 * those of the other cells. Returns how much likelier cells are with their bands than with none, in the row or column where
 * that is the least. */
LEDPI_SIMD double ledpi_class_flip_gains(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                                       const double *shown, const double *other, double *gain, double *room) {
    const ptrdiff_t size = cells * parameters;
    double *blinks = room;
    for (ptrdiff_t c = 0; c < cells; c++) {
        double change[MOST];
        for (ptrdiff_t i = 0; i < parameters; i++) change[i] = other[c * parameters + i] - shown[c * parameters + i];
        gain[c] = blinks[c] = 0.0;
        for (ptrdiff_t i = 0; i < parameters; i++) {
            const double *row = information + (c * parameters + i) * size;
            double left = score[c * parameters + i], sums[4] = {0};
            for (ptrdiff_t j = 0; j + 4 <= size; j += 4)
                for (int lane = 0; lane < 4; lane++) sums[lane] += row[j + lane] * shown[j + lane];
            for (ptrdiff_t j = size / 4 * 4; j < size; j++) left -= row[j] * shown[j];
            left -= (sums[0] + sums[1]) + (sums[2] + sums[3]);
            double own = 0.0, changed = 0.0;
            for (ptrdiff_t j = 0; j < parameters; j++) {
                own += row[c * parameters + j] * shown[c * parameters + j];
                changed += row[c * parameters + j] * change[j];
            }
            blinks[c] += shown[c * parameters + i] * (left + 0.5 * own);
            gain[c] += change[i] * (left - 0.5 * changed);
        }
    }
    return least_of_rows(cells, blinks);
}

/* Evidence against a codeword (cells,) with these bands (parameters,): what each cell would gain by the other class and the
 * weakest row (above); how likely its negative is; and what bands of their own in every cell
 * explain. `shown` (cells, parameters) are the bands in each cell, `matrix` (size, size + 1) is room to work in. */
static void speak_against(const Evidence *evidence, const float *white, const double *bands, double *shown, double *gain,
                          double *weakest_row, double *negative, double *of_cells, double *matrix) {
    const ptrdiff_t cells = evidence->cells, parameters = evidence->parameters, size = cells * parameters;
    double own[MOST], deviation[MOST], *other = matrix; /* not needed for anything else yet */
    *negative = exactly(evidence, white, true, shown, own, deviation);
    for (ptrdiff_t i = 0; i < size; i++) {
        shown[i] = share_of(evidence, white[i / parameters], i % parameters) * bands[i % parameters];
        other[i] = share_of(evidence, 1.0 - white[i / parameters], i % parameters) * bands[i % parameters];
    }
    *weakest_row = ledpi_class_flip_gains(cells, parameters, evidence->score, evidence->information, shown, other, gain,
                                        other + size);
    for (ptrdiff_t i = 0; i < size; i++) {
        memcpy(matrix + i * (size + 1), evidence->information + i * size, sizeof(double) * (size_t)size);
        matrix[i * (size + 1) + size] = evidence->score[i];
    }
    *of_cells = 0.5 * ledpi_explained(matrix, size, 1e-6);
}

ptrdiff_t ledpi_put_erased(const Evidence *evidence, uint8_t *erased) {
    const ptrdiff_t parameters = evidence->parameters, size = evidence->cells * parameters;
    ptrdiff_t count = 0;
    for (ptrdiff_t c = 0; c < evidence->cells; c++) {
        erased[c] = true;
        for (ptrdiff_t i = c * parameters; i < (c + 1) * parameters; i++)
            if (evidence->information[i * (size + 1)] != 0.0) erased[c] = false;
        count += erased[c];
    }
    return count;
}

/* The log of so many likelihoods' sum; of those that are too small for a number that of the largest, which outshines the
 * others. */
static double log_of_sum(double sum, double largest) {
    const double log_sum = log(fmax(sum, 1e-300));
    return log_sum < SMALLEST_LOG ? largest : log_sum;
}

/* `beyond` (2,), from what each cell that is not erased would gain by the other class. Given the bands, cells are
 * independent, so the patterns that differ in d cells sum up to the d-th elementary symmetric polynomial of the cells'
 * likelihood ratios. */
static void put_beyond(ptrdiff_t cells, const double *gain, const uint8_t *erased, double *beyond) {
    double any = 0.0, one = 0.0, several = 0.0, best = -INFINITY, second = -INFINITY;
    for (ptrdiff_t c = 0; c < cells; c++) {
        if (erased[c]) continue;
        const double ratio = exp(fmin(gain[c], MOST_GAIN));
        several += (several + one) * ratio;
        any += (any + 1.0) * ratio;
        one += ratio;
        second = fmax(second, fmin(best, gain[c]));
        best = fmax(best, gain[c]);
    }
    beyond[0] = log_of_sum(any, best);
    beyond[1] = log_of_sum(several, best + second);
}

/* The likeliest of `codewords` (count, cells), best first: `chosen` (most,); which cells are `erased` (cells,); and `numbers`:
 * of the best its bands (parameters,), and those in each cell (cells, parameters); log-likelihood ratios to "no bands"
 * (most,); of the best the bands' deviations (parameters,), and what speaks against it: what each cell would gain by the other
 * class (cells,), `weakest_row`, `negative`, `of_cells`, `beyond` (2,). Last, how many cells are erased. Returns
 * how many are chosen, 0 where there is no memory. */
ptrdiff_t ledpi_rank_codewords(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                          const double *prior, const float *codewords, ptrdiff_t count, ptrdiff_t most, int64_t *chosen,
                          uint8_t *erased, double *numbers) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    const ptrdiff_t size = cells * parameters, of_numbers = (cells + 1) * parameters / 2 * NUMBERS;
    double *bands = numbers, *shown = bands + parameters, *likelihood = shown + size, *deviation = likelihood + most;
    double *gain = deviation + parameters, *weakest_row = gain + cells, *negative = weakest_row + 1, *of_cells = negative + 1;
    double *beyond = of_cells + 1;
    double *matrix = malloc(sizeof(double) * (size_t)(size * (size + 1) + of_numbers + most) + sizeof(int64_t) * (size_t)most);
    if (!matrix) return 0;
    double *of_cell = matrix + size * (size + 1), *rough = of_cell + of_numbers;
    int64_t *shortlist = (int64_t *)(rough + most);
    put_numbers(&evidence, of_cell);
    const ptrdiff_t found = roughly(&evidence, of_cell, codewords, count, most, shortlist, rough);
    ptrdiff_t kept = 0;
    for (ptrdiff_t n = 0; n < found; n++) {
        double own_bands[MOST], own_deviation[MOST];
        const double own = exactly(&evidence, codewords + shortlist[n] * cells, false, shown, own_bands, own_deviation);
        kept = ledpi_put(shortlist[n], own, kept, found, chosen, likelihood);
        if (chosen[0] != shortlist[n]) continue;
        memcpy(bands, own_bands, sizeof(double) * (size_t)parameters);
        memcpy(deviation, own_deviation, sizeof(double) * (size_t)parameters);
    }
    if (found)
        speak_against(&evidence, codewords + chosen[0] * cells, bands, shown, gain, weakest_row, negative, of_cells, matrix);
    beyond[2] = (double)ledpi_put_erased(&evidence, erased);
    if (found) put_beyond(cells, gain, erased, beyond);
    free(matrix);
    return found;
}
