/* Normal equations: sums of products, and the elimination of what is not asked for. */

#include "normal.h"
#include "simd.h"

enum { DOWN = 4, MOST_ACROSS = 16 / LEDPI_WIDTH };

/* DOWN rows of the sums, at i, in `across` vectors from j on: the more, the fewer numbers are read for each product. */
static LEDPI_INLINE void add_tile(const float *rows, const float *to, ptrdiff_t width, ptrdiff_t i, ptrdiff_t j, const int across,
                                  float *sums) {
    Floats tile[DOWN][MOST_ACROSS] = {{{0}}};
    for (const float *row = rows; row < to; row += width)
        for (int k = 0; k < across; k++) {
            const Floats right = *(const Floats *)(row + j + k * LEDPI_WIDTH);
            for (int m = 0; m < DOWN; m++) tile[m][k] += row[i + m] * right;
        }
    for (int m = 0; m < DOWN; m++)
        for (int k = 0; k < across; k++) *(Floats *)(sums + (i + m) * width + j + k * LEDPI_WIDTH) += tile[m][k];
}

static LEDPI_INLINE void add_products(const float *rows, ptrdiff_t count, ptrdiff_t width, float *sums, const bool broad) {
    for (ptrdiff_t from = 0; from < count; from += LEDPI_AT_ONCE) {
        const ptrdiff_t end = from + LEDPI_AT_ONCE < count ? from + LEDPI_AT_ONCE : count;
        const float *first = rows + width * from, *to = rows + width * end;
        for (ptrdiff_t i = 0; i < width; i += DOWN) {
            ptrdiff_t j = i / LEDPI_WIDTH * LEDPI_WIDTH;
            for (; broad && j + 16 <= width; j += 16) add_tile(first, to, width, i, j, MOST_ACROSS, sums);
            for (; j < width; j += LEDPI_WIDTH) add_tile(first, to, width, i, j, 1, sums);
        }
    }
}

#if defined(__x86_64__) && defined(__GNUC__)
__attribute__((target("avx,fma"))) static void add_by_fma(const float *rows, ptrdiff_t count, ptrdiff_t width, float *sums) {
    add_products(rows, count, width, sums, true);
}

void ledpi_add_products(const float *rows, ptrdiff_t count, ptrdiff_t width, float *sums) {
    if (__builtin_cpu_supports("fma"))
        add_by_fma(rows, count, width, sums);
    else
        add_products(rows, count, width, sums, false);
}
#else
void ledpi_add_products(const float *rows, ptrdiff_t count, ptrdiff_t width, float *sums) {
    add_products(rows, count, width, sums, true);
}
#endif

enum { HALF = LEDPI_WIDTH / 2 };
typedef double Doubles __attribute__((vector_size(8 * HALF), aligned(8)));

/* Takes four rows by their `factors` off one row and the next, which there may be none of, from column `from` to the end. */
static LEDPI_INLINE void take_off(const double *const rows[4], double factors[2][4], ptrdiff_t from, ptrdiff_t end,
                                  double *one, double *next) {
    for (; (end - from) % HALF; from++) {
        double of_one = 0.0, of_next = 0.0;
        for (int j = 0; j < 4; j++) of_one += factors[0][j] * rows[j][from], of_next += factors[1][j] * rows[j][from];
        one[from] -= of_one;
        if (next) next[from] -= of_next;
    }
    for (ptrdiff_t m = from; m < end; m += HALF) {
        const Doubles a = *(const Doubles *)(rows[0] + m), b = *(const Doubles *)(rows[1] + m);
        const Doubles c = *(const Doubles *)(rows[2] + m), d = *(const Doubles *)(rows[3] + m);
        *(Doubles *)(one + m) -= (factors[0][0] * a + factors[0][1] * b) + (factors[0][2] * c + factors[0][3] * d);
        if (next) *(Doubles *)(next + m) -= (factors[1][0] * a + factors[1][1] * b) + (factors[1][2] * c + factors[1][3] * d);
    }
}

