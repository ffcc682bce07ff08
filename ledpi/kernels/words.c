/* How well words explain the evidence of a panel's cells, as in decode/words.py and soft.py, which say why. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "normal.h"
#include "wide.h"

enum {
    MOST = 4, /* parameters of a cell */
    NUMBERS = 5, /* what a cell says of one wave by itself: x, y; xx, xy, yy */
    BEAM = 16, /* as in decode/words.py */
};

/* score (cells, parameters), information (cells, parameters, cells, parameters), prior (parameters,). */
typedef struct {
    ptrdiff_t cells, parameters;
    const double *score, *information, *prior;
} Evidence;

/* How much of the wave that parameter i belongs to a cell shows, whose class is `white` by 1 or black by 0. */
static inline double share_of(const Evidence *evidence, double white, ptrdiff_t i) {
    if (evidence->parameters == 2) return 1.0 - 2.0 * white;
    return i < 2 ? 1.0 - white : white;
}

/* Per cell, and in the last line of all together, NUMBERS for each wave. */
static void put_numbers(const Evidence *evidence, double *numbers) {
    const ptrdiff_t parameters = evidence->parameters, size = evidence->cells * parameters;
    const ptrdiff_t each = parameters / 2 * NUMBERS;
    double *total = numbers + evidence->cells * each;
    memset(total, 0, sizeof(double) * (size_t)each);
    for (ptrdiff_t i = 0; i < size; i += 2, numbers += NUMBERS) {
        const double *here = evidence->information + i * size + i;
        const double own[NUMBERS] = {evidence->score[i], evidence->score[i + 1], here[0], here[1], here[size + 1]};
        for (int n = 0; n < NUMBERS; n++) {
            numbers[n] = own[n];
            total[i % parameters / 2 * NUMBERS + n] += own[n];
        }
    }
}

/* A word's log-likelihood ratio to "no bands" as far as each cell tells by itself. `white` (cells,). */
static LEDPI_INLINE double roughly_of(const Evidence *evidence, const double *numbers, const float *white, const ptrdiff_t waves) {
    const ptrdiff_t each = waves * NUMBERS;
    const double *total = numbers + evidence->cells * each;
    double sum[MOST / 2 * NUMBERS] = {0}, squares = 0.0, det = 1.0;
    for (ptrdiff_t c = 0; c < evidence->cells; c++)
        for (ptrdiff_t n = 0; n < each; n++) sum[n] += white[c] * numbers[c * each + n];
    for (ptrdiff_t k = 0; k < waves; k++) {
        double own[NUMBERS];
        for (int n = 0; n < NUMBERS; n++) {
            const double all = total[k * NUMBERS + n], in_white = sum[k * NUMBERS + n];
            own[n] = waves == 2 ? (k == 0 ? all - in_white : in_white) : (n < 2 ? all - 2.0 * in_white : all);
        }
        const double x = own[0], y = own[1], b = own[3];
        const double a = own[2] + 1.0 / evidence->prior[2 * k], d = own[4] + 1.0 / evidence->prior[2 * k + 1];
        const double of_wave = a * d - b * b;
        squares += (d * x * x - 2.0 * b * x * y + a * y * y) / of_wave;
        det *= of_wave;
    }
    return 0.5 * (squares - log(det));
}

