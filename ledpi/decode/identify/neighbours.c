/* Likelihoods of patterns near a codeword, each with the bands that fit it best. */
#include "patterns.h"

enum { BEAM = 16 }; /* patterns from which others are tried that differ in one more cell: with 8, the likeliest was missed */
enum { MET = 4 * BEAM * MOST_CELLS }; /* more than are tried, and a power of 2 */

/* Sums over the patterns that differ in so many cells, and over all before. */
typedef struct {
    bool counts, last; /* in the sum; no others are tried from these */
    double most, sum; /* the sum of the likelihoods over e^most, the largest of them */
    ptrdiff_t found;
    int64_t next[BEAM]; /* (found,) the likeliest, and how likely these are */
    double of[BEAM];
} Tried;

/* Takes `count` patterns of LANES in. A likelihood is ½·(squares − ln determinant); with what the prior alone makes of the
 * determinant most are seen to be too small, and need no logarithm. */
static LEDPI_INLINE void take_in(const Pattern *patterns, ptrdiff_t count, double of_prior, double log_of_prior,
                                 Tried *tried, const ptrdiff_t parameters) {
    Lanes squares, determinant;
    weigh(patterns, &squares, &determinant, parameters);
    for (ptrdiff_t n = 0; n < count; n++) {
        const bool rises = !tried->last && (tried->found < BEAM || 0.5 * (squares[n] - log_of_prior) > tried->of[BEAM - 1]);
        const double least = tried->most - 50.0; /* e⁻⁵⁰ of what is there is lost in rounding */
        const bool adds = tried->counts && !(0.5 * (squares[n] - log_of_prior) < least);
        if (determinant[n] >= of_prior && !rises && !adds) continue;
        const double own = 0.5 * (squares[n] - log(determinant[n]));
        if (!tried->last) tried->found = ledpi_put((int64_t)patterns[n].changed, own, tried->found, BEAM, tried->next, tried->of);
        if (!tried->counts || own < least) continue;
        if (own > tried->most) tried->sum = tried->sum * exp(tried->most - own) + 1.0, tried->most = own;
        else tried->sum += exp(own - tried->most);
    }
}

static LEDPI_INLINE double near_pattern_likelihood(const Evidence *evidence, const float *codeword, ptrdiff_t nearest, ptrdiff_t furthest,
                                         const ptrdiff_t parameters) {
    const ptrdiff_t met_size = evidence->cells > 16 ? MET : MET / 4;
    uint64_t met[MET];
    uint8_t erased[MOST_CELLS];
    Around all, *around = &all;
    ledpi_put_erased(evidence, erased);
    look_around(evidence, codeword, around, parameters);
    Pattern here[BEAM] = {unchanged(around)}, waiting[LANES] = {{.changed = 0}};
    Tried tried = {.most = -INFINITY};
    double of_prior = 1.0, log_of_prior = 0.0;
    for (ptrdiff_t i = 0; i < parameters; i++) of_prior /= evidence->prior[i], log_of_prior -= log(evidence->prior[i]);
    for (ptrdiff_t differ = 1, known = 1; differ <= furthest; differ++, known = tried.found) {
        ptrdiff_t wait = 0;
        tried.counts = differ >= nearest, tried.last = differ == furthest, tried.found = 0;
        memset(met, 0, sizeof(uint64_t) * (size_t)met_size);
        for (ptrdiff_t n = 0; n < known; n++)
            for (ptrdiff_t c = 0; c < evidence->cells; c++) {
                const uint64_t changed = here[n].changed | UINT64_C(1) << c;
                if (changed == here[n].changed || erased[c] || !is_new(met, met_size, changed)) continue;
                waiting[wait] = here[n];
                change_cell(evidence, around, c, &waiting[wait++], parameters);
                if (wait < LANES) continue;
                take_in(waiting, wait, of_prior, log_of_prior, &tried, parameters);
                wait = 0;
            }
        if (wait) take_in(waiting, wait, of_prior, log_of_prior, &tried, parameters);
        for (ptrdiff_t n = 0; n < tried.found; n++) {
            here[n] = unchanged(around);
            for (uint64_t left = (uint64_t)tried.next[n]; left; left &= left - 1)
                change_cell(evidence, around, __builtin_ctzll(left), &here[n], parameters);
        }
    }
    return tried.most + log(tried.sum) + 0.5 * log_of_prior;
}

/* The log of the sum of the likelihoods of patterns that differ from a codeword (cells,) in `nearest` to `furthest` cells, none
 * of them erased, each with the bands that fit it best: from the codeword outward, those near the BEAM likeliest of the
 * patterns one cell nearer. At most 64 cells. Not a number where a pattern's likelihood is none. */
LEDPI_SIMD double ledpi_near_pattern_likelihood(ptrdiff_t cells, ptrdiff_t parameters, const double *score,
                                      const double *information, const double *prior, const float *codeword,
                                      ptrdiff_t nearest, ptrdiff_t furthest) {
    const Evidence evidence = {cells, parameters, score, information, prior};
    return parameters == 4 ? near_pattern_likelihood(&evidence, codeword, nearest, furthest, 4)
                           : near_pattern_likelihood(&evidence, codeword, nearest, furthest, 2);
}
