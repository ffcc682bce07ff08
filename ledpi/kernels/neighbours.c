/* How likely patterns near a word are: `of_neighbours` of decode/words.py, which says why. */
#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "wide.h"
#include "words.h"

enum { BEAM = 16, MOST_CELLS = 64 }; /* as in decode/words.py; a bit for each cell */

/* Patterns near a word: what all cells that share its bands say of these, and how one cell's change changes that. */
typedef struct {
    double matrix[MOST][MOST], right[MOST]; /* of the word itself; the prior is in it */
    double change[MOST_CELLS * MOST]; /* (cells, parameters) of what a cell shows of each wave, when of the other class */
    double crossed[MOST_CELLS * MOST * MOST]; /* (cells, parameters, parameters) that with what all cells of the word show */
} Around;

/* One pattern of these: which cells are changed, a bit for each, and the rest as above. */
typedef struct {
    uint64_t changed; /* unsigned, as the last of 64 cells has the sign's bit */
    double matrix[MOST][MOST], right[MOST];
} Pattern;

static void look_around(const Evidence *evidence, const float *word, Around *around) {
    const ptrdiff_t parameters = evidence->parameters, size = evidence->cells * parameters;
    double shares[MOST_CELLS * MOST] = {0};
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

enum { LANES = 4 }; /* patterns that are weighed at a time */
typedef double Lanes __attribute__((vector_size(LANES * sizeof(double))));

/* What LANES patterns explain of the squares, and the determinants of their matrices, by the factors L·D·Lᵀ. */
static LEDPI_INLINE void weigh(const Pattern *patterns, Lanes *squares, Lanes *determinant, const ptrdiff_t parameters) {
    Lanes factor[MOST][MOST], inverse[MOST], solved[MOST];
    *squares = (Lanes){0};
    *determinant = (Lanes){1.0, 1.0, 1.0, 1.0};
    for (ptrdiff_t i = 0; i < parameters; i++) {
        Lanes own, right;
        for (int lane = 0; lane < LANES; lane++) own[lane] = patterns[lane].matrix[i][i], right[lane] = patterns[lane].right[i];
        for (ptrdiff_t j = 0; j < i; j++) {
            Lanes sum;
            for (int lane = 0; lane < LANES; lane++) sum[lane] = patterns[lane].matrix[i][j];
            for (ptrdiff_t k = 0; k < j; k++) sum -= factor[i][k] * factor[j][k] * inverse[k];
            factor[i][j] = sum; /* times D */
            own -= sum * sum * inverse[j];
            right -= sum * inverse[j] * solved[j];
        }
        inverse[i] = 1.0 / own;
        solved[i] = right;
        *squares += right * right * inverse[i];
        *determinant *= own;
    }
}

/* Which patterns were met with, by their bits; more than are tried, and a power of 2. */
enum { MET = 4 * BEAM * MOST_CELLS };

static inline bool is_new(uint64_t *met, ptrdiff_t size, uint64_t changed) {
    for (ptrdiff_t at = (ptrdiff_t)(changed * UINT64_C(0x9e3779b97f4a7c15) >> 52);; at++) {
        at &= size - 1;
        if (met[at] == changed) return false;
        if (met[at]) continue;
        met[at] = changed;
        return true;
    }
}

/* What is known of the patterns that differ in so many cells, and of all before. */
typedef struct {
    bool counts, last; /* in the sum; no others are tried from these */
    double most, sum; /* the sum of the likelihoods over e^most, the largest of them */
    ptrdiff_t found;
    int64_t next[BEAM]; /* (found,) the likeliest, and how likely these are */
    double of[BEAM];
} Tried;

/* Takes `count` patterns of LANES in. A likelihood is ½·(squares − ln determinant); with what the prior alone makes of the
 * determinant most are seen to be too small, and need no logarithm. */
static LEDPI_INLINE void take_in(const Pattern *patterns, ptrdiff_t count, double of_prior, double log_of_prior,
                                 Tried *tried, const ptrdiff_t parameters) {
    Lanes squares, determinant;
    weigh(patterns, &squares, &determinant, parameters);
    for (ptrdiff_t n = 0; n < count; n++) {
        const bool rises = !tried->last && (tried->found < BEAM || 0.5 * (squares[n] - log_of_prior) > tried->of[BEAM - 1]);
        const double least = tried->most - 50.0; /* e⁻⁵⁰ of what is there is lost in rounding */
        const bool adds = tried->counts && !(0.5 * (squares[n] - log_of_prior) < least);
        if (determinant[n] >= of_prior && !rises && !adds) continue;
        const double own = 0.5 * (squares[n] - log(determinant[n]));
        if (!tried->last) tried->found = ledpi_put((int64_t)patterns[n].changed, own, tried->found, BEAM, tried->next, tried->of);
        if (!tried->counts || own < least) continue;
        if (own > tried->most) tried->sum = tried->sum * exp(tried->most - own) + 1.0, tried->most = own;
        else tried->sum += exp(own - tried->most);
    }
}

static LEDPI_INLINE double of_neighbours(const Evidence *evidence, const Around *around, const uint8_t *silent, uint64_t *met,
                                   ptrdiff_t nearest, ptrdiff_t furthest, const ptrdiff_t parameters) {
    const ptrdiff_t met_size = evidence->cells > 16 ? MET : MET / 4;
    Pattern here[BEAM] = {{.changed = 0}}, waiting[LANES] = {{.changed = 0}};
    Tried tried = {.most = -INFINITY};
    double of_prior = 1.0, log_of_prior = 0.0;
    for (ptrdiff_t i = 0; i < parameters; i++) of_prior /= evidence->prior[i], log_of_prior -= log(evidence->prior[i]);
    memcpy(here[0].matrix, around->matrix, sizeof around->matrix);
    memcpy(here[0].right, around->right, sizeof around->right);
    for (ptrdiff_t differ = 1, known = 1; differ <= furthest; differ++, known = tried.found) {
        ptrdiff_t wait = 0;
        tried.counts = differ >= nearest, tried.last = differ == furthest, tried.found = 0;
        memset(met, 0, sizeof(uint64_t) * (size_t)met_size);
        for (ptrdiff_t n = 0; n < known; n++)
            for (ptrdiff_t c = 0; c < evidence->cells; c++) {
                const uint64_t changed = here[n].changed | UINT64_C(1) << c;
                if (changed == here[n].changed || silent[c] || !is_new(met, met_size, changed)) continue;
                waiting[wait] = here[n];
                change_cell(evidence, around, c, &waiting[wait++], parameters);
                if (wait < LANES) continue;
                take_in(waiting, wait, of_prior, log_of_prior, &tried, parameters);
                wait = 0;
            }
        if (wait) take_in(waiting, wait, of_prior, log_of_prior, &tried, parameters);
        for (ptrdiff_t n = 0; n < tried.found; n++) {
            memset(&here[n], 0, sizeof here[n]);
            memcpy(here[n].matrix, around->matrix, sizeof around->matrix);
            memcpy(here[n].right, around->right, sizeof around->right);
            for (uint64_t left = (uint64_t)tried.next[n]; left; left &= left - 1)
                change_cell(evidence, around, __builtin_ctzll(left), &here[n], parameters);
        }
    }
    return tried.most + log(tried.sum) + 0.5 * log_of_prior;
}

/* The log of the sum of the likelihoods of patterns that differ from a word (cells,) in `nearest` to `furthest` cells, none
 * of them silent, each with the bands that fit it best: from the word outward, those near the BEAM likeliest of the
 * patterns one cell nearer. At most 64 cells. Not a number where a pattern's likelihood is none. */
LEDPI_WIDE double ledpi_of_neighbours(ptrdiff_t cells, ptrdiff_t parameters, const double *score,
                                      const double *information, const double *prior, const float *word,
                                      ptrdiff_t nearest, ptrdiff_t furthest) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    uint64_t met[MET];
    uint8_t silent[MOST_CELLS];
    Around around;
    ledpi_put_silent(&evidence, silent);
    look_around(&evidence, word, &around);
    return parameters == 4 ? of_neighbours(&evidence, &around, silent, met, nearest, furthest, 4)
                           : of_neighbours(&evidence, &around, silent, met, nearest, furthest, 2);
}