/* What follows is told for either number of parameters, as loops of a known length are unrolled. */
LEDPI_WIDE static double roughly(const Evidence *evidence, const double *numbers, const float *white) {
    return evidence->parameters == 4 ? roughly_of(evidence, numbers, white, 2) : roughly_of(evidence, numbers, white, 1);
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

/* What all cells that share the bands of a word say of these: matrix (parameters, parameters) and right side. */
LEDPI_WIDE static void gather(const Evidence *evidence, const double *shares, double matrix[MOST][MOST], double *right) {
    memset(matrix, 0, sizeof(double) * MOST * MOST);
    memset(right, 0, sizeof(double) * MOST);
    if (evidence->parameters == 4)
        gather_of(evidence, shares, matrix, right, 4);
    else
        gather_of(evidence, shares, matrix, right, 2);
}

/* Log-likelihood ratio of a word to "no bands", depth and phase integrated out; the bands and their deviations.
 * `negated`: of the word with all classes swapped. `shares` (cells, parameters) is room to work in. */
static double exactly(const Evidence *evidence, const float *white, bool negated, double *shares, double *bands,
                      double *deviation) {
    const ptrdiff_t parameters = evidence->parameters;
    double matrix[MOST][MOST], right[MOST], likelihood = 0.0;
    for (ptrdiff_t c = 0; c < evidence->cells; c++)
        for (ptrdiff_t i = 0; i < parameters; i++)
            shares[c * parameters + i] = share_of(evidence, negated ? 1.0 - white[c] : white[c], i);
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

/* Puts a word among the `most` likeliest so far, best first. Returns how many there are. */
static ptrdiff_t put(int64_t word, double likelihood, ptrdiff_t count, ptrdiff_t most, int64_t *words, double *of) {
    if (count == most && !(likelihood > of[most - 1])) return count;
    ptrdiff_t at = count < most ? count : most - 1;
    for (; at > 0 && likelihood > of[at - 1]; at--) {
        words[at] = words[at - 1];
        of[at] = of[at - 1];
    }
    words[at] = word;
    of[at] = likelihood;
    return count < most ? count + 1 : most;
}

/* What speaks against a word (cells,) with these bands (parameters,): what each cell would gain by the other class,
 * `gain` (cells,); how likely its negative is; and what bands of their own in every cell explain. `shown` (cells,
 * parameters) are the bands in each cell, `matrix` (size, size + 1) is room to work in. */
LEDPI_WIDE static void speak_against(const Evidence *evidence, const float *white, const double *bands, double *shown,
                                     double *gain, double *negative, double *of_cells, double *matrix) {
    const ptrdiff_t cells = evidence->cells, parameters = evidence->parameters, size = cells * parameters;
    double other[MOST], deviation[MOST];
    *negative = exactly(evidence, white, true, shown, other, deviation);
    for (ptrdiff_t i = 0; i < size; i++)
        shown[i] = share_of(evidence, white[i / parameters], i % parameters) * bands[i % parameters];
    for (ptrdiff_t c = 0; c < cells; c++) {
        double change[MOST];
        for (ptrdiff_t i = 0; i < parameters; i++)
            change[i] = share_of(evidence, 1.0 - white[c], i) * bands[i] - shown[c * parameters + i];
        gain[c] = 0.0;
        for (ptrdiff_t i = 0; i < parameters; i++) {
            const double *row = evidence->information + (c * parameters + i) * size;
            double left = evidence->score[c * parameters + i], sums[4] = {0};
            for (ptrdiff_t j = 0; j + 4 <= size; j += 4)
                for (int lane = 0; lane < 4; lane++) sums[lane] += row[j + lane] * shown[j + lane];
            for (ptrdiff_t j = size / 4 * 4; j < size; j++) left -= row[j] * shown[j];
            left -= (sums[0] + sums[1]) + (sums[2] + sums[3]);
            for (ptrdiff_t j = 0; j < parameters; j++) left -= 0.5 * row[c * parameters + j] * change[j];
            gain[c] += change[i] * left;
        }
    }
    for (ptrdiff_t i = 0; i < size; i++) {
        memcpy(matrix + i * (size + 1), evidence->information + i * size, sizeof(double) * (size_t)size);
        matrix[i * (size + 1) + size] = evidence->score[i];
    }
    *of_cells = 0.5 * ledpi_explained(matrix, size, 1e-6);
}

/* The likeliest of `words` (count, cells), best first: `chosen` (most,) and their log-likelihood ratios to "no bands". Of
 * the best its bands (parameters,), their deviations, the bands in each cell (cells, parameters), and what speaks against
 * it: `gain` (cells,), `negative`, `of_cells`. Returns how many are chosen, 0 where there is no memory. */
ptrdiff_t ledpi_likeliest(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information,
                          const double *prior, const float *words, ptrdiff_t count, ptrdiff_t most, int64_t *chosen,
                          double *likelihood, double *bands, double *deviation, double *shown, double *gain,
                          double *negative, double *of_cells) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    const ptrdiff_t size = cells * parameters, of_numbers = (cells + 1) * (parameters / 2 * NUMBERS);
    double *matrix = malloc(sizeof(double) * (size_t)(size * (size + 1) + of_numbers + most) + sizeof(int64_t) * (size_t)most);
    if (!matrix) return 0;
    double *numbers = matrix + size * (size + 1), *rough = numbers + of_numbers;
    int64_t *shortlist = (int64_t *)(rough + most);
    put_numbers(&evidence, numbers);
    ptrdiff_t found = 0, kept = 0;
    for (ptrdiff_t word = 0; word < count; word++)
        found = put(word, roughly(&evidence, numbers, words + word * cells), found, most, shortlist, rough);
    for (ptrdiff_t n = 0; n < found; n++) {
        double own_bands[MOST], own_deviation[MOST];
        const double own = exactly(&evidence, words + shortlist[n] * cells, false, shown, own_bands, own_deviation);
        kept = put(shortlist[n], own, kept, found, chosen, likelihood);
        if (chosen[0] != shortlist[n]) continue;
        memcpy(bands, own_bands, sizeof(double) * (size_t)parameters);
        memcpy(deviation, own_deviation, sizeof(double) * (size_t)parameters);
    }
    if (found) speak_against(&evidence, words + chosen[0] * cells, bands, shown, gain, negative, of_cells, matrix);
    free(matrix);
    return found;
}

/* Patterns near a word: what all cells that share its bands say of these, and how one cell's change changes that. */
typedef struct {
    double matrix[MOST][MOST], right[MOST]; /* of the word itself; the prior is in it */
    double *change; /* (cells, parameters) of what a cell shows of each wave, when it is of the other class */
    double *crossed; /* (cells, parameters, parameters) that change with what all cells of the word show */
} Around;

/* One pattern of these: which cells are changed, a bit for each, and the rest as above. */
typedef struct {
    int64_t changed;
    double matrix[MOST][MOST], right[MOST];
} Pattern;

static void look_around(const Evidence *evidence, const float *word, double *shares, Around *around) {
    const ptrdiff_t parameters = evidence->parameters, size = evidence->cells * parameters;
    for (ptrdiff_t i = 0; i < size; i++) {
        shares[i] = share_of(evidence, word[i / parameters], i % parameters);
        around->change[i] = share_of(evidence, 1.0 - word[i / parameters], i % parameters) - shares[i];
    }
    gather(evidence, shares, around->matrix, around->right);
    for (ptrdiff_t i = 0; i < parameters; i++) around->matrix[i][i] += 1.0 / evidence->prior[i];
    for (ptrdiff_t i = 0; i < size; i++)
        for (ptrdiff_t j = 0; j < parameters; j++) {
            double sum = 0.0;
            for (ptrdiff_t d = j; d < size; d += parameters) sum += evidence->information[i * size + d] * shares[d];
            around->crossed[i * parameters + j] = around->change[i] * sum;
        }
}

/* Puts one more cell of a pattern into the other class. */
static LEDPI_INLINE void change_cell(const Evidence *evidence, const Around *around, ptrdiff_t cell, Pattern *pattern,
                               const ptrdiff_t parameters) {
    const ptrdiff_t size = evidence->cells * parameters, at = cell * parameters;
    const double *change = around->change + at;
    double sums[MOST][MOST];
    for (ptrdiff_t i = 0; i < parameters; i++)
        for (ptrdiff_t j = 0; j < parameters; j++) sums[i][j] = around->crossed[(at + i) * parameters + j];
    for (int64_t left = pattern->changed; left; left &= left - 1) {
        const ptrdiff_t other = __builtin_ctzll((uint64_t)left) * parameters;
        for (ptrdiff_t i = 0; i < parameters; i++)
            for (ptrdiff_t j = 0; j < parameters; j++)
                sums[i][j] += change[i] * evidence->information[(at + i) * size + other + j] * around->change[other + j];
    }
    for (ptrdiff_t i = 0; i < parameters; i++) {
        pattern->right[i] += change[i] * evidence->score[at + i];
        for (ptrdiff_t j = 0; j < parameters; j++)
            pattern->matrix[i][j] += sums[i][j] + sums[j][i] + change[i] * evidence->information[(at + i) * size + at + j] * change[j];
    }
    pattern->changed |= INT64_C(1) << cell;
}

/* A pattern's log-likelihood ratio to "no bands", depth and phase integrated out, but for what the prior's determinant
 * adds. By the factors L·D·Lᵀ. */
static LEDPI_INLINE double likelihood_of(const Pattern *pattern, const ptrdiff_t parameters) {
    double factor[MOST][MOST], inverse[MOST], solved[MOST], likelihood = 0.0, determinant = 1.0;
    for (ptrdiff_t i = 0; i < parameters; i++) {
        double own = pattern->matrix[i][i], right = pattern->right[i];
        for (ptrdiff_t j = 0; j < i; j++) {
            double sum = pattern->matrix[i][j];
            for (ptrdiff_t k = 0; k < j; k++) sum -= factor[i][k] * factor[j][k] * inverse[k];
            factor[i][j] = sum; /* times D */
            own -= sum * sum * inverse[j];
            right -= sum * inverse[j] * solved[j];
        }
        inverse[i] = 1.0 / own;
        solved[i] = right;
        likelihood += right * right * inverse[i];
        determinant *= own;
    }
    return 0.5 * (likelihood - log(determinant));
}

/* Which patterns were met with, by their bits; more than are tried, and a power of 2. */
enum { MET = 4096 };

static inline bool is_new(int64_t *met, int64_t changed) {
    for (uint64_t at = (uint64_t)changed * UINT64_C(0x9e3779b97f4a7c15) >> 52;; at = (at + 1) % MET) {
        if (met[at] == changed) return false;
        if (met[at]) continue;
        met[at] = changed;
        return true;
    }
}

static LEDPI_INLINE double of_neighbours(const Evidence *evidence, const Around *around, const uint8_t *silent, int64_t *met,
                                   ptrdiff_t nearest, ptrdiff_t furthest, const ptrdiff_t parameters) {
    int64_t next[BEAM] = {0};
    Pattern here[BEAM] = {{.changed = 0}};
    double of[BEAM], most = -INFINITY, sum = 0.0;
    memcpy(here[0].matrix, around->matrix, sizeof around->matrix);
    memcpy(here[0].right, around->right, sizeof around->right);
    for (ptrdiff_t differ = 1, known = 1; differ <= furthest; differ++) {
        ptrdiff_t found = 0;
        memset(met, 0, sizeof(int64_t) * MET);
        for (ptrdiff_t n = 0; n < known; n++)
            for (ptrdiff_t c = 0; c < evidence->cells; c++) {
                const int64_t changed = here[n].changed | INT64_C(1) << c;
                if (changed == here[n].changed || silent[c] || !is_new(met, changed)) continue;
                Pattern pattern = here[n];
                change_cell(evidence, around, c, &pattern, parameters);
                const double own = likelihood_of(&pattern, parameters);
                found = put(changed, own, found, BEAM, next, of);
                if (differ < nearest || own < most - 50.0) continue; /* e⁻⁵⁰ of what is there is lost in rounding */
                if (own > most) sum = sum * exp(most - own) + 1.0, most = own;
                else sum += exp(own - most);
            }
        for (ptrdiff_t n = 0; n < found && differ < furthest; n++) {
            memset(&here[n], 0, sizeof here[n]);
            memcpy(here[n].matrix, around->matrix, sizeof around->matrix);
            memcpy(here[n].right, around->right, sizeof around->right);
            for (int64_t left = next[n]; left; left &= left - 1)
                change_cell(evidence, around, __builtin_ctzll((uint64_t)left), &here[n], parameters);
        }
        known = found;
    }
    double of_prior = 0.0;
    for (ptrdiff_t i = 0; i < parameters; i++) of_prior += 0.5 * log(evidence->prior[i]);
    return most + log(sum) - of_prior;
}

/* Log of the sum of the likelihoods of patterns that differ from a word (cells,) in `nearest` to `furthest` cells, none
 * of them `silent` (cells,), each with the bands that fit it best: from the word outward, those near the BEAM likeliest
 * of the patterns one cell nearer. At most 64 cells. NaN where there is no memory. */
LEDPI_WIDE double ledpi_of_neighbours(ptrdiff_t cells, ptrdiff_t parameters, const double *score,
                                      const double *information, const double *prior, const float *word,
                                      const uint8_t *silent, ptrdiff_t nearest, ptrdiff_t furthest) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    const ptrdiff_t size = cells * parameters;
    double *shares = malloc(sizeof(double) * (size_t)(size * (2 + parameters)) + sizeof(int64_t) * MET);
    if (!shares) return NAN;
    Around around = {.change = shares + size, .crossed = shares + 2 * size};
    look_around(&evidence, word, shares, &around);
    int64_t *met = (int64_t *)(shares + size * (2 + parameters));
    const double found = parameters == 4 ? of_neighbours(&evidence, &around, silent, met, nearest, furthest, 4)
                                         : of_neighbours(&evidence, &around, silent, met, nearest, furthest, 2);
    free(shares);
    return found;
}
