/* Likelihood of the likeliest part of a panel: a square that shows fewer rows or columns of cells than were fitted to it, as some
 * codeword has them next to each other.
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

/* Cells of the largest parts that are looked at: all but the whole of a panel of 4 × 4. A larger panel's parts may have more, but then
 * a dictionary has so few of all patterns that none is near a codeword. */
enum { MOST_OWN = 12 };

/* Patterns that a part may show, (count, rows · columns): each block of each codeword but once, and none that shows the best codeword
 * itself. */
typedef struct {
    ptrdiff_t count;
    float of[(1 << MOST_OWN) * MOST_OWN];
    bool met[1 << MOST_OWN];
} Blocks;

/* Tells whether a block shows the very same as a codeword (side²,), or as its negative: then no evidence speaks for one of them. */
static bool is_same(const float *block, ptrdiff_t rows, ptrdiff_t columns, const float *codeword, ptrdiff_t side, bool negative) {
    for (ptrdiff_t c = 0; c < side * side; c++)
        for (ptrdiff_t k = 0; k < rows * columns; k++) {
            const double below = overlap_of(c / side, side, k / columns, rows), across = overlap_of(c % side, side, k % columns, columns);
            if (below * across != 0.0 && block[k] != (negative ? 1.0f - codeword[c] : codeword[c])) return false;
        }
    return true;
}

/* Puts the blocks of a size, until there are no other patterns. In antiphase a pattern's negative is the pattern. */
static void put_blocks(const float *codewords, ptrdiff_t codeword_count, const float *best, ptrdiff_t side, ptrdiff_t rows,
                       ptrdiff_t columns, bool antiphase, Blocks *blocks) {
    const ptrdiff_t across = side - columns + 1, places = (side - rows + 1) * across, own = rows * columns;
    ptrdiff_t missing = (ptrdiff_t)1 << own;
    memset(blocks->met, 0, sizeof blocks->met);
    blocks->count = 0;
    for (ptrdiff_t n = 0; n < codeword_count * places && missing; n++) {
        const float *const corner = codewords + (n / places * side + n % places / across) * side + n % across;
        float *const block = blocks->of + blocks->count * own;
        ptrdiff_t bits = 0;
        for (ptrdiff_t k = 0; k < own; k++) bits = bits << 1 | (corner[k / columns * side + k % columns] > 0.0f);
        if (blocks->met[bits]) continue;
        blocks->met[bits] = true, missing--;
        for (ptrdiff_t k = 0; k < own; k++) block[k] = (float)(bits >> (own - 1 - k) & 1);
        if (is_same(block, rows, columns, best, side, false) || (antiphase && is_same(block, rows, columns, best, side, true))) continue;
        blocks->count++;
    }
}

/* The log-likelihood ratio to "no bands" of the likeliest part of a panel that shows one of the codewords (codeword_count, cells),
 * less the log of how many patterns parts of its size have: of all sizes up to MOST_OWN cells but the whole, and of all patterns but what
 * shows the `best` codeword itself. −∞ where none is above `enough`, not a number where one's is none, or without memory. */
double ledpi_likeliest_part(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information, const double *prior,
                            const float *codewords, ptrdiff_t codeword_count, ptrdiff_t best, double enough) {
    const Evidence all = {cells, parameters, score, information, prior};
    const size_t size = (size_t)(cells * parameters), square = size * size;
    bool across[LEDPI_MOST_CELLS], down[LEDPI_MOST_CELLS];
    double most = -INFINITY;
    ptrdiff_t side = 1;
    Room room;
    while (side * side < cells) side++;
    room.half = malloc(sizeof(double) * (4 * square + size) + sizeof(Blocks));
    if (!room.half) return NAN;
    room.turned = room.half + square, room.information = room.turned + square, room.matrix = room.information + square;
    Blocks *const blocks = (Blocks *)(room.matrix + square + size);
    for (ptrdiff_t n = 1; n <= side; n++) {
        across[n] = down[n] = true;
        if (n == side || side * n > MOST_OWN) continue;
        Evidence part = part_of(&all, side, side, n, &room);
        across[n] = may_reach(&part, enough, room.matrix);
        part = part_of(&all, side, n, side, &room);
        down[n] = may_reach(&part, enough, room.matrix);
    }
    for (ptrdiff_t rows = 1; rows <= side; rows++)
        for (ptrdiff_t columns = 1; columns <= side; columns++) {
            if (rows * columns > MOST_OWN || rows * columns == cells || !down[rows] || !across[columns]) continue;
            const Evidence part = part_of(&all, side, rows, columns, &room);
            if (!may_reach(&part, enough, room.matrix)) continue;
            put_blocks(codewords, codeword_count, codewords + best * cells, side, rows, columns, parameters == 2, blocks);
            const double likelihood = ledpi_likeliest_codeword(&part, blocks->of, blocks->count) - log(fmax((double)blocks->count, 1.0));
            if (likelihood > most || isnan(likelihood)) most = likelihood;
        }
    free(room.half);
    return most;
}
