/* Light that a panel sends to a place of the picture, and how it changes with every unknown: the one equation.
 *
 *   light(U, V) = dark + Σ_c A_c(U)·A_c(V)·S(x, y)·(gain_c + a_c·w_A(row) + b_c·w_B(row)) + Σ_side level·O_side
 *
 * U, V in cells from the panel's first corner; A a cell's opening between walls, blurred; S = 1 + Σ s_m·cos·cos + Σ o·sin the
 * profile that all cells share, about even about their middles x = y = 0; lines of sight are `depth` aside when they end; w_A, w_B what the exposure leaves of either class's
 * wave; O what is beyond a side. */
#include <math.h>
#include <string.h>

#include "panel.h"
#include "simd.h"

#define ROOT_HALF 0.7071067811865476
#define FAR 4.0 /* deviations beyond an edge, where a thirtieth of NO_LIGHT is left */
#define TURN 6.283185307179586
/* Shares of full light: what noise in the dark and read-out weighs, and the texture of what is beside the panel. */
#define DARK_NOISE 0.1f
#define TEXTURE 1.0f

static double density(double z) { return 0.3989422804014327 * exp(-0.5 * z * z); }

/* One end of a cell's opening: how far a place is beyond the wall's front and beyond its face, over the blur. */
typedef struct {
    double front, face;
} Edge;

static double opened(Edge e, double glow) { return glow * erf(e.front * ROOT_HALF) + (1.0 - glow) * erf(e.face * ROOT_HALF); }
static double steepness(Edge e, double glow) { return glow * density(e.front) + (1.0 - glow) * density(e.face); }
static double spreading(Edge e, double glow) { return glow * e.front * density(e.front) + (1.0 - glow) * e.face * density(e.face); }

static void put_cell(Line *line, int k, double at, ptrdiff_t cells, Blur blur, const Walls *walls) {
    const int32_t cell = line->cell[k];
    const bool first = cell == 0, last = cell == cells - 1;
    const double shift = walls->depth * walls->sight, glow = walls->glow, sigma = blur.sigma;
    const double from = at - (double)cell - (first ? walls->rim[0] : 0.5 * walls->gap);
    const double to = at - (double)(cell + 1) + (last ? walls->rim[1] : 0.5 * walls->gap);
    const Edge before = {from / sigma, (from + fmin(shift, 0.0)) / sigma}, after = {to / sigma, (to + fmax(shift, 0.0)) / sigma};
    if (before.front < -FAR || after.front > FAR) return;
    const double up = steepness(before, glow), down = steepness(after, glow), off = at + shift - (double)cell - 0.5;
    const double inside = fmin(fmax(off, -0.5), 0.5), steep = inside == off ? TURN : 0.0;
    const double sine = sin(TURN * inside), cosine = cos(TURN * inside);
    line->light[k] = (float)(0.5 * (opened(before, glow) - opened(after, glow)));
    line->slope[k] = (float)((up - down) / sigma);
    line->blurred[k] = (float)(spreading(after, glow) - spreading(before, glow));
    line->gapped[k] = (float)(-0.5 * ((first ? 0.0 : up) + (last ? 0.0 : down)) / sigma);
    line->shifted[k] = (float)((1.0 - glow) / sigma * (walls->sight < 0.0 ? density(before.face) : -density(after.face)));
    line->glowing[k] = (float)(0.5 * (opened(before, 1.0) - opened(before, 0.0) - opened(after, 1.0) + opened(after, 0.0)));
    if (first) line->rimmed[k][0] = (float)(-up / sigma);
    if (last) line->rimmed[k][1] = (float)(-down / sigma);
    line->odd[k] = (float)sine, line->odd_steep[k] = (float)(steep * cosine);
    double many[2] = {1.0, 0.0}; /* cosine and sine of n turns */
    for (int n = 0; n <= HARMONICS; n++) {
        line->harmonic[k][n] = (float)many[0];
        line->steep[k][n] = (float)(-n * steep * many[1]);
        const double next = many[0] * cosine - many[1] * sine;
        many[1] = many[1] * cosine + many[0] * sine, many[0] = next;
    }
}

