/* What a panel sends to a place of the picture, and how that changes with every unknown: the one equation.
 *
 *   light(U, V) = dark + Σ_c A_c(U)·A_c(V)·S(x, y)·(gain_c + a_c·w_A(row) + b_c·w_B(row)) + Σ_side level·O_side
 *
 * U, V in cells from the panel's first corner; A a cell's opening between walls, blurred; S = 1 + Σ s_m·cos·cos + Σ o·sin the
 * profile that all cells share, about even about their middles x = y = 0; w_A, w_B what the exposure leaves of either class's
 * wave; O what is beyond a side. */
#include <math.h>
#include <string.h>

#include "panel.h"
#include "simd.h"

#define ROOT_HALF 0.7071067811865476
#define TURN 6.283185307179586
/* Of full light: what noise in the dark and read-out weighs, and the texture of what is beside the panel. */
#define DARK_NOISE 0.1
#define TEXTURE 1.0
#define NO_LIGHT 1e-3

static double density(double z) { return 0.3989422804014327 * exp(-0.5 * z * z); }

static void put_cell(Line *line, int k, double at, ptrdiff_t cells, double sigma, double gap, const double rim[2]) {
    const ptrdiff_t cell = line->cell[k];
    const bool first = cell == 0, last = cell == cells - 1;
    const double before = (at - (double)cell - (first ? rim[0] : 0.5 * gap)) / sigma;
    const double after = (at - (double)(cell + 1) + (last ? rim[1] : 0.5 * gap)) / sigma;
    const double up = density(before), down = density(after), off = at - (double)cell - 0.5;
    line->light[k] = 0.5 * (erf(before * ROOT_HALF) - erf(after * ROOT_HALF));
    line->slope[k] = (up - down) / sigma;
    line->blurred[k] = after * down - before * up;
    line->gapped[k] = -0.5 * ((first ? 0.0 : up) + (last ? 0.0 : down)) / sigma;
    if (first) line->rimmed[0] = -up / sigma;
    if (last) line->rimmed[1] = -down / sigma;
    const double inside = fmin(fmax(off, -0.5), 0.5);
    line->odd[k] = sin(TURN * inside);
    line->odd_steep[k] = inside == off ? TURN * cos(TURN * inside) : 0.0;
    line->harmonic[k][0] = 1.0;
    for (int n = 1; n <= HARMONICS; n++) {
        line->harmonic[k][n] = cos(TURN * n * inside);
        line->steep[k][n] = inside == off ? -TURN * n * sin(TURN * n * inside) : 0.0;
    }
}

Line ledpi_panel_line(double at, ptrdiff_t cells, double sigma, double gap, const double rim[2]) {
    Line line;
    memset(&line, 0, sizeof line);
    const double within = fmin(fmax(floor(at), 0.0), (double)(cells - 1));
    line.cell[0] = (ptrdiff_t)within;
    line.cell[1] = line.cell[0] + (at - within > 0.5 ? 1 : -1);
    for (int k = 0; k < 2; k++) {
        const double beyond = ((k ? at - (double)cells : -at) + rim[k]) / sigma;
        line.beside[k] = 0.5 * (1.0 + erf(beyond * ROOT_HALF));
        line.falls[k] = (k ? 1.0 : -1.0) * density(beyond) / sigma;
        line.spread[k] = -density(beyond) * beyond;
        if (line.cell[k] < 0 || line.cell[k] >= cells)
            line.cell[k] = -1;
        else
            put_cell(&line, k, at, cells, sigma, gap, rim);
    }
    return line;
}

Profile ledpi_panel_profile(const double *unknown, const Line *down) {
    Profile profile;
    for (int j = 0; j < 2; j++)
        for (int x = 0; x <= HARMONICS; x++) {
            profile.by[j][x] = x ? 0.0 : 1.0, profile.steep[j][x] = 0.0;
            for (int y = x ? 0 : 1; y <= HARMONICS; y++) {
                const double much = unknown[SHAPE - 1 + y * (HARMONICS + 1) + x];
                profile.by[j][x] += much * down->harmonic[j][y];
                profile.steep[j][x] += much * down->steep[j][y];
            }
        }
    return profile;
}

