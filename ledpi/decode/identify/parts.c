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

/* Patterns that a part may show, (count, rows · columns): each block of each codeword but once, and none that shows the best codeword
 * itself. `met` are those so far; its size is a power of 2, more than there are blocks. */
typedef struct {
    ptrdiff_t count;
    float *of;
    uint64_t *met;
    size_t slots;
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

static bool is_new(uint64_t bits, Blocks *blocks) {
    const uint64_t key = bits + 1; /* no slot that is taken is 0 */
    for (size_t at = (size_t)(key * UINT64_C(0x9e3779b97f4a7c15) >> 20);; at++) {
        at &= blocks->slots - 1;
        if (blocks->met[at] == key) return false;
        if (blocks->met[at]) continue;
        blocks->met[at] = key;
        return true;
    }
}

static void put_blocks(const float *codewords, ptrdiff_t codeword_count, const float *best, ptrdiff_t side, ptrdiff_t rows,
                       ptrdiff_t columns, bool antiphase, Blocks *blocks) {
    memset(blocks->met, 0, sizeof *blocks->met * blocks->slots);
    blocks->count = 0;
    for (ptrdiff_t w = 0; w < codeword_count; w++)
        for (ptrdiff_t first = 0; first < (side - rows + 1) * (side - columns + 1); first++) {
            const float *const corner = codewords + (w * side + first / (side - columns + 1)) * side + first % (side - columns + 1);
            float *const block = blocks->of + blocks->count * rows * columns;
            uint64_t bits = 0;
            for (ptrdiff_t k = 0; k < rows * columns; k++) {
                block[k] = corner[k / columns * side + k % columns];
                bits = bits << 1 | (block[k] > 0.0f);
            }
            if (!is_new(bits, blocks) || is_same(block, rows, columns, best, side, false)) continue;
            if (!(antiphase && is_same(block, rows, columns, best, side, true))) blocks->count++;
        }
}

/* The likeliest block of rows × columns cells; less the log of how many there are. */
static double likeliest_block(const Evidence *part, const float *codewords, ptrdiff_t codeword_count, const float *best, ptrdiff_t side,
                              ptrdiff_t rows, ptrdiff_t columns) {
    const size_t windows = (size_t)(codeword_count * (side - rows + 1) * (side - columns + 1));
    Blocks blocks = {.slots = 1};
    double likelihood = NAN;
    while (blocks.slots <= windows) blocks.slots *= 2;
    blocks.of = malloc(sizeof(float) * (windows + 1) * (size_t)part->cells), blocks.met = malloc(sizeof(uint64_t) * blocks.slots);
    if (blocks.of && blocks.met) {
        put_blocks(codewords, codeword_count, best, side, rows, columns, part->parameters == 2, &blocks);
        likelihood = ledpi_likeliest_codeword(part, blocks.of, blocks.count) - log(fmax((double)blocks.count, 1.0));
    }
    free(blocks.of), free(blocks.met);
    return likelihood;
}

/* The log-likelihood ratio to "no bands" of the likeliest part of a panel that shows one of the codewords (codeword_count, cells),
 * less the log of how many patterns parts of its size have: of all sizes but the whole, and of all patterns but what shows the `best`
 * codeword itself. −∞ where none is above `enough`, not a number where one's is none, or without memory. */
double ledpi_likeliest_part(ptrdiff_t cells, ptrdiff_t parameters, const double *score, const double *information, const double *prior,
                            const float *codewords, ptrdiff_t codeword_count, ptrdiff_t best, double enough) {
    const Evidence all = {cells, parameters, score, information, prior};
    const size_t size = (size_t)(cells * parameters), square = size * size;
    bool across[LEDPI_MOST_CELLS], down[LEDPI_MOST_CELLS];
    double most = -INFINITY;
    ptrdiff_t side = 1;
    Room room;
    while (side * side < cells) side++;
    room.half = malloc(sizeof(double) * (4 * square + size));
    if (!room.half) return NAN;
    room.turned = room.half + square, room.information = room.turned + square, room.matrix = room.information + square;
    for (ptrdiff_t n = 1; n < side; n++) {
        Evidence part = part_of(&all, side, side, n, &room);
        across[n] = may_reach(&part, enough, room.matrix);
        part = part_of(&all, side, n, side, &room);
        down[n] = may_reach(&part, enough, room.matrix);
    }
    across[side] = down[side] = true;
    for (ptrdiff_t rows = 1; rows <= side; rows++)
        for (ptrdiff_t columns = 1; columns <= side; columns++) {
            if (rows * columns == cells || !down[rows] || !across[columns]) continue;
            const Evidence part = part_of(&all, side, rows, columns, &room);
            const double likelihood = likeliest_block(&part, codewords, codeword_count, codewords + best * cells, side, rows, columns);
            if (likelihood > most || isnan(likelihood)) most = likelihood;
        }
    free(room.half);
    return most;
}
