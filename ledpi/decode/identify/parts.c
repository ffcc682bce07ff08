/* Likelihood of the likeliest part of a panel: a square that shows fewer rows or columns of cells than were fitted to it.
 *
 * Its own cells are evenly large, so a fitted cell shows of each the share that it overlaps with, a matrix S, and the evidence b, A
 * of the fitted cells is Sᵀb, SᵀAS of its own. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "codewords.h"
#include "core.h"
#include "normal.h"
#include "simd.h"

/* Share of the fitted cell `at`, of `side` along a panel, that is the part's cell `own`, of `count`. */
static double overlap_of(ptrdiff_t at, ptrdiff_t side, ptrdiff_t own, ptrdiff_t count) {
    const double first = fmax((double)at / (double)side, (double)own / (double)count);
    const double last = fmin((double)(at + 1) / (double)side, (double)(own + 1) / (double)count);
    return fmax(0.0, last - first) * (double)side;
}

/* Puts `to` (rows · columns, width) from `from` (side², width): what each cell of a part has of the fitted ones. */
LEDPI_SIMD static void gather_parts(ptrdiff_t side, ptrdiff_t rows, ptrdiff_t columns, ptrdiff_t width, const double *from, double *to) {
    memset(to, 0, sizeof(double) * (size_t)(rows * columns * width));
    for (ptrdiff_t c = 0; c < side * side; c++)
        for (ptrdiff_t k = 0; k < rows * columns; k++) {
            const double below = overlap_of(c / side, side, k / columns, rows);
            const double share = below == 0.0 ? 0.0 : below * overlap_of(c % side, side, k % columns, columns);
            if (share == 0.0) continue;
            for (ptrdiff_t i = 0; i < width; i++) to[k * width + i] += share * from[c * width + i];
        }
}

/* Room to work in; the part's evidence is in `score` and `information`. */
typedef struct {
    double *half, *turned, *information, *matrix, score[LEDPI_MOST_CELLS * MOST];
} Room;

/* Puts the evidence of a part of rows × columns cells. The matrix is symmetric, so that it is gathered twice the same way. */
static Evidence part_of(const Evidence *all, ptrdiff_t side, ptrdiff_t rows, ptrdiff_t columns, Room *room) {
    const ptrdiff_t parameters = all->parameters, count = all->cells * parameters, size = rows * columns * parameters;
    gather_parts(side, rows, columns, parameters, all->score, room->score);
    gather_parts(side, rows, columns, parameters * count, all->information, room->half);
    for (ptrdiff_t i = 0; i < size; i++)
        for (ptrdiff_t j = 0; j < count; j++) room->turned[j * size + i] = room->half[i * count + j];
    gather_parts(side, rows, columns, parameters * size, room->turned, room->information);
    return (Evidence){rows * columns, parameters, room->score, room->information, all->prior};
}

/* Tells whether bands of its own in every cell of a part are likelier than `enough`; so no pattern is that they are not. */
static bool may_reach(const Evidence *part, double enough, double *matrix) {
    const ptrdiff_t size = part->cells * part->parameters;
    for (ptrdiff_t i = 0; i < size; i++) {
        memcpy(matrix + i * (size + 1), part->information + i * size, sizeof(double) * (size_t)size);
        matrix[i * (size + 1) + size] = part->score[i];
    }
    return !(0.5 * ledpi_explained(matrix, size, 1e-6) <= enough);
}

/* Tells whether a part can show the very same as the codeword (side²,): then no evidence speaks for one of them. */
static bool is_part(const float *codeword, ptrdiff_t side, ptrdiff_t rows, ptrdiff_t columns) {
    for (ptrdiff_t k = 0; k < rows * columns; k++) {
        float shown = -1.0f;
        for (ptrdiff_t c = 0; c < side * side; c++) {
            if (overlap_of(c / side, side, k / columns, rows) * overlap_of(c % side, side, k % columns, columns) == 0.0) continue;
            if (shown >= 0.0f && shown != codeword[c]) return false;
            shown = codeword[c];
        }
    }
    return true;
}

static double likeliest_part(const Evidence *all, const float *codeword, ptrdiff_t side, double enough, Room *room) {
    const float black[LEDPI_MOST_CELLS] = {0.0f};
    float pattern[LEDPI_MOST_CELLS];
    bool across[LEDPI_MOST_CELLS], down[LEDPI_MOST_CELLS];
    for (ptrdiff_t n = 1; n < side; n++) {
        Evidence part = part_of(all, side, side, n, room);
        across[n] = may_reach(&part, enough, room->matrix);
        part = part_of(all, side, n, side, room);
        down[n] = may_reach(&part, enough, room->matrix);
    }
    double most = -INFINITY;
    across[side] = down[side] = true;
    for (ptrdiff_t rows = 1; rows <= side; rows++)
        for (ptrdiff_t columns = 1; columns <= side; columns++) {
            if (!down[rows] || !across[columns] || is_part(codeword, side, rows, columns)) continue;
            const Evidence part = part_of(all, side, rows, columns, room);
            const double likelihood = ledpi_likeliest_far_pattern(part.cells, part.parameters, part.score, part.information,
                                                                  part.prior, black, -1, pattern) - (double)part.cells * log(2.0);
            if (likelihood > most || isnan(likelihood)) most = likelihood;
        }
    return most;
}

/* The log-likelihood ratio to "no bands" of the likeliest pattern of a part of a panel, less ln 2 for each cell of that, as there
 * are so many patterns: of all parts of a square panel that cannot show a codeword (cells,); −∞ where none is above `enough`. Not a
 * number where one's is none, or without memory. */
double ledpi_likeliest_part(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information, const double *prior,
                            const float *codeword, double enough) {
    const Evidence all = {cells, parameters, score, information, prior};
    const size_t size = (size_t)(cells * parameters), square = size * size;
    ptrdiff_t side = 1;
    Room room;
    while (side * side < cells) side++;
    room.half = malloc(sizeof(double) * (4 * square + size));
    if (!room.half) return NAN;
    room.turned = room.half + square, room.information = room.turned + square, room.matrix = room.information + square;
    const double most = likeliest_part(&all, codeword, side, enough, &room);
    free(room.half);
    return most;
}