static LEDPI_INLINE double light_at(const View *view, double x, double y) {
    float right, down;
    const ptrdiff_t column = ledpi_interpolation_pixel((float)x, view->columns, &right), row = ledpi_interpolation_pixel((float)y, view->rows, &down);
    const float *above = view->light + row * view->columns + column, *below = above + view->columns;
    const float upper = above[0] + right * (above[1] - above[0]), lower = below[0] + right * (below[1] - below[0]);
    return upper + down * (lower - upper);
}

double ledpi_wave_at(const float *table, double cycles, double *slope) {
    double turn = cycles - (double)(ptrdiff_t)cycles; /* what is cut off may be negative */
    if (turn < 0.0) turn += 1.0;
    const double at = turn * WAVE_STEPS;
    ptrdiff_t step = (ptrdiff_t)at;
    step = step < WAVE_STEPS ? step : WAVE_STEPS - 1;
    const double here = table[step], next = table[step + 1 < WAVE_STEPS ? step + 1 : 0];
    *slope = (next - here) * WAVE_STEPS;
    return here + (at - (double)step) * (next - here);
}

typedef struct {
    double by[COMMON], slope[2], predicted, wave[2], later[2];
} Terms;

/* Adds the light of the cell where the i-th of a line's cells across meets the j-th of one's down. */
static LEDPI_INLINE void add_cell(const double *unknown, const Profile *profile, const double *own, ptrdiff_t cells, const Line *across, int i, const Line *down,
                     int j, Terms *t, float by_own[OWN]) {
    const double right = across->light[i], below = down->light[j], both = right * below;
    const double lit = own[0] + own[1] * t->wave[0] + own[2] * t->wave[1];
    double shape = 0.0, tilt[2] = {0.0, 0.0};
    for (int x = 0; x <= HARMONICS; x++) {
        shape += profile->by[j][x] * across->harmonic[i][x];
        tilt[0] += profile->by[j][x] * across->steep[i][x];
        tilt[1] += profile->steep[j][x] * across->harmonic[i][x];
    }
    for (int y = 0; y <= HARMONICS; y++)
        for (int x = y ? 0 : 1; x <= HARMONICS; x++)
            t->by[SHAPE - 1 + y * (HARMONICS + 1) + x] += lit * both * across->harmonic[i][x] * down->harmonic[j][y];
    shape += unknown[ASIDE] * across->odd[i] + unknown[ASIDE + 1] * down->odd[j];
    tilt[0] += unknown[ASIDE] * across->odd_steep[i];
    tilt[1] += unknown[ASIDE + 1] * down->odd_steep[j];
    t->by[ASIDE] += lit * both * across->odd[i];
    t->by[ASIDE + 1] += lit * both * down->odd[j];
    const double lit_shape = lit * shape;
    t->predicted += lit_shape * both;
    t->slope[0] += lit * (across->slope[i] * below * shape + both * tilt[0]);
    t->slope[1] += lit * (right * down->slope[j] * shape + both * tilt[1]);
    t->by[BLUR] += lit_shape * (across->blurred[i] * below + right * down->blurred[j]);
    t->by[GAP] += lit_shape * (across->gapped[i] * below + right * down->gapped[j]);
    for (int k = 0; k < 2; k++) {
        const ptrdiff_t end = k ? cells - 1 : 0;
        if (across->cell[i] == end) t->by[RIM + k] += lit_shape * below * across->rimmed[k];
        if (down->cell[j] == end) t->by[RIM + 2 + k] += lit_shape * right * down->rimmed[k];
        t->by[PHASE + k] += own[1 + k] * both * shape * t->later[k];
        by_own[1 + k] = (float)(both * shape * t->wave[k]);
    }
    by_own[0] = (float)(both * shape);
}

/* Adds the light beside the panel: left, right, above, below; at a corner only what is left or right. Returns how much of
 * the place is there. */
