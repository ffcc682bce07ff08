/* How likely patterns near a word are: `of_neighbours` of decode/words.py, which says why. */
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "wide.h"
#include "words.h"

enum { BEAM = 16 }; /* as in decode/words.py */

/* Patterns near a word: what all cells that share its bands say of these, and how one cell's change changes that. */
typedef struct {
    double matrix[MOST][MOST], right[MOST]; /* of the word itself; the prior is in it */
    double *change; /* (cells, parameters) of what a cell shows of each wave, when it is of the other class */
    double *crossed; /* (cells, parameters, parameters) that change with what all cells of the word show */
} Around;

/* One pattern of these: which cells are changed, a bit for each, and the rest as above. */
typedef struct {
    uint64_t changed; /* unsigned, as the last of 64 cells has the sign's bit */
    double matrix[MOST][MOST], right[MOST];
} Pattern;

static void look_around(const Evidence *evidence, const float *word, double *shares, Around *around) {
    const ptrdiff_t parameters = evidence->parameters, size = evidence->cells * parameters;
    for (ptrdiff_t i = 0; i < size; i++) {
        shares[i] = share_of(evidence, word[i / parameters], i % parameters);
        around->change[i] = share_of(evidence, 1.0 - word[i / parameters], i % parameters) - shares[i];
    }
    ledpi_gather(evidence, shares, around->matrix, around->right);
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
    for (uint64_t left = pattern->changed; left; left &= left - 1) {
        const ptrdiff_t other = __builtin_ctzll(left) * parameters;
        for (ptrdiff_t i = 0; i < parameters; i++)
            for (ptrdiff_t j = 0; j < parameters; j++)
                sums[i][j] += change[i] * evidence->information[(at + i) * size + other + j] * around->change[other + j];
    }
    for (ptrdiff_t i = 0; i < parameters; i++) {
        pattern->right[i] += change[i] * evidence->score[at + i];
        for (ptrdiff_t j = 0; j < parameters; j++)
            pattern->matrix[i][j] += sums[i][j] + sums[j][i] + change[i] * evidence->information[(at + i) * size + at + j] * change[j];
    }
    pattern->changed |= UINT64_C(1) << cell;
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

static inline bool is_new(uint64_t *met, uint64_t changed) {
    for (uint64_t at = changed * UINT64_C(0x9e3779b97f4a7c15) >> 52;; at = (at + 1) % MET) {
        if (met[at] == changed) return false;
        if (met[at]) continue;
        met[at] = changed;
        return true;
    }
}

static LEDPI_INLINE double of_neighbours(const Evidence *evidence, const Around *around, const uint8_t *silent, uint64_t *met,
                                   ptrdiff_t nearest, ptrdiff_t furthest, const ptrdiff_t parameters) {
    int64_t next[BEAM] = {0};
    Pattern here[BEAM] = {{.changed = 0}};
    double of[BEAM], most = -INFINITY, sum = 0.0;
    memcpy(here[0].matrix, around->matrix, sizeof around->matrix);
    memcpy(here[0].right, around->right, sizeof around->right);
    for (ptrdiff_t differ = 1, known = 1; differ <= furthest; differ++) {
        ptrdiff_t found = 0;
        memset(met, 0, sizeof(uint64_t) * MET);
        for (ptrdiff_t n = 0; n < known; n++)
            for (ptrdiff_t c = 0; c < evidence->cells; c++) {
                const uint64_t changed = here[n].changed | UINT64_C(1) << c;
                if (changed == here[n].changed || silent[c] || !is_new(met, changed)) continue;
                Pattern pattern = here[n];
                change_cell(evidence, around, c, &pattern, parameters);
                const double own = likelihood_of(&pattern, parameters);
                found = ledpi_put((int64_t)changed, own, found, BEAM, next, of);
                if (differ < nearest || own < most - 50.0) continue; /* e⁻⁵⁰ of what is there is lost in rounding */
                if (own > most) sum = sum * exp(most - own) + 1.0, most = own;
                else sum += exp(own - most);
            }
        for (ptrdiff_t n = 0; n < found && differ < furthest; n++) {
            memset(&here[n], 0, sizeof here[n]);
            memcpy(here[n].matrix, around->matrix, sizeof around->matrix);
            memcpy(here[n].right, around->right, sizeof around->right);
            for (uint64_t left = (uint64_t)next[n]; left; left &= left - 1)
                change_cell(evidence, around, __builtin_ctzll(left), &here[n], parameters);
        }
        known = found;
    }
    double of_prior = 0.0;
    for (ptrdiff_t i = 0; i < parameters; i++) of_prior += 0.5 * log(evidence->prior[i]);
    return most + log(sum) - of_prior;
}

/* Puts the log of the sum of the likelihoods of patterns that differ from a word (cells,) in `nearest` to `furthest`
 * cells, none of them `silent` (cells,), each with the bands that fit it best: from the word outward, those near the BEAM
 * likeliest of the patterns one cell nearer. At most 64 cells. Not a number where a pattern's likelihood is none. False
 * where there is no memory. */
LEDPI_WIDE bool ledpi_of_neighbours(ptrdiff_t cells, ptrdiff_t parameters, const double *score,
                                    const double *information, const double *prior, const float *word,
                                    const uint8_t *silent, ptrdiff_t nearest, ptrdiff_t furthest, double *log_sum) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    const ptrdiff_t size = cells * parameters;
    double *shares = malloc(sizeof(double) * (size_t)(size * (2 + parameters)) + sizeof(uint64_t) * MET);
    if (!shares) return false;
    Around around = {.change = shares + size, .crossed = shares + 2 * size};
    look_around(&evidence, word, shares, &around);
    uint64_t *met = (uint64_t *)(shares + size * (2 + parameters));
    *log_sum = parameters == 4 ? of_neighbours(&evidence, &around, silent, met, nearest, furthest, 4)
                               : of_neighbours(&evidence, &around, silent, met, nearest, furthest, 2);
    free(shares);
    return true;
}