Line ledpi_panel_line(double at, ptrdiff_t cells, Blur blur, const Walls *walls) {
    Line line;
    memset(&line, 0, sizeof line);
    line.by_smear = (float)blur.by_smear;
    const double within = fmin(fmax(floor(at), 0.0), (double)(cells - 1));
    line.cell[0] = (int32_t)within;
    line.cell[1] = line.cell[0] + (at - within > 0.5 ? 1 : -1);
    for (int k = 0; k < 2; k++) {
        const double beyond = ((k ? at - (double)cells : -at) + walls->rim[k]) / blur.sigma;
        if (beyond > -FAR) {
            line.beside[k] = (float)(0.5 * (1.0 + erf(beyond * ROOT_HALF)));
            line.falls[k] = (float)((k ? 1.0 : -1.0) * density(beyond) / blur.sigma);
            line.spread[k] = (float)(-density(beyond) * beyond);
        }
        if (line.cell[k] < 0 || line.cell[k] >= cells)
            line.cell[k] = -1;
        else
            put_cell(&line, k, at, cells, blur, walls);
    }
    return line;
}

void ledpi_panel_lines(const Line *lines, const double *along, ptrdiff_t count, ptrdiff_t cells, Lines *out) {
    out->is_between = out->is_beside = false;
    for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
        const ptrdiff_t i = lane < count ? lane : count - 1;
        for (size_t k = 0; k < offsetof(Line, cell) / sizeof(float); k++)
            ((float *)out)[LEDPI_WIDTH * k + (size_t)lane] = ((const float *)(lines + i))[k];
        for (int k = 0; k < 2; k++) out->cell[k][lane] = lines[i].cell[k];
        out->at[lane] = (float)(along[i] / (double)cells);
        out->is_between |= lines[i].light[1] > NO_LIGHT;
        out->is_beside |= lines[i].beside[0] + lines[i].beside[1] > NO_LIGHT;
    }
}

Profile ledpi_panel_profile(const float *unknown, const Line *down) {
    Profile profile;
    memset(&profile, 0, sizeof profile);
    for (int j = 0; j < 2; j++) {
        profile.by[j][0] = 1.0f;
        for (int n = 0; n < SHAPES; n++) {
            const int x = LEDPI_SHAPE[n][0], y = LEDPI_SHAPE[n][1];
            profile.by[j][x] += unknown[SHAPE + n] * down->harmonic[j][y];
            profile.steep[j][x] += unknown[SHAPE + n] * down->steep[j][y];
        }
    }
    return profile;
}

/* Eight places: waves there and their slopes, what is predicted, and its slopes by place across and down. */
typedef struct {
    Floats wave[2], later[2], slope[2];
} Terms;

/* The pixels of eight rays, as lens.c has them; far out of view what has none. */
static LEDPI_INLINE void put_bent(const Lens *l, Floats *x, Floats *y) {
    const float p1 = (float)l->p1, p2 = (float)l->p2;
    const Floats r2 = *x * *x + *y * *y, xy = *x * *y;
    Floats length = 1.0f + r2 * ((float)l->k1 + r2 * ((float)l->k2 + r2 * (float)l->k3));
    if (l->equidistant != 0.0)
        for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
            const float r = sqrtf(r2[lane]) + 1e-9f, t = atanf(r), t2 = t * t;
            length[lane] = t * (1.0f + t2 * ((float)l->k1 + t2 * ((float)l->k2 + t2 * ((float)l->k3 + t2 * (float)l->k4)))) / r;
        }
    else
        length /= 1.0f + r2 * ((float)l->k4 + r2 * ((float)l->k5 + r2 * (float)l->k6));
    const Floats right = *x * length + 2.0f * p1 * xy + p2 * (r2 + 2.0f * *x * *x) + r2 * ((float)l->s1 + (float)l->s2 * r2);
    const Floats down = *y * length + p1 * (r2 + 2.0f * *y * *y) + 2.0f * p2 * xy + r2 * ((float)l->s3 + (float)l->s4 * r2);
    *x = (float)l->fx * right + (float)l->cx, *y = (float)l->fy * down + (float)l->cy;
    for (int lane = 0; lane < LEDPI_WIDTH; lane++)
        if (r2[lane] > (float)l->most_r2) (*x)[lane] = -INFINITY;
}

