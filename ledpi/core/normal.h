/* Normal equations (normal.c). */
#ifndef LEDPI_NORMAL_H
#define LEDPI_NORMAL_H

#include <stdbool.h>
#include <stddef.h>

#include "simd.h"

#define LEDPI_AT_ONCE 64 /* rows whose 100 columns or so stay in the cache */
#define LEDPI_RIDGE 1e-5 /* of the mean diagonal: what may be singular but for rounding is made solvable */

/* The sum of the products of two columns; `count` is a multiple of eight. */
static LEDPI_INLINE float ledpi_product(const float *a, const float *b, ptrdiff_t count) {
    enum { CHAINS = 16 / LEDPI_WIDTH }; /* none waits for another */
    Floats sums[CHAINS] = {{0}};
    ptrdiff_t i = 0;
    for (; i + 16 <= count; i += 16)
        for (int k = 0; k < CHAINS; k++)
            sums[k] += *(const Floats *)(a + i + k * LEDPI_WIDTH) * *(const Floats *)(b + i + k * LEDPI_WIDTH);
    for (int k = 0; i < count; i += LEDPI_WIDTH, k++) sums[k] += *(const Floats *)(a + i) * *(const Floats *)(b + i);
    for (int k = 1; k < CHAINS; k++) sums[0] += sums[k];
    return ledpi_total(sums[0]);
}

/* `sums` (width, width) += the products of the columns of `rows` (count, width), on and above the diagonal at least. */
void ledpi_add_products(const float *rows, ptrdiff_t count, ptrdiff_t width, float *sums);

/* Gauss's elimination of the unknowns from … to − 1 of a symmetric matrix (size, size + 1), the last column being the right
 * side; only what is on and above the diagonal is used. Returns what these unknowns explain of the squares. */
double ledpi_eliminate(double *matrix, ptrdiff_t size, ptrdiff_t from, ptrdiff_t to);

/* What is left of a symmetric matrix (size, size + 1; right side last; used up) once the first `nuisances` unknowns are
 * eliminated, over the variance of what then is left and every cell has bands of its own. False where it cannot be. */
bool ledpi_weigh(double *matrix, ptrdiff_t size, ptrdiff_t nuisances, double squares, double freedom,
                 double *score, double *information);

/* The unknowns (size,) of a matrix that they are eliminated from. */
void ledpi_solve(const double *matrix, ptrdiff_t size, double *unknowns);

/* bᵀA⁻¹b of a symmetric matrix A with the right side b, (size, size + 1); used up. `ridge`: of the mean diagonal. */
double ledpi_explained(double *matrix, ptrdiff_t size, double ridge);

#endif
