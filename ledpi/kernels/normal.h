/* Normal equations (normal.c). */
#ifndef LEDPI_NORMAL_H
#define LEDPI_NORMAL_H

#include <stdbool.h>
#include <stddef.h>

/* Numbers that are treated at once: eight, but on 64-bit ARM four, as its registers have. Wider vectors GCC keeps in
 * memory there, at five instructions for one. */
#ifdef __aarch64__
#define LEDPI_WIDTH 4
#else
#define LEDPI_WIDTH 8 /* two registers, where there is no AVX */
#endif
typedef float Eight __attribute__((vector_size(4 * LEDPI_WIDTH), aligned(4)));

static inline float ledpi_total(Eight of) {
    for (int lane = 4; lane < LEDPI_WIDTH; lane++) of[lane - 4] += of[lane];
    return (of[0] + of[1]) + (of[2] + of[3]);
}

#define LEDPI_AT_ONCE 64 /* rows whose 100 columns or so stay in the cache */
#define LEDPI_RIDGE 1e-5 /* of the mean diagonal: what may be singular but for rounding is made solvable */

/* The sum of the products of two columns; `count` is a multiple of eight. */
static inline __attribute__((always_inline)) float ledpi_product(const float *a, const float *b, ptrdiff_t count) {
    enum { CHAINS = 16 / LEDPI_WIDTH }; /* none waits for another */
    Eight sums[CHAINS] = {{0}};
    ptrdiff_t i = 0;
    for (; i + 16 <= count; i += 16)
        for (int k = 0; k < CHAINS; k++)
            sums[k] += *(const Eight *)(a + i + k * LEDPI_WIDTH) * *(const Eight *)(b + i + k * LEDPI_WIDTH);
    for (int k = 0; i < count; i += LEDPI_WIDTH, k++) sums[k] += *(const Eight *)(a + i) * *(const Eight *)(b + i);
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
                 double independence, double *score, double *information);

/* The unknowns (size,) of a matrix that they are eliminated from. */
void ledpi_solve(const double *matrix, ptrdiff_t size, double *unknowns);

/* bᵀA⁻¹b of a symmetric matrix A with the right side b, (size, size + 1); used up. `ridge`: of the mean diagonal. */
double ledpi_explained(double *matrix, ptrdiff_t size, double ridge);

#endif