/* Projects the eight places: the view's pixels; the picture's row. */
static LEDPI_INLINE void put_places(const View *view, const float *h, Floats u, float v, Floats *x, Floats *y, Floats *row) {
    const Floats w = 1.0f / (h[6] * u + (h[7] * v + h[8]));
    *x = (h[0] * u + (h[1] * v + h[2])) * w, *y = (h[3] * u + (h[4] * v + h[5])) * w;
    if (view->lens) put_bent(view->lens, x, y);
    const float size = (float)(1.0 / view->shrink);
    *row = *y;
    *x = (*x - (float)view->first_x) * size, *y = (*y - (float)view->first_y) * size;
}

/* Weights of four pixels in a row by Catmull and Rom's cubic, `at` from the second to the third. It follows what a lens
 * shows of a wall where straight lines are off by more than bands are deep, and blurs it alike between pixels. */
static LEDPI_INLINE void put_taps(float at, float tap[4]) {
    tap[0] = ((-0.5f * at + 1.0f) * at - 0.5f) * at, tap[1] = (1.5f * at - 2.5f) * at * at + 1.0f;
    tap[2] = ((-1.5f * at + 2.0f) * at + 0.5f) * at, tap[3] = (0.5f * at - 0.5f) * at * at;
}

/* The light at (x, y) by cubics, and the most of any pixel that it is made of; at the view's end its last pixel goes on. */
static LEDPI_INLINE float cubic_light(const View *view, float x, float y, float *most) {
    float right, down, across[4], below[4], light = 0.0f;
    ptrdiff_t columns[4], first = ledpi_interpolation_pixel(x, view->columns, &right);
    const ptrdiff_t row = ledpi_interpolation_pixel(y, view->rows, &down);
    put_taps(right, across), put_taps(down, below);
    columns[0] = first > 0 ? first - 1 : 0, columns[1] = first, columns[2] = first + 1;
    columns[3] = first + 2 < view->columns ? first + 2 : first + 1;
    *most = 0.0f;
    for (ptrdiff_t j = 0; j < 4; j++) {
        const ptrdiff_t at = row + j - 1, within = at < 0 ? 0 : at < view->rows ? at : view->rows - 1;
        const float *const line = view->light + within * view->columns;
        float sum = 0.0f;
        for (int i = 0; i < 4; i++) sum += across[i] * line[columns[i]], *most = line[columns[i]] > *most ? line[columns[i]] : *most;
        light += below[j] * sum;
    }
    return light;
}

/* The same by straight lines, of four pixels instead of sixteen. */
static LEDPI_INLINE float linear_light(const View *view, float x, float y, float *most) {
    float right, down;
    const ptrdiff_t column = ledpi_interpolation_pixel(x, view->columns, &right);
    const float *above = view->light + ledpi_interpolation_pixel(y, view->rows, &down) * view->columns + column;
    const float *below = above + view->columns;
    const float upper = above[0] + right * (above[1] - above[0]), lower = below[0] + right * (below[1] - below[0]);
    return *most = upper + down * (lower - upper);
}

static LEDPI_INLINE void put_seen(const Panel *panel, const View *view, Floats x, Floats y, Samples *s) {
    for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
        float most;
        const float seen = view->cubic ? cubic_light(view, x[lane], y[lane], &most) : linear_light(view, x[lane], y[lane], &most);
        s->valid[lane] = x[lane] >= 0.0f && y[lane] >= 0.0f && x[lane] <= (float)(view->columns - 1) &&
                         y[lane] <= (float)(view->rows - 1) && most < (float)view->saturated;
        s->seen[lane] = (seen - (float)panel->dark) * (float)panel->scale;
        s->row[lane] = s->valid[lane] ? s->row[lane] : 0.0f; /* it may be no number */
    }
}

