/* A panel's corners by all the lines of its lattice, as decode/corners/adjust.py explains and does it. */
#include <math.h>

#include "lattice.h"
#include "quads.h"

enum { PLACES = 6, MOST_RIMS = 4 * MOST_CELLS, MOST_MEASURED = MOST_INNER + MOST_RIMS, ALL = MOVES + 4 };
#define FIRST_PLACE 0.2
#define LAST_PLACE 0.8
#define BUILT_PX 0.05
#define LEAST_VARIANCE 0.2
#define LOOSE 0.01
#define HUBER 2.0
#define FARTHEST 4.0
#define MOST_PX 2.0
#define NO_RIM_WALL_PX 0.2
#define LEAST_HEIGHT 0.3

typedef struct {
    double slopes[MOST_MEASURED][ALL], seen[MOST_MEASURED], variance[MOST_MEASURED], left[MOST_MEASURED];
    double weights[MOST_MEASURED], prior[4][4], information[ALL][ALL], moves[ALL];
    ptrdiff_t inner, count; /* the first `inner` are of inner lines */
} Problem;

void ledpi_moves_at(double u, double v, double by_u[MOVES], double by_v[MOVES]) {
    const double along_u[MOVES] = {1, u, v, 0, 0, 0, u * u, u * v}, along_v[MOVES] = {0, 0, 0, 1, u, v, u * v, v * v};
    for (int m = 0; m < MOVES; m++) by_u[m] = along_u[m], by_v[m] = along_v[m];
}

void ledpi_factor(double *matrix, int size) {
    for (int i = 0; i < size; i++)
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i * size + j];
            for (int k = 0; k < j; k++) sum -= matrix[i * size + k] * matrix[j * size + k];
            matrix[i * size + j] = i == j ? sqrt(sum) : sum / matrix[j * size + j];
        }
}

void ledpi_forward(const double *lower, int size, double *vector) {
    for (int i = 0; i < size; i++) {
        for (int k = 0; k < i; k++) vector[i] -= lower[i * size + k] * vector[k];
        vector[i] /= lower[i * size + i];
    }
}

void ledpi_backward(const double *lower, int size, double *vector) {
    for (int i = size - 1; i >= 0; i--) {
        for (int k = i + 1; k < size; k++) vector[i] -= lower[k * size + i] * vector[k];
        vector[i] /= lower[i * size + i];
    }
}

/* Place `cell` of a side, counted along it, and which way is inward: 1 along u or v, or −1 against. */
static double side_place(int side, double share, double *u, double *v) {
    *u = side == 0 ? share : side == 1 ? 1.0 : side == 2 ? 1.0 - share : 0.0;
    *v = side == 0 ? 0.0 : side == 1 ? share : side == 2 ? 1.0 : 1.0 - share;
    return side == 0 || side == 3 ? 1.0 : -1.0;
}

double ledpi_measure_at(const Homography *homography, double u, double v, bool along_u, double slopes[MOVES]) {
    double by_u[MOVES], by_v[MOVES];
    Point at, x, y;
    ledpi_seen(homography, u, v, &at, &x, &y);
    double scale = fabs(x.x * y.y - x.y * y.x) / (along_u ? ledpi_length(y.x, y.y) : ledpi_length(x.x, x.y));
    ledpi_moves_at(u, v, by_u, by_v);
    for (int m = 0; m < MOVES; m++) slopes[m] = scale * (along_u ? by_u[m] : by_v[m]);
    return scale;
}

/* Where the lens puts what would be at a pixel without it. */
static Point bent(const Lens *lens, Point at) {
    const double ray[3] = {(at.x - lens->cx) / lens->fx, (at.y - lens->cy) / lens->fy, 1.0};
    double pixel[2], slope[2][3];
    ledpi_project(lens, ray, pixel, slope);
    return (Point){pixel[0], pixel[1]};
}

void ledpi_lens_moves(const Lens *lens, const Homography *homography, const Point corners[4], ptrdiff_t cells,
                       Point *moves) {
    Point there[4], at, by_u, by_v;
    Homography bent_homography;
    double u, v;
    for (int k = 0; k < 4 && lens; k++) there[k] = bent(lens, corners[k]);
    if (lens) ledpi_unit_square_to(there, bent_homography.h);
    for (ptrdiff_t i = 0; i < 2 * cells * (cells - 1); i++) {
        moves[i] = (Point){0.0, 0.0};
        if (!lens) continue;
        ledpi_line_place(i, cells, &u, &v);
        ledpi_seen(homography, u, v, &at, &by_u, &by_v);
        const Point seen = bent(lens, at);
        ledpi_seen(&bent_homography, u, v, &at, &by_u, &by_v);
        moves[i] = (Point){seen.x - at.x, seen.y - at.y};
    }
}

