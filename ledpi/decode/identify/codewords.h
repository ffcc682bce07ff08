/* Weighs codewords and patterns near them: codewords.c, neighbours.c, parts.c. */
#ifndef LEDPI_CODEWORDS_H
#define LEDPI_CODEWORDS_H

#include <stddef.h>
#include <stdint.h>

enum { MOST = 4 }; /* parameters of a cell */

/* score (cells, parameters), information (cells, parameters, cells, parameters), prior (parameters,). */
typedef struct {
    ptrdiff_t cells, parameters;
    const double *score, *information, *prior;
} Evidence;

/* Share that a cell shows of the wave of parameter i, whose class is `white` by 1 or black by 0. */
static inline double share_of(const Evidence *evidence, double white, ptrdiff_t i) {
    if (evidence->parameters == 2) return 1.0 - 2.0 * white;
    return i < 2 ? 1.0 - white : white;
}

/* Which cells (cells,) the evidence holds nothing of. Returns how many. */
ptrdiff_t ledpi_put_erased(const Evidence *evidence, uint8_t *erased);

/* Log-likelihood ratio to "no bands" of the likeliest of `codewords` (count, cells); −∞ where there are none. */
double ledpi_likeliest_codeword(const Evidence *evidence, const float *codewords, ptrdiff_t count);

/* Puts a codeword among the `most` likeliest so far, best first. Returns how many there are. */
ptrdiff_t ledpi_put(int64_t codeword, double likelihood, ptrdiff_t count, ptrdiff_t most, int64_t *codewords, double *of);

#endif
