/* A panel's corners by its inner lines alone: `told` of decode/corners/inner_square.py. */
#include <math.h>

#include "lattice.h"

enum { SHIFTS = 11, PLACES = 6, ROUGH_ROUNDS = 2, ROUNDS = 5 };
#define FIRST_SHIFT (-0.25) /* of a pitch */
#define SHIFT_STEP 0.05
#define DIP 0.97
#define FIRST_PLACE 0.15
#define LAST_PLACE 0.85
#define NEAR_PX 0.05
#define MOST_SHARE 0.1
#define LEAST_SHOWN 0.75
#define MAX_AWAY 0.06
#define MAX_SIGMA_PX 0.25
#define BUILT_PX 0.05 /* these as in adjust.c */
#define FARTHEST 4.0
#define HUBER 2.0
#define LEAST_VARIANCE 0.2

/* A round's lines: what is seen of each, how it depends on the homography's small changes, and what explains it. */
typedef struct {
    Homography homography;
    ptrdiff_t cells, inner;
    double slopes[MOST_INNER][MOVES], scale[MOST_INNER], seen[MOST_INNER], weights[MOST_INNER], left[MOST_INNER];
    double moves[MOVES], lower[MOVES][MOVES]; /* and its information's factor */
    double sigma_px, away_px;
} Lines;

static void begin(Lines *lines, const Point corners[4], ptrdiff_t cells) {
    ledpi_unit_square_to(corners, lines->homography.h);
    lines->cells = cells, lines->inner = 2 * cells * (cells - 1);
    for (ptrdiff_t i = 0; i < lines->inner; i++) {
        double u, v;
        ledpi_line_place(i, cells, &u, &v);
        lines->scale[i] = ledpi_measure_at(&lines->homography, u, v, i < lines->inner / 2, lines->slopes[i]);
    }
}

/* Where light is darkest across a line's place, in steps from it; whether it is brighter on both sides: beside a dead cell it
 * is not. */
static int darkest(const Picture *picture, const Lines *lines, ptrdiff_t i, bool *is_dip) {
    double u, v, along[PLACES], least = HUGE_VAL, ends[2] = {0.0, 0.0};
    float xs[SHIFTS][PLACES], ys[SHIFTS][PLACES], seen[SHIFTS][PLACES];
    const bool along_u = i < lines->inner / 2;
    int darkest_at = 0;
    ledpi_line_place(i, lines->cells, &u, &v);
    for (int p = 0; p < PLACES; p++)
        along[p] = (FIRST_PLACE + (LAST_PLACE - FIRST_PLACE) * p / (PLACES - 1) - 0.5) / (double)lines->cells;
    for (int s = 0; s < SHIFTS; s++) {
        const double across = (FIRST_SHIFT + SHIFT_STEP * s) / (double)lines->cells;
        Point at, by_u, by_v;
        for (int p = 0; p < PLACES; p++) {
            ledpi_seen(&lines->homography, u + (along_u ? across : along[p]), v + (along_u ? along[p] : across), &at, &by_u,
                       &by_v);
            xs[s][p] = (float)at.x, ys[s][p] = (float)at.y;
        }
    }
    ledpi_light_at_all(picture, xs[0], ys[0], SHIFTS * PLACES, seen[0]);
    for (int s = 0; s < SHIFTS; s++) {
        double light = 0.0;
        for (int p = 0; p < PLACES; p++) light += seen[s][p];
        if (light < least) least = light, darkest_at = s;
        if (s % (SHIFTS - 1) == 0) ends[s > 0] = light;
    }
    *is_dip = least < DIP * fmin(ends[0], ends[1]);
    return darkest_at - SHIFTS / 2;
}

static void solve(Lines *lines) {
    double pull[MOVES] = {0.0};
    for (int a = 0; a < MOVES; a++)
        for (int b = 0; b <= a; b++) lines->lower[a][b] = 0.0;
    for (ptrdiff_t i = 0; i < lines->inner; i++)
        for (int a = 0; a < MOVES; a++) {
            const double weighted = lines->weights[i] * lines->slopes[i][a];
            pull[a] += weighted * lines->seen[i];
            for (int b = 0; b <= a; b++) lines->lower[a][b] += weighted * lines->slopes[i][b];
        }
    ledpi_factor(&lines->lower[0][0], MOVES);
    ledpi_forward(&lines->lower[0][0], MOVES, pull);
    ledpi_backward(&lines->lower[0][0], MOVES, pull);
    for (int a = 0; a < MOVES; a++) lines->moves[a] = pull[a];
    for (ptrdiff_t i = 0; i < lines->inner; i++) {
        lines->left[i] = lines->seen[i];
        for (int a = 0; a < MOVES; a++) lines->left[i] -= lines->slopes[i][a] * pull[a];
    }
}