/* `_rims` there; the inverse of the shifts' covariance goes into problem->prior. */
static void take_rims(const Picture *picture, const Point corners[4], const double *bends, const Filter *filters[4],
                      ptrdiff_t cells, Problem *problem) {
    double begins[4][MOST_CELLS], height[MOST_RIMS], ordered[MOST_RIMS], spread = 0.0;
    Side sides[4];
    ledpi_sides_of(corners, sides);
    for (int k = 0; k < 4; k++)
        for (ptrdiff_t c = 0; c < cells; c++) {
            double edge = 0.0, high = 0.0;
            float xs[PLACES][RIM_T], ys[PLACES][RIM_T], light[PLACES][RIM_T];
            for (int p = 0; p < PLACES; p++) {
                double share = ((double)c + FIRST_PLACE + (LAST_PLACE - FIRST_PLACE) * p / (PLACES - 1)) / (double)cells;
                double bend = 13.5 * share * (share - 1) *
                              ((share - 2.0 / 3) * bends[4 * k + 1] - (share - 1.0 / 3) * bends[4 * k + 3]);
                double x = sides[k].start.x + sides[k].along.x * share, y = sides[k].start.y + sides[k].along.y * share;
                for (int t = 0; t < RIM_T; t++) {
                    double in = RIM_FIRST_ACROSS + t + bend;
                    xs[p][t] = (float)(x + sides[k].inward.x * in), ys[p][t] = (float)(y + sides[k].inward.y * in);
                }
            }
            ledpi_light_at_all(picture, xs[0], ys[0], PLACES * RIM_T, light[0]);
            for (int p = 0; p < PLACES; p++)
                for (int t = 0; t < RIM_T; t++) {
                    edge += light[p][t] * filters[k]->single[t][0];
                    high += light[p][t] * filters[k]->single[t][1];
                }
            begins[k][c] = edge / high;
            height[k * cells + c] = ordered[k * cells + c] = high / PLACES;
        }
    double usual = ledpi_kth(ordered, 4 * cells, 2 * cells);
    usual = 0.5 * (usual + ledpi_kth(ordered, 4 * cells, 2 * cells - 1));
    for (int k = 0; k < 4; k++) {
        double sum = 0.0, counted = 0.0;
        for (ptrdiff_t c = 0; c < cells; c++)
            if (height[k * cells + c] > fmax(LEAST_HEIGHT * usual, 1e-6)) sum += begins[k][c], counted += 1.0;
        for (ptrdiff_t c = 0; c < cells; c++) {
            bool shown = height[k * cells + c] > fmax(LEAST_HEIGHT * usual, 1e-6);
            begins[k][c] = shown ? begins[k][c] - sum / counted : 0.0;
            problem->variance[problem->inner + k * cells + c] = shown ? 0.0 : NOT_SEEN_PX2;
            spread += begins[k][c] * begins[k][c] / (double)(4 * cells - 8);
        }
    }
    for (ptrdiff_t i = 0; i < 4 * cells; i++) {
        double *variance = &problem->variance[problem->inner + i];
        if (*variance == 0.0) *variance = BUILT_PX * BUILT_PX + spread;
        problem->seen[problem->inner + i] *= begins[i / cells][i % cells]; /* it holds which way is inward */
    }
    double covariance[4][4];
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            bool pair = (i & 1) == (j & 1);
            covariance[i][j] = sqrt(filters[i]->both_variance * filters[j]->both_variance) * (pair ? 1.0 : PAIRS_ALIKE);
            if (pair) covariance[i][j] += filters[i]->apart_variance * (i == j ? 1.0 : -1.0);
            if (i == j) covariance[i][j] += spread / (double)cells;
        }
    ledpi_factor(&covariance[0][0], 4);
    for (int i = 0; i < 4; i++) {
        double column[4] = {i == 0, i == 1, i == 2, i == 3};
        ledpi_forward(&covariance[0][0], 4, column);
        ledpi_backward(&covariance[0][0], 4, column);
        for (int j = 0; j < 4; j++) problem->prior[i][j] = column[j];
    }
}