static LEDPI_INLINE void put_waves(const Panel *panel, const float *unknown, Floats row, Terms *t) {
    for (int k = 0; k < 2; k++)
        for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
            float later;
            t->wave[k][lane] = ledpi_panel_wave(panel, k, unknown[PHASE + k], row[lane], &later);
            t->later[k][lane] = later;
        }
}

/* Adds the light of the cells that are the i-th of the lines across and the j-th of the one down. */
static LEDPI_INLINE void add_cells(const Panel *panel, const float *unknown, const Profile *profile, const Lines *across, int i,
                                   const Line *down, int j, Terms *t, Samples *s) {
    Floats own[OWN];
    for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
        const int32_t column = across->cell[i][lane];
        const float *of = unknown + COMMON + OWN * (down->cell[j] * panel->cells + (column < 0 ? 0 : column));
        for (int k = 0; k < OWN; k++) ((float *)(own + k))[lane] = of[k];
    }
    const float below = down->light[j], *by = profile->by[j], *steep = profile->steep[j];
    const Floats right = across->light[i], both = right * below, *harmonic = across->harmonic[i];
    const Floats lit = own[0] + own[1] * t->wave[0] + own[2] * t->wave[1], part = lit * both;
    Floats shape = unknown[ASIDE] * across->odd[i] + unknown[ASIDE + 1] * down->odd[j];
    Floats tilt[2] = {unknown[ASIDE] * across->odd_steep[i], {0}};
    tilt[1] += unknown[ASIDE + 1] * down->odd_steep[j];
    for (int x = 0; x <= HARMONICS; x++) {
        shape += by[x] * harmonic[x];
        tilt[0] += by[x] * across->steep[i][x];
        tilt[1] += steep[x] * harmonic[x];
    }
    for (int n = 0; n < SHAPES; n++)
        s->by[SHAPE + n] += part * harmonic[LEDPI_SHAPE[n][0]] * down->harmonic[j][LEDPI_SHAPE[n][1]];
    s->by[ASIDE] += part * across->odd[i];
    s->by[ASIDE + 1] += part * down->odd[j];
    const Floats shown = both * shape, lit_shape = lit * shape, lit_below = lit_shape * below, lit_right = lit_shape * right;
    s->predicted += lit * shown;
    s->by[DEPTH] += (float)panel->sight[0] * (across->shifted[i] * lit_below + part * tilt[0]);
    s->by[DEPTH] += (float)panel->sight[1] * (down->shifted[j] * lit_right + part * tilt[1]);
    s->by[GLOW] += across->glowing[i] * lit_below + down->glowing[j] * lit_right;
    t->slope[0] += across->slope[i] * lit_below + part * tilt[0];
    t->slope[1] += down->slope[j] * lit_right + part * tilt[1];
    s->by[BLUR] += across->blurred[i] * lit_below + down->blurred[j] * lit_right;
    s->by[SMEAR] += across->by_smear * across->blurred[i] * lit_below + down->by_smear * down->blurred[j] * lit_right;
    s->by[GAP] += across->gapped[i] * lit_below + down->gapped[j] * lit_right;
    for (int k = 0; k < 2; k++) {
        s->by[RIM + k] += across->rimmed[i][k] * lit_below;
        s->by[RIM + 2 + k] += down->rimmed[j][k] * lit_right;
        s->by[PHASE + k] += own[1 + k] * shown * t->later[k];
        s->own[j][i][1 + k] = shown * t->wave[k];
    }
    s->own[j][i][0] = shown;
}

/* Adds the light beside the panel: left, right, above, below; at a corner only what is left or right. `outside`: how much of
 * the places is there. */