/* The corners' step that explains best what is seen. False where too little is `shown`. */
static bool explain(Lines *lines, ptrdiff_t shown, Point step[4]) {
    if ((double)shown < LEAST_SHOWN * (double)lines->inner) return false;
    double total = 0.0, squares = 0.0, weights = 0.0, variance = 0.0;
    solve(lines);
    for (ptrdiff_t i = 0; i < lines->inner; i++)
        total += fmin(lines->left[i] * lines->left[i] * lines->weights[i], FARTHEST * FARTHEST);
    const double ratio = fmax(total / (shown > MOVES ? (double)(shown - MOVES) : 1.0), LEAST_VARIANCE);
    for (ptrdiff_t i = 0; i < lines->inner; i++) {
        lines->weights[i] /= ratio;
        lines->weights[i] *= fmin(1.0, HUBER / fmax(fabs(lines->left[i]) * sqrt(lines->weights[i]), HUBER));
    }
    solve(lines);
    for (ptrdiff_t i = 0; i < lines->inner; i++) {
        squares += lines->weights[i] * lines->left[i] * lines->left[i];
        weights += lines->weights[i];
    }
    for (int c = 0; c < 4; c++) {
        double u = c == 1 || c == 2, v = c >= 2, along_u[MOVES], along_v[MOVES], by_x[MOVES], by_y[MOVES];
        Point at, by_u, by_v;
        ledpi_seen(&lines->homography, u, v, &at, &by_u, &by_v);
        ledpi_moves_at(u, v, along_u, along_v);
        step[c] = (Point){0.0, 0.0};
        for (int m = 0; m < MOVES; m++) {
            by_x[m] = by_u.x * along_u[m] + by_v.x * along_v[m], by_y[m] = by_u.y * along_u[m] + by_v.y * along_v[m];
            step[c].x += by_x[m] * lines->moves[m], step[c].y += by_y[m] * lines->moves[m];
        }
        ledpi_forward(&lines->lower[0][0], MOVES, by_x);
        ledpi_forward(&lines->lower[0][0], MOVES, by_y);
        for (int m = 0; m < MOVES; m++) variance += (by_x[m] * by_x[m] + by_y[m] * by_y[m]) / 8;
    }
    lines->sigma_px = sqrt(variance), lines->away_px = sqrt(squares / weights);
    return true;
}

static bool roughly(const Picture *picture, Lines *lines, Point step[4]) {
    ptrdiff_t shown = lines->inner;
    for (ptrdiff_t i = 0; i < lines->inner; i++) {
        const double step_px = SHIFT_STEP * lines->scale[i] / (double)lines->cells;
        bool is_shown;
        lines->seen[i] = darkest(picture, lines, i, &is_shown) * step_px;
        shown -= !is_shown;
        if ((double)shown < LEAST_SHOWN * (double)lines->inner) return false; /* as most are where there is no panel */
        lines->weights[i] = is_shown ? 1.0 / (step_px * step_px) : 0.0;
    }
    return explain(lines, shown, step);
}

static bool exactly(const Picture *picture, const Lens *lens, const Point corners[4], Lines *lines, Point step[4]) {
    double pitch[2] = {0.0, 0.0}, variance[MOST_INNER];
    Point moves[MOST_INNER];
    ptrdiff_t shown = 0;
    for (ptrdiff_t i = 0; i < lines->inner; i++)
        pitch[i >= lines->inner / 2] += lines->scale[i] / (double)(lines->inner / 2 * lines->cells);
    ledpi_lens_moves(lens, &lines->homography, corners, lines->cells, moves);
    ledpi_inner_lines(picture, &lines->homography, pitch, moves, lines->cells, lines->seen, variance);
    for (ptrdiff_t i = 0; i < lines->inner; i++) {
        const bool is_shown = variance[i] < NOT_SEEN_PX2;
        shown += is_shown;
        lines->weights[i] = is_shown ? 1.0 / (variance[i] + BUILT_PX * BUILT_PX) : 0.0;
    }
    return explain(lines, shown, step);
}

/* Whether enough lines are darkest where they should be, to a step. */
static bool are_darkest(const Picture *picture, const Lines *lines) {
    ptrdiff_t there = lines->inner;
    for (ptrdiff_t i = 0; i < lines->inner && (double)there >= LEAST_SHOWN * (double)lines->inner; i++) {
        bool is_dip;
        const int away = darkest(picture, lines, i, &is_dip);
        there -= !(is_dip && away >= -1 && away <= 1);
    }
    return (double)there >= LEAST_SHOWN * (double)lines->inner;
}

/* Puts `corners` (4, 2), which are near those of a grid, where it is; returns their deviation, or what is no number. */
double ledpi_inner_square(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                          const Lens *lens, ptrdiff_t cells, Point *corners) {
    const Picture picture = {pixels, height, width, stride, table};
    Lines lines;
    double moved = 0.0, pitch_px = 0.0;
    for (int round = 0; round < ROUGH_ROUNDS + ROUNDS; round++) {
        const double side_px = sqrt(fmax(ledpi_area(corners), 0.0));
        Point step[4];
        if (!(side_px > 2.0 * (double)cells)) return NAN;
        begin(&lines, corners, cells);
        const bool rough = round < ROUGH_ROUNDS;
        if (!(rough ? roughly(&picture, &lines, step) : exactly(&picture, lens, corners, &lines, step))) return NAN;
        moved = 0.0, pitch_px = side_px / (double)cells;
        for (int c = 0; c < 4; c++) {
            const double away = ledpi_length(step[c].x, step[c].y);
            if (!(away < MOST_SHARE * side_px)) return NAN;
            moved = fmax(moved, away);
        }
        for (int c = 0; c < 4; c++) corners[c].x += step[c].x, corners[c].y += step[c].y;
        if (!rough && moved < NEAR_PX) break;
    }
    if (!(moved < fmax(2 * lines.sigma_px, NEAR_PX) && lines.sigma_px < MAX_SIGMA_PX)) return NAN;
    if (!(lines.away_px < MAX_AWAY * pitch_px)) return NAN;
    begin(&lines, corners, cells);
    return are_darkest(&picture, &lines) ? lines.sigma_px : NAN;
}
