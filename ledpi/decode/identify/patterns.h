/* Patterns as they differ from a codeword, and how they are weighed: neighbours.c, hill_climb.c. */
#ifndef LEDPI_PATTERNS_H
#define LEDPI_PATTERNS_H

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "core.h"
#include "simd.h"
#include "codewords.h"

enum { MOST_CELLS = LEDPI_MOST_CELLS };

/* A codeword, and how one cell's change changes what all cells that share its bands say of these. */
typedef struct {
    double matrix[MOST][MOST], right[MOST]; /* the codeword's own; the prior is in it */
    double change[MOST_CELLS * MOST]; /* (cells, parameters) of what a cell shows of each wave, when of the other class */
    double crossed[MOST_CELLS * MOST * MOST]; /* (cells, parameters, parameters) that with what all cells of the codeword show */
} Around;

/* One pattern near it: which cells are changed, a bit for each, and the rest as above. */
typedef struct {
    uint64_t changed; /* unsigned, as the last of 64 cells has the sign's bit */
    double matrix[MOST][MOST], right[MOST];
} Pattern;

static LEDPI_INLINE void look_around(const Evidence *evidence, const float *codeword, Around *around, const ptrdiff_t parameters) {
    const ptrdiff_t size = evidence->cells * parameters;
    double shares[MOST_CELLS * MOST] = {0};
    memset(around, 0, sizeof *around);
    for (ptrdiff_t i = 0; i < size; i++) {
        shares[i] = share_of(evidence, codeword[i / parameters], i % parameters);
        around->change[i] = share_of(evidence, 1.0 - codeword[i / parameters], i % parameters) - shares[i];
    }
    for (ptrdiff_t i = 0; i < size; i++) {
        const double *row = evidence->information + i * size;
        double sums[MOST] = {0};
        for (ptrdiff_t d = 0; d < size; d += parameters)
            for (ptrdiff_t j = 0; j < parameters; j++) sums[j] += shares[d + j] * row[d + j];
        for (ptrdiff_t j = 0; j < parameters; j++) {
            around->crossed[i * parameters + j] = around->change[i] * sums[j];
            around->matrix[i % parameters][j] += shares[i] * sums[j];
        }
        around->right[i % parameters] += shares[i] * evidence->score[i];
    }
    for (ptrdiff_t i = 0; i < parameters; i++) around->matrix[i][i] += 1.0 / evidence->prior[i];
}

/* The codeword itself. */
static inline Pattern unchanged(const Around *around) {
    Pattern pattern = {.changed = 0};
    memcpy(pattern.matrix, around->matrix, sizeof around->matrix);
    memcpy(pattern.right, around->right, sizeof around->right);
    return pattern;
}

/* Puts one cell of a pattern into the other class. */
static LEDPI_INLINE void change_cell(const Evidence *evidence, const Around *around, ptrdiff_t cell, Pattern *pattern,
                                     const ptrdiff_t parameters) {
    const ptrdiff_t size = evidence->cells * parameters, at = cell * parameters;
    const uint64_t bit = UINT64_C(1) << cell;
    const double *change = around->change + at, sign = pattern->changed & bit ? -1.0 : 1.0; /* back to the codeword's */
    double sums[MOST][MOST];
    for (ptrdiff_t i = 0; i < parameters; i++)
        for (ptrdiff_t j = 0; j < parameters; j++) sums[i][j] = around->crossed[(at + i) * parameters + j];
    for (uint64_t left = pattern->changed & ~bit; left; left &= left - 1) {
        const ptrdiff_t other = __builtin_ctzll(left) * parameters;
        for (ptrdiff_t i = 0; i < parameters; i++)
            for (ptrdiff_t j = 0; j < parameters; j++)
                sums[i][j] += change[i] * evidence->information[(at + i) * size + other + j] * around->change[other + j];
    }
    for (ptrdiff_t i = 0; i < parameters; i++) {
        pattern->right[i] += sign * change[i] * evidence->score[at + i];
        for (ptrdiff_t j = 0; j < parameters; j++) {
            const double own = change[i] * evidence->information[(at + i) * size + at + j] * change[j];
            pattern->matrix[i][j] += sign * (sums[i][j] + sums[j][i] + own);
        }
    }
    pattern->changed ^= bit;
}

enum { LANES = 4 }; /* patterns that are weighed at a time */
typedef double Lanes __attribute__((vector_size(LANES * sizeof(double))));

/* Squares that LANES patterns explain, and the determinants of their matrices, by the factors L·D·Lᵀ. */
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

/* True if a pattern other than the codeword, by its changed cells, is met with for the first time: then it is in `met` (size,),
 * a power of 2 that is more than there are patterns, and at most 4096. */
static inline bool is_new(uint64_t *met, ptrdiff_t size, uint64_t changed) {
    for (ptrdiff_t at = (ptrdiff_t)(changed * UINT64_C(0x9e3779b97f4a7c15) >> 52);; at++) {
        at &= size - 1;
        if (met[at] == changed) return false;
        if (met[at]) continue;
        met[at] = changed;
        return true;
    }
}

#endif
