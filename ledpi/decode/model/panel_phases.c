/* The phases of a panel's two waves, where nothing is known of its cells' classes: on a grid. */
#include <string.h>

#include "panel.h"

enum { PHASES = 12 }; /* in half a cycle: a mix of either sign is a wave that is half a cycle later */

/* Sums over a cell's rows: of its steady light with itself, and with what is seen; of either wave with these, and with
 * itself, the mean taken off. */
typedef struct {
    float with_seen[2][PHASES], square[2][PHASES], mean[2][PHASES], one, gain;
} Sums;

static Sums sums_of(ptrdiff_t rows, const float *own, const float *seen, float wave[2][PHASES][MOST_ROWS]) {
    Sums s = {.one = 0.0f};
    float y = 0.0f;
    for (ptrdiff_t r = 0; r < rows; r++) s.one += own[r], y += seen[r];
    if (!(s.one > 0.0f)) return s;
    s.gain = y / s.one;
    for (int k = 0; k < 2; k++)
        for (int p = 0; p < PHASES; p++) {
            float mean = 0.0f, square = 0.0f, with_seen = 0.0f;
            for (ptrdiff_t r = 0; r < rows; r++) {
                const float w = wave[k][p][r], by = own[r] * w;
                mean += by, square += by * w, with_seen += seen[r] * w;
            }
            s.mean[k][p] = mean;
            s.square[k][p] = square - mean * mean / s.one;
            s.with_seen[k][p] = with_seen - mean * y / s.one;
        }
    return s;
}

/* Squares that both waves explain beside a gain, in log-likelihood's unit times two. A wave that is all but even in a cell tells
 * nothing of it: how much a cell shows of one has a prior, `ridge` of which is the noise over its variance. */
static float explained(const Sums *s, int a, int b, float both, float ridge) {
    const float aa = s->square[0][a] + ridge, bb = s->square[1][b] + ridge;
    const float ab = both - s->mean[0][a] * s->mean[1][b] / s->one, ya = s->with_seen[0][a], yb = s->with_seen[1][b];
    const float determinant = aa * bb - ab * ab;
    return determinant > 0.0f ? (ya * ya * bb - 2.0f * ya * yb * ab + yb * yb * aa) / determinant : 0.0f;
}

static float wave_at(const float *table, double cycles) {
    double turn = cycles - (double)(ptrdiff_t)cycles; /* the fraction may be negative */
    if (turn < 0.0) turn += 1.0;
    const double at = turn * WAVE_STEPS;
    ptrdiff_t step = (ptrdiff_t)at;
    step = step < WAVE_STEPS ? step : WAVE_STEPS - 1;
    const double here = table[step], next = table[step + 1 < WAVE_STEPS ? step + 1 : 0];
    return (float)(here + (at - (double)step) * (next - here));
}

static void put_waves(const Panel *panel, const View *view, ptrdiff_t rows, float wave[2][PHASES][MOST_ROWS]) {
    for (int k = 0; k < 2; k++)
        for (int p = 0; p < PHASES; p++)
            for (ptrdiff_t r = 0; r < rows; r++) {
                const double row = view->first_y + view->shrink * (double)r;
                wave[k][p][r] = wave_at(panel->waves + k * WAVE_STEPS, 0.5 * p / PHASES + row * panel->cycles_a_row[k]);
            }
}

Bands ledpi_panel_phases(const Panel *panel, const View *view, ptrdiff_t rows, const float *squares, const float *products,
                         float ridge, double phases[2]) {
    float wave[2][PHASES][MOST_ROWS], all[PHASES][PHASES] = {{0.0f}}, expected[PHASES][PHASES] = {{0.0f}};
    put_waves(panel, view, rows, wave);
    for (ptrdiff_t c = 0; c < panel->cells * panel->cells; c++) {
        ptrdiff_t from = 0, to = rows; /* the rows that the cell is in */
        while (from < to && squares[c * rows + from] == 0.0f) from++;
        while (to > from && squares[c * rows + to - 1] == 0.0f) to--;
        if (from == to) continue;
        float shifted[2][PHASES][MOST_ROWS];
        for (int k = 0; k < 2; k++)
            for (int p = 0; p < PHASES; p++) memcpy(shifted[k][p], wave[k][p] + from, (size_t)(to - from) * sizeof(float));
        const float *own = squares + c * rows + from;
        const Sums s = sums_of(to - from, own, products + c * rows + from, shifted);
        for (int a = 0; a < PHASES; a++) {
            float weighed[MOST_ROWS];
            for (ptrdiff_t r = 0; r < to - from; r++) weighed[r] = own[r] * shifted[0][a][r];
            for (int b = 0; b < PHASES; b++) {
                float both = 0.0f;
                for (ptrdiff_t r = 0; r < to - from; r++) both += weighed[r] * shifted[1][b][r];
                all[a][b] += explained(&s, a, b, both, ridge);
                expected[a][b] += s.gain * s.gain * fminf(s.square[0][a], s.square[1][b]);
            }
        }
    }
    Bands best = {-1.0, 0.0};
    for (int a = 0; a < PHASES; a++)
        for (int b = 0; b < PHASES; b++)
            if (all[a][b] > best.seen) {
                best = (Bands){all[a][b], expected[a][b]};
                phases[0] = 0.5 * a / PHASES, phases[1] = 0.5 * b / PHASES;
            }
    return best;
}