static LEDPI_INLINE void add_beside(const float *unknown, const Lines *across, const Line *down, Terms *t, Samples *s) {
    const float *level = unknown + BESIDE, hidden = level[2] * down->beside[0] + level[3] * down->beside[1];
    const Floats open = 1.0f - across->beside[0] - across->beside[1];
    for (int k = 0; k < 2; k++) {
        const Floats side = across->beside[k], end = down->beside[k] * open, fall = (level[k] - hidden) * across->falls[k];
        const Floats fall_down = level[2 + k] * down->falls[k] * open;
        s->by[BESIDE + k] += side, s->by[BESIDE + 2 + k] += end;
        s->predicted += level[k] * side + level[2 + k] * end;
        s->by[RIM + k] += k ? fall : -fall;
        s->by[RIM + 2 + k] += k ? fall_down : -fall_down;
        t->slope[0] += fall;
        t->slope[1] += fall_down;
        s->by[BLUR] += (level[k] - hidden) * across->spread[k] + level[2 + k] * down->spread[k] * open;
        s->by[SMEAR] += across->by_smear * (level[k] - hidden) * across->spread[k] + down->by_smear * level[2 + k] * down->spread[k] * open;
        s->outside += side + end;
    }
}

/* To first order a homography can differ by 1, p, q in either direction, and by (p², pq) and (pq, q²); p, q in −1..1. */
static LEDPI_INLINE void put_ways(Floats u, float v, ptrdiff_t cells, const Terms *t, Floats *by) {
    const float q = 2.0f * v - 1.0f, half = 0.5f * (float)cells;
    const Floats p = 2.0f * u - 1.0f, across = half * t->slope[0], down = half * t->slope[1], both = p * across + q * down;
    by[0] = across, by[1] = p * across, by[2] = q * across, by[3] = down, by[4] = p * down, by[5] = q * down;
    by[6] = p * both, by[7] = q * both;
}

LEDPI_SIMD void ledpi_panel_look(const Panel *panel, const View *view, const float *h, const float *u, float v, Samples *s) {
    Floats x, y;
    put_places(view, h, *(const Floats *)u, v, &x, &y, &s->row);
    put_seen(panel, view, x, y, s);
}

/* One over the deviation of what is not explained. */
static LEDPI_INLINE void put_weights(const float *predicted, const float *outside, float *weight) {
    for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
        const float light = predicted[lane] > 0.0f ? predicted[lane] : 0.0f;
        weight[lane] = 1.0f / sqrtf(light + DARK_NOISE + TEXTURE * outside[lane]);
    }
}

LEDPI_SIMD void ledpi_panel_sample(const Panel *panel, const View *view, const float *h, const float *unknown,
                                   const Profile *profile, const Lines *across, const Line *down, float v, Samples *s) {
    const Floats none = {0};
    Floats x, y;
    Terms t = {.slope = {none, none}};
    for (int k = WAYS; k < DENSE; k++) s->by[k] = none;
    put_places(view, h, across->at, v, &x, &y, &s->row);
    put_seen(panel, view, x, y, s);
    put_waves(panel, unknown, s->row, &t);
    s->predicted = none + unknown[DARK];
    s->outside = none;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++)
            if (down->light[j] > NO_LIGHT && (i == 0 || across->is_between))
                add_cells(panel, unknown, profile, across, i, down, j, &t, s);
            else
                for (int k = 0; k < OWN; k++) s->own[j][i][k] = none;
    if (across->is_beside || down->beside[0] + down->beside[1] > NO_LIGHT) add_beside(unknown, across, down, &t, s);
    put_ways(across->at, v, panel->cells, &t, s->by);
    s->by[DARK] = none + 1.0f;
    put_weights((const float *)&s->predicted, (const float *)&s->outside, (float *)&s->weight);
    s->by[RESIDUAL] = s->seen - s->predicted;
    for (int k = 0; k <= RESIDUAL; k++) s->by[k] *= s->weight;
}
