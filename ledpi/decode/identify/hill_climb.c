/* Likelihood of the likeliest pattern that is no codeword: sought from the codeword and from many phases, each cell as they fit
 * it best; then one cell after the other. In antiphase a pattern's negative is the pattern. */
#include "patterns.h"

/* Phases of each wave that are begun with, patterns that are followed, and how far. (Of 800 panels and decoys the likeliest of
 * all 65,536 is found but for 7, and there one within 5 nats of it.) */
enum { PHASES = 8, CLIMBERS = 4, CLIMBS = 5 };
enum { MET = 2048 }; /* more than PHASES² + CLIMBERS·(CLIMBS − 1)·MOST_CELLS, and a power of 2 */

/* Patterns tried so far, and those that wait to be weighed. */
typedef struct {
    uint64_t met[MET];
    Pattern waiting[LANES];
    double log_of_prior, likeliest; /* the prior's part of a determinant; among the patterns beyond */
    uint64_t likeliest_changed;     /* that one's cells that are not the codeword's */
    ptrdiff_t wait, known, correctable, found;
    int64_t best[CLIMBERS]; /* (found,) the likeliest, and how likely these are */
    double of[CLIMBERS];
} Climb;

/* Weighs those that wait. */
static LEDPI_INLINE void weigh_waiting(Climb *climb, const ptrdiff_t parameters) {
    Lanes squares, determinant;
    weigh(climb->waiting, &squares, &determinant, parameters);
    for (ptrdiff_t n = 0; n < climb->wait; n++) {
        const double own = 0.5 * (squares[n] - log(determinant[n]) + climb->log_of_prior);
        const uint64_t changed = climb->waiting[n].changed;
        ptrdiff_t apart = __builtin_popcountll(changed);
        if (parameters == 2 && climb->known - apart < apart) apart = climb->known - apart; /* from the codeword or its negative */
        climb->found = ledpi_put((int64_t)changed, own, climb->found, CLIMBERS, climb->best, climb->of);
        if (apart > climb->correctable && (own > climb->likeliest || isnan(own))) {
            climb->likeliest = own;
            climb->likeliest_changed = changed;
        }
    }
    climb->wait = 0;
}

static LEDPI_INLINE void try_pattern(const Pattern *pattern, Climb *climb, const ptrdiff_t parameters) {
    climb->waiting[climb->wait++] = *pattern;
    if (climb->wait == LANES) weigh_waiting(climb, parameters);
}

/* Likelihood of a cell for each of PHASES of a wave that is as deep as expected. */
static LEDPI_INLINE void put_phases(const Evidence *evidence, ptrdiff_t cell, ptrdiff_t wave, double *explained,
                                    const ptrdiff_t parameters) {
    const ptrdiff_t size = evidence->cells * parameters, at = cell * parameters + 2 * wave;
    const double *score = evidence->score + at, *own = evidence->information + at * size + at;
    const double depth = sqrt(2.0 * evidence->prior[2 * wave]);
    for (int n = 0; n < PHASES; n++) {
        const double turn = 2.0 * 3.14159265358979323846 * n / PHASES, x = depth * cos(turn), y = depth * sin(turn);
        explained[n] = score[0] * x + score[1] * y;
        if (parameters == 4) explained[n] -= 0.5 * (x * x * own[0] + x * y * (own[1] + own[size]) + y * y * own[size + 1]);
    }
}

/* Tries the patterns of the cells that are known, each as phases of the waves fit it best. */
static LEDPI_INLINE void begin(const Evidence *evidence, const float *codeword, const uint8_t *erased, const Around *around,
                               Climb *climb, const ptrdiff_t parameters) {
    const Pattern start = unchanged(around);
    const int of_black = parameters == 4 ? PHASES : 1;
    uint64_t changed[PHASES * PHASES] = {0};
    for (ptrdiff_t c = 0; c < evidence->cells; c++) {
        double black[PHASES] = {0}, white[PHASES] = {0};
        if (erased[c]) continue;
        if (parameters == 4) put_phases(evidence, c, 1, white, parameters);
        put_phases(evidence, c, 0, black, parameters);
        for (int n = 0; n < of_black * PHASES; n++) /* in antiphase a class is the other's negative */
            if ((parameters == 4 ? white[n % PHASES] > black[n / PHASES] : black[n] < 0.0) != (codeword[c] > 0.0f))
                changed[n] |= UINT64_C(1) << c;
    }
    try_pattern(&start, climb, parameters);
    for (int n = 0; n < of_black * PHASES; n++) {
        if (!changed[n] || !is_new(climb->met, MET, changed[n])) continue;
        Pattern pattern = start;
        for (uint64_t left = changed[n]; left; left &= left - 1)
            change_cell(evidence, around, __builtin_ctzll(left), &pattern, parameters);
        try_pattern(&pattern, climb, parameters);
    }
    weigh_waiting(climb, parameters);
}

static LEDPI_INLINE double climb_from(const Evidence *evidence, const float *codeword, ptrdiff_t correctable, float *pattern,
                                      const ptrdiff_t parameters) {
    uint8_t erased[MOST_CELLS];
    Around around;
    Climb climb = {.likeliest = -INFINITY, .correctable = correctable};
    climb.known = evidence->cells - ledpi_put_erased(evidence, erased);
    for (ptrdiff_t i = 0; i < parameters; i++) climb.log_of_prior -= log(evidence->prior[i]);
    look_around(evidence, codeword, &around, parameters);
    begin(evidence, codeword, erased, &around, &climb, parameters);
    for (int round = 1; round < CLIMBS; round++) {
        int64_t here[CLIMBERS];
        const ptrdiff_t count = climb.found;
        memcpy(here, climb.best, sizeof here);
        for (ptrdiff_t n = 0; n < count; n++) {
            Pattern from = unchanged(&around);
            for (uint64_t left = (uint64_t)here[n]; left; left &= left - 1)
                change_cell(evidence, &around, __builtin_ctzll(left), &from, parameters);
            for (ptrdiff_t c = 0; c < evidence->cells; c++) {
                const uint64_t changed = from.changed ^ UINT64_C(1) << c;
                if (erased[c] || !changed || !is_new(climb.met, MET, changed)) continue;
                Pattern pattern = from;
                change_cell(evidence, &around, c, &pattern, parameters);
                try_pattern(&pattern, &climb, parameters);
            }
        }
        weigh_waiting(&climb, parameters);
    }
    for (ptrdiff_t c = 0; c < evidence->cells; c++) pattern[c] = climb.likeliest_changed >> c & 1 ? 1.0f - codeword[c] : codeword[c];
    return climb.likeliest;
}

/* The log-likelihood ratio to "no bands" of the likeliest pattern that differs from a codeword (cells,) in more cells than are
 * `correctable`, none of them erased, with the bands that fit it best; and that `pattern` (cells,). At most 64 cells.
 * Not a number where one's is none. */
LEDPI_SIMD double ledpi_likeliest_far_pattern(ptrdiff_t cells, ptrdiff_t parameters, const double *score,
                                         const double *information, const double *prior, const float *codeword,
                                         ptrdiff_t correctable, float *pattern) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    return parameters == 4 ? climb_from(&evidence, codeword, correctable, pattern, 4)
                           : climb_from(&evidence, codeword, correctable, pattern, 2);
}