/* The moves that explain what is seen, and what they leave; the information's factor stays in its place. */
static void solve(Problem *problem, double prior) {
    double pull[ALL] = {0.0};
    for (int i = 0; i < ALL; i++)
        for (int j = 0; j <= i; j++)
            problem->information[i][j] = i >= MOVES && j >= MOVES ? prior * problem->prior[i - MOVES][j - MOVES] : 0.0;
    for (ptrdiff_t m = 0; m < problem->count; m++) {
        const double *row = problem->slopes[m], weight = problem->weights[m];
        for (int i = 0; i < ALL; i++) {
            double weighted = weight * row[i];
            if (weighted == 0.0) continue;
            pull[i] += weighted * problem->seen[m];
            for (int j = 0; j <= i; j++) problem->information[i][j] += weighted * row[j];
        }
    }
    ledpi_factor(&problem->information[0][0], ALL);
    ledpi_forward(&problem->information[0][0], ALL, pull);
    ledpi_backward(&problem->information[0][0], ALL, pull);
    for (int i = 0; i < ALL; i++) problem->moves[i] = pull[i];
    for (ptrdiff_t m = 0; m < problem->count; m++) {
        problem->left[m] = problem->seen[m];
        for (int i = 0; i < ALL; i++) problem->left[m] -= problem->slopes[m][i] * pull[i];
    }
}

/* Variance of what is left unexplained over what was expected; taken off the weights from … to − 1. */
static void agree(Problem *problem, const double *weights, ptrdiff_t from, ptrdiff_t to) {
    double total = 0.0, measured = 0.0;
    for (ptrdiff_t m = from; m < to; m++) {
        measured += weights[m] > 1.0 / NOT_SEEN_PX2;
        total += fmin(problem->left[m] * problem->left[m] * weights[m], FARTHEST * FARTHEST);
    }
    double ratio = fmax(total / fmax(measured - MOVES, 1.0), LEAST_VARIANCE);
    for (ptrdiff_t m = from; m < to; m++) problem->weights[m] = weights[m] / ratio;
}

static void least_squares(Problem *problem) {
    ptrdiff_t inner = problem->inner, count = problem->count;
    double weights[MOST_MEASURED];
    for (ptrdiff_t m = 0; m < count; m++) {
        weights[m] = 1.0 / problem->variance[m];
        problem->weights[m] = m < inner ? weights[m] : LOOSE * weights[m];
    }
    solve(problem, LOOSE);
    agree(problem, weights, 0, inner);
    for (ptrdiff_t m = inner; m < count; m++) problem->weights[m] = weights[m];
    solve(problem, 1.0);
    agree(problem, weights, inner, count);
    for (ptrdiff_t m = 0; m < count; m++)
        problem->weights[m] *= fmin(1.0, HUBER / fmax(fabs(problem->left[m]) * sqrt(problem->weights[m]), HUBER));
    solve(problem, 1.0);
}

/* By how much each side moves outward, in its middle, where corners take a `step`: the `mean`, and that of the side with the
 * least. */
static double outward(const Side sides[4], double step[4][2], double *mean) {
    double least = HUGE_VAL;
    *mean = 0.0;
    for (int k = 0; k < 4; k++) {
        const double *here = step[k], *next = step[(k + 1) % 4];
        const double out = -0.5 * ((here[0] + next[0]) * sides[k].inward.x + (here[1] + next[1]) * sides[k].inward.y);
        least = fmin(least, out);
        *mean += 0.25 * out;
    }
    return least;
}

/* Of what depends so on the homography's moves. */
static double variance_of(const Problem *problem, double by_move[ALL]) {
    double variance = 0.0;
    ledpi_forward(&problem->information[0][0], ALL, by_move);
    for (int m = 0; m < ALL; m++) variance += by_move[m] * by_move[m];
    return variance;
}

/* The corners after the moves, and their deviations; no numbers where they would go too far. Where that is because all sides
 * move outward, by which share of the side: less than the `most_rim_wall`, else 0. */
