/* Normal equations: sums of products, and the elimination of what is not asked for. */
#include <math.h>

#include "normal.h"
#include "wide.h"

typedef float Four __attribute__((vector_size(16), aligned(4))); /* one register, on any machine that is meant */

enum { AT_ONCE = 64 }; /* rows whose 100 columns or so stay in the cache */

LEDPI_WIDE void ledpi_add_products(const float *rows, ptrdiff_t count, ptrdiff_t width, float *sums) {
    for (ptrdiff_t from = 0; from < count; from += AT_ONCE) {
        const float *to = rows + width * (from + AT_ONCE < count ? from + AT_ONCE : count);
        for (ptrdiff_t i = 0; i < width; i += 4)
            for (ptrdiff_t j = i / LEDPI_WIDTH * LEDPI_WIDTH; j < width; j += LEDPI_WIDTH) {
                Four a = {0}, b = {0}, c = {0}, d = {0}, e = {0}, f = {0}, g = {0}, h = {0}; /* 4 × 8 sums */
                for (const float *row = rows + from * width; row < to; row += width) {
                    const Four left = *(const Four *)(row + j), right = *(const Four *)(row + j + 4);
                    a += row[i] * left, b += row[i] * right;
                    c += row[i + 1] * left, d += row[i + 1] * right;
                    e += row[i + 2] * left, f += row[i + 2] * right;
                    g += row[i + 3] * left, h += row[i + 3] * right;
                }
                Four *const sum = (Four *)(sums + i * width + j);
                const ptrdiff_t down = width / 4;
                sum[0] += a, sum[1] += b;
                sum[down] += c, sum[down + 1] += d;
                sum[2 * down] += e, sum[2 * down + 1] += f;
                sum[3 * down] += g, sum[3 * down + 1] += h;
            }
    }
}

/* Gauss's elimination of the unknowns from … to − 1 of a symmetric matrix (size, size + 1), the last column being the
 * right side; only what is on and above the diagonal is used. Returns what these unknowns explain of the squares. */
LEDPI_WIDE static double eliminate(double *matrix, ptrdiff_t size, ptrdiff_t from, ptrdiff_t to) {
    double explained = 0.0;
    for (ptrdiff_t j = from; j < to; j++) {
        const double *row = matrix + j * (size + 1), inverse = 1.0 / row[j];
        explained += row[size] * row[size] * inverse;
        for (ptrdiff_t i = j + 1; i < size; i++) {
            const double factor = row[i] * inverse;
            double *other = matrix + i * (size + 1);
            for (ptrdiff_t m = i; m <= size; m++) other[m] -= factor * row[m];
        }
    }
    return explained;
}

/* What may be singular but for rounding, made solvable. */
static void ridge(double *matrix, ptrdiff_t size, ptrdiff_t from, ptrdiff_t to, double share) {
    double mean = 0.0;
    for (ptrdiff_t j = from; j < to; j++) mean += matrix[j * (size + 2)] / (double)(to - from);
    for (ptrdiff_t j = from; j < to; j++) matrix[j * (size + 2)] += share * mean + 1e-12;
}

bool ledpi_weigh(double *matrix, ptrdiff_t size, ptrdiff_t nuisances, double squares, double freedom,
                 double independence, double *score, double *information) {
    const ptrdiff_t bands = size - nuisances;
    if (!(freedom > 0.0)) return false;
    ridge(matrix, size, 0, nuisances, LEDPI_RIDGE);
    squares -= eliminate(matrix, size, 0, nuisances);
    for (ptrdiff_t i = 0; i < bands; i++) {
        const double *row = matrix + (nuisances + i) * (size + 1);
        score[i] = row[size];
        for (ptrdiff_t j = i; j < bands; j++) information[i * bands + j] = row[nuisances + j];
    }
    ridge(matrix, size, nuisances, size, LEDPI_RIDGE);
    const double variance = (squares - eliminate(matrix, size, nuisances, size)) / freedom;
    if (!(variance > 0.0)) return false;
    const double scale = independence / variance;
    for (ptrdiff_t i = 0; i < bands; i++) {
        score[i] *= scale;
        for (ptrdiff_t j = i; j < bands; j++)
            information[j * bands + i] = information[i * bands + j] *= scale;
    }
    return true;
}

double ledpi_explained(double *matrix, ptrdiff_t size, double ridge_share) {
    ridge(matrix, size, 0, size, ridge_share);
    return eliminate(matrix, size, 0, size);
}