static bool are_none(double factors[2][4]) {
    for (int j = 0; j < 4; j++)
        if (factors[0][j] != 0.0 || factors[1][j] != 0.0) return false;
    return true;
}

/* Four unknowns are taken off all further rows at a time, so that each of these is read and written a quarter as often; but for
 * rows that have nothing to do with them, as cells that do not touch. */
LEDPI_SIMD double ledpi_eliminate(double *matrix, ptrdiff_t size, ptrdiff_t from, ptrdiff_t to) {
    const ptrdiff_t stride = size + 1;
    double explained = 0.0;
    for (ptrdiff_t first = from; first < to; first += 4) {
        const ptrdiff_t end = first + 4 < to ? first + 4 : to, last = end - 1;
        for (ptrdiff_t j = first; j < end; j++) {
            const double *row = matrix + j * stride, inverse = 1.0 / row[j];
            explained += row[size] * row[size] * inverse;
            for (ptrdiff_t i = j + 1; i < end; i++) {
                const double factor = row[i] * inverse;
                double *other = matrix + i * stride;
                for (ptrdiff_t m = i; m <= size; m++) other[m] -= factor * row[m];
            }
        }
        const double *rows[4] = {0};
        double inverse[4] = {0};
        for (ptrdiff_t j = 0; j < 4; j++) {
            rows[j] = matrix + (first + j <= last ? first + j : last) * stride;
            inverse[j] = first + j <= last ? 1.0 / rows[j][first + j] : 0.0; /* a last one counts once */
        }
        for (ptrdiff_t i = end; i < size; i += 2) {
            double factors[2][4];
            for (int j = 0; j < 4; j++) {
                factors[0][j] = rows[j][i] * inverse[j];
                factors[1][j] = i + 1 < size ? rows[j][i + 1] * inverse[j] : 0.0;
            }
            if (are_none(factors)) continue;
            double *own = matrix + i * stride;
            own[i] -= (factors[0][0] * rows[0][i] + factors[0][1] * rows[1][i]) + (factors[0][2] * rows[2][i] + factors[0][3] * rows[3][i]);
            take_off(rows, factors, i + 1, size + 1, own, i + 1 < size ? own + stride : NULL);
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
                 double *score, double *information) {
    const ptrdiff_t bands = size - nuisances;
    if (!(freedom > 0.0)) return false;
    ridge(matrix, size, 0, nuisances, LEDPI_RIDGE);
    squares -= ledpi_eliminate(matrix, size, 0, nuisances);
    for (ptrdiff_t i = 0; i < bands; i++) {
        const double *row = matrix + (nuisances + i) * (size + 1);
        score[i] = row[size];
        for (ptrdiff_t j = i; j < bands; j++) information[i * bands + j] = row[nuisances + j];
    }
    ridge(matrix, size, nuisances, size, LEDPI_RIDGE);
    const double variance = (squares - ledpi_eliminate(matrix, size, nuisances, size)) / freedom;
    if (!(variance > 0.0)) return false;
    const double scale = 1.0 / variance;
    for (ptrdiff_t i = 0; i < bands; i++) {
        score[i] *= scale;
        for (ptrdiff_t j = i; j < bands; j++)
            information[j * bands + i] = information[i * bands + j] *= scale;
    }
    return true;
}

LEDPI_SIMD void ledpi_solve(const double *matrix, ptrdiff_t size, double *unknowns) {
    for (ptrdiff_t j = size - 1; j >= 0; j--) {
        const double *row = matrix + j * (size + 1);
        double left = row[size];
        Doubles known = {0};
        ptrdiff_t i = j + 1;
        for (; i + HALF <= size; i += HALF) known += *(const Doubles *)(row + i) * *(const Doubles *)(unknowns + i);
        for (; i < size; i++) left -= row[i] * unknowns[i];
        for (int k = 2; k < HALF; k++) known[k - 2] += known[k];
        unknowns[j] = (left - (known[0] + known[1])) / row[j];
    }
}

double ledpi_explained(double *matrix, ptrdiff_t size, double ridge_share) {
    ridge(matrix, size, 0, size, ridge_share);
    return ledpi_eliminate(matrix, size, 0, size);
}