static void move_corners(const Homography *homography, const Problem *problem, const Point corners[4], double most_rim_wall,
                         Adjusted *better) {
    double variance = 0.0, farthest = 0.0, steps[4][2], by_outward[ALL] = {0.0}, mean;
    Side sides[4];
    ledpi_sides_of(corners, sides);
    for (int c = 0; c < 4; c++) {
        double u = c == 1 || c == 2, v = c >= 2, along_u[MOVES], along_v[MOVES];
        Point at, by_u, by_v;
        ledpi_seen(homography, u, v, &at, &by_u, &by_v);
        ledpi_moves_at(u, v, along_u, along_v);
        double by_move[2][ALL] = {{0.0}}, *step = steps[c];
        const double out[2] = {-(sides[c].inward.x + sides[(c + 3) & 3].inward.x) / 8,
                               -(sides[c].inward.y + sides[(c + 3) & 3].inward.y) / 8};
        step[0] = step[1] = 0.0;
        for (int m = 0; m < MOVES; m++) {
            by_move[0][m] = by_u.x * along_u[m] + by_v.x * along_v[m];
            by_move[1][m] = by_u.y * along_u[m] + by_v.y * along_v[m];
            for (int i = 0; i < 2; i++) {
                step[i] += by_move[i][m] * problem->moves[m];
                by_outward[m] += out[i] * by_move[i][m];
            }
        }
        for (int i = 0; i < 2; i++) variance += variance_of(problem, by_move[i]) / 8;
        better->corners[c] = (Point){corners[c].x + step[0], corners[c].y + step[1]};
        double away = ledpi_length(step[0], step[1]);
        if (!(away <= farthest)) farthest = away;
    }
    const bool further = outward(sides, steps, &mean) >= NO_RIM_WALL_PX, fits = farthest < MOST_PX && !further;
    const double share = mean / sqrt(fabs(ledpi_area(corners)));
    better->rim_wall = further && share < most_rim_wall ? share : 0.0;
    better->sigma_px = fits ? sqrt(variance + mean * mean / 3) : NAN;
    better->size_sigma_px = fits ? sqrt(variance_of(problem, by_outward) + mean * mean / 3) : NAN;
}

void ledpi_adjust(const Picture *picture, const Tables *tables, const Point corners[4], const double *bends,
                  const Lens *lens, Adjusted *better, Missing *missing) {
    const ptrdiff_t cells = tables->cells, inner = 2 * cells * (cells - 1);
    Point moves[MOST_INNER];
    Problem problem = {.inner = inner, .count = inner + 4 * cells};
    Homography homography;
    const Filter *filters[4];
    ledpi_unit_square_to(corners, homography.h);
    double pitch[2] = {0.0, 0.0}, u, v;
    for (ptrdiff_t i = 0; i < inner; i++) {
        ledpi_line_place(i, cells, &u, &v);
        double scale = ledpi_measure_at(&homography, u, v, i < inner / 2, problem.slopes[i]);
        for (int k = 0; k < 4; k++) problem.slopes[i][MOVES + k] = 0.0;
        pitch[i >= inner / 2] += scale / (double)(inner / 2 * cells);
    }
    for (ptrdiff_t i = 0; i < 4 * cells; i++) {
        int side = (int)(i / cells);
        double inward = side_place(side, ((double)(i % cells) + 0.5) / (double)cells, &u, &v);
        ledpi_measure_at(&homography, u, v, side & 1, problem.slopes[inner + i]);
        for (int k = 0; k < 4; k++) problem.slopes[inner + i][MOVES + k] = 0.0;
        problem.slopes[inner + i][MOVES + side] = problem.seen[inner + i] = inward;
    }
    for (int k = 0; k < 4; k++) /* going inward from sides 0 and 2 is along v */
        filters[k] = ledpi_filter_for(&tables->filters, pitch[!(k & 1)], tables->filters.usual_blur_px, &missing->filter);
    better->rim_wall = 0.0, better->sigma_px = better->size_sigma_px = NAN;
    if (missing->filter) return;
    ledpi_lens_moves(lens, &homography, corners, cells, moves);
    ledpi_inner_lines(picture, &homography, pitch, moves, cells, problem.seen, problem.variance);
    for (ptrdiff_t i = 0; i < inner; i++) problem.variance[i] += BUILT_PX * BUILT_PX;
    take_rims(picture, corners, bends, filters, cells, &problem);
    least_squares(&problem);
    move_corners(&homography, &problem, corners, tables->refining->no_rim_wall, better);
}