static LEDPI_INLINE double add_beside(const double *unknown, const Line *across, const Line *down, Terms *t) {
    if (across->beside[0] + across->beside[1] + down->beside[0] + down->beside[1] < NO_LIGHT) return 0.0;
    const double *level = unknown + BESIDE, open = 1.0 - across->beside[0] - across->beside[1];
    const double hidden = level[2] * down->beside[0] + level[3] * down->beside[1];
    double outside = 0.0;
    for (int k = 0; k < 2; k++) {
        const double side = across->beside[k], end = down->beside[k] * open;
        t->by[BESIDE + k] += side, t->by[BESIDE + 2 + k] += end;
        t->predicted += level[k] * side + level[2 + k] * end;
        t->by[RIM + k] += (level[k] - hidden) * fabs(across->falls[k]);
        t->by[RIM + 2 + k] += level[2 + k] * fabs(down->falls[k]) * open;
        t->slope[0] += (level[k] - hidden) * across->falls[k];
        t->slope[1] += level[2 + k] * down->falls[k] * open;
        t->by[BLUR] += (level[k] - hidden) * across->spread[k] + level[2 + k] * down->spread[k] * open;
        outside += side + end;
    }
    return outside;
}

/* To first order a homography can differ by 1, p, q in either direction, and by (p², pq) and (pq, q²); p, q in −1..1. */
static LEDPI_INLINE void put_ways(double u, double v, ptrdiff_t cells, Terms *t) {
    const double p = 2.0 * u - 1.0, q = 2.0 * v - 1.0, half = 0.5 * (double)cells;
    const double across = half * t->slope[0], down = half * t->slope[1], both = p * across + q * down;
    const double ways[WAYS] = {across, p * across, q * across, down, p * down, q * down, p * both, q * both};
    memcpy(t->by, ways, sizeof ways);
}

LEDPI_SIMD bool ledpi_panel_sample(const Panel *panel, const View *view, const double *h, const double *unknown, const Line *across,
                        const Line *down, const Profile *profile, double u, double v, float *columns, Sample *s) {
    const double w = 1.0 / (h[6] * u + h[7] * v + h[8]);
    double at[2] = {(h[0] * u + h[1] * v + h[2]) * w, (h[3] * u + h[4] * v + h[5]) * w};
    if (view->lens) ledpi_distort(view->lens, at[0], at[1], at);
    const double x = (at[0] - view->first_x) / view->shrink, y = (at[1] - view->first_y) / view->shrink;
    if (!(x >= 0.0 && y >= 0.0 && x <= (double)(view->columns - 1) && y <= (double)(view->rows - 1))) return false;
    const double seen = light_at(view, x, y);
    if (!(seen < view->saturated)) return false;
    Terms t;
    memset(&t, 0, sizeof t);
    t.predicted = unknown[DARK];
    for (int k = 0; k < 2; k++)
        t.wave[k] = ledpi_wave_at(panel->waves + k * WAVE_STEPS, unknown[PHASE + k] + at[1] * panel->cycles_a_row[k], t.later + k);
    s->met = 0;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            if (across->cell[i] < 0 || down->cell[j] < 0 || across->light[i] * down->light[j] < NO_LIGHT) continue;
            const ptrdiff_t cell = down->cell[j] * panel->cells + across->cell[i];
            add_cell(unknown, profile, unknown + COMMON + OWN * cell, panel->cells, across, i, down, j, &t, s->by[s->met]);
            s->cell[s->met++] = cell;
        }
    const double outside = add_beside(unknown, across, down, &t);
    put_ways(u, v, panel->cells, &t);
    t.by[DARK] = 1.0;
    s->seen = (seen - panel->dark) * panel->scale, s->predicted = t.predicted, s->row = at[1];
    s->weight = 1.0 / sqrt(fmax(t.predicted, 0.0) + DARK_NOISE + TEXTURE * outside);
    for (int k = 0; k < COMMON; k++) columns[k] = (float)(s->weight * t.by[k]);
    columns[RESIDUAL] = (float)(s->weight * (s->seen - s->predicted));
    for (int k = RESIDUAL + 1; k < DENSE; k++) columns[k] = 0.0f;
    return true;
}
