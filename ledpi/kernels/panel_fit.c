/* The picture of a panel fitted to light: `fitted` of decode/striped/panel_fit.py, which has the equations. */
#include <math.h>
#include <string.h>

#include "kernels.h"
#include "normal.h"
#include "pose.h"

enum {
    WAYS = 8,   /* in which a homography can be wrong */
    SPOTS = 2,  /* widths of which a cell's light is made up */
    MOST_CELLS = 8, /* along a side */
    MOST_ALONG = 160, /* places along the grid */
    BLUR = WAYS, GAP, LONGER, SMOOTHER, PHASE, SPOT = PHASE + 2, BESIDE = SPOT + SPOTS, RIM = BESIDE + 4, GAIN, /* unknowns; after the gains, what is there anyway */
    MOST_UNKNOWN = GAIN + MOST_CELLS * MOST_CELLS + 1,
    DENSE = 24, /* columns of a sample: by the unknowns before the gains, what is there anyway, and what is left */
    DARK_COLUMN = GAIN, LEFT_COLUMN = GAIN + 1,
    MOST_MET = 4, /* cells whose light meets at a place */
    STEPS = 512, /* of a period */
};
static const double SPOT_SIGMA[SPOTS] = {0.16, 0.32}; /* of the pitch; as in decode/striped/panel_fit.py, and what follows */
#define ROOT_HALF 0.7071067811865476
#define FLOOR 0.1 /* of full light: what weighs as much as the noise of what is dark; and what texture outside does */
#define OUTSIDE 1.0
#define MOST_STEP 0.1
#define SETTLED 1e-3
#define LEAST_GAIN 0.02
#define NO_RIM_WALL_PX 0.2 /* as in adjust.c */
static const double LEAST_BLUR_PX = 0.4, MOST_BLUR_PX = 3.0, MOST_GAP = 0.3;
static const double MOST_LONGER = 0.5, MOST_SMOOTHER = 2.0;

/* Light (rows, columns) of a part of the picture, each of `shrink` pixels a side, the first one's centre at `first`. */
typedef struct {
    const float *light;
    ptrdiff_t rows, columns;
    double first_x, first_y, shrink, saturated;
    const Lens *lens; /* NULL: there is none */
} View;

/* Of one place along the grid: the nearest cell and the next nearest. What its light is there, and how that changes with
 * the place, with the blur's logarithm, with the gap, and with how far further in the rim is; its spots, and how these
 * change with the place, and with the blur. */
typedef struct {
    ptrdiff_t cell[2];
    double light[2], slope[2], blurred[2], gapped[2], rimmed[2], spot[2][SPOTS], steep[2][SPOTS], wider[2][SPOTS];
    double beside[2], falls[2]; /* share of what is before the first cell and after the last, and its slope */
} Place;

static double density(double z) { return 0.3989422804014327 * exp(-0.5 * z * z); }

static Place place_at(double at, ptrdiff_t cells, double sigma, double gap, double rim) {
    Place place = {{0}, {0}, {0}, {0}, {0}, {0}, {{0}}, {{0}}, {{0}}, {0}, {0}};
    double within = fmin(fmax(floor(at), 0.0), (double)(cells - 1));
    place.cell[0] = (ptrdiff_t)within;
    for (int k = 0; k < 2; k++) {
        double beyond = ((k ? at - (double)cells : -at) + rim) / sigma;
        place.beside[k] = 0.5 * (1.0 + erf(beyond * ROOT_HALF));
        place.falls[k] = (k ? 1.0 : -1.0) * density(beyond) / sigma;
    }
    place.cell[1] = place.cell[0] + (at - within > 0.5 ? 1 : -1);
    for (int k = 0; k < 2; k++) {
        ptrdiff_t cell = place.cell[k];
        if (cell < 0 || cell >= cells) {
            place.cell[k] = -1;
            continue;
        }
        double wall_before = cell > 0 ? 0.5 : 0.0, wall_after = cell < cells - 1 ? 0.5 : 0.0;
        double before = (at - (double)cell - gap * wall_before - (cell > 0 ? 0.0 : rim)) / sigma;
        double after = (at - (double)(cell + 1) + gap * wall_after + (cell < cells - 1 ? 0.0 : rim)) / sigma;
        double up = density(before), down = density(after), off = at - (double)cell - 0.5;
        place.light[k] = 0.5 * (erf(before * ROOT_HALF) - erf(after * ROOT_HALF));
        place.slope[k] = (up - down) / sigma;
        place.blurred[k] = after * down - before * up;
        place.gapped[k] = -(up * wall_before + down * wall_after) / sigma;
        place.rimmed[k] = -(up * (cell == 0) + down * (cell == cells - 1)) / sigma;
        double inside = fmin(fmax(off, -0.5), 0.5);
        for (int s = 0; s < SPOTS; s++) {
            double spot_sigma = hypot(SPOT_SIGMA[s], sigma), z = inside / spot_sigma;
            place.spot[k][s] = exp(-0.5 * z * z);
            place.steep[k][s] = inside == off ? -z / spot_sigma * place.spot[k][s] : 0.0;
            place.wider[k][s] = z * z * sigma * sigma / (spot_sigma * spot_sigma) * place.spot[k][s];
        }
    }
    return place;
}

static double light_at(const View *view, double x, double y) {
    float right, down;
    ptrdiff_t column = ledpi_before((float)x, view->columns, &right), row = ledpi_before((float)y, view->rows, &down);
    const float *above = view->light + row * view->columns + column, *below = above + view->columns;
    float upper = above[0] + right * (above[1] - above[0]), lower = below[0] + right * (below[1] - below[0]);
    return upper + down * (lower - upper);
}

/* A wave's share of its light at `cycles`, from a table (STEPS,) of its period, and how that changes by a cycle. */
static double wave_at(const float *table, double cycles, double *slope) {
    double turn = cycles - (double)(ptrdiff_t)cycles; /* what is cut off may be negative */
    if (turn < 0.0) turn += 1.0;
    double at = turn * STEPS;
    ptrdiff_t step = (ptrdiff_t)at;
    step = step < STEPS ? step : STEPS - 1;
    double here = table[step], next = table[step + 1 < STEPS ? step + 1 : 0];
    *slope = (next - here) * STEPS;
    return here + (at - (double)step) * (next - here);
}

typedef struct {
    ptrdiff_t cells;
    const uint8_t *white;
    const float *waves; /* (2, STEPS), and where there are `shapes` two times the same: how they change with either */
    bool shapes;
    double cycles_a_row[2], scale, dark; /* light is (what is seen − dark)·scale */
} Panel;

/* What a sample is explained by: how it changes with the gains of the few cells that meet there, beside `DENSE`. */
typedef struct {
    ptrdiff_t count, cell[MOST_MET];
    float by[MOST_MET];
} Gains;

/* Of a place of the grid: `into` (DENSE,), gains, and adds squares of what is left, and of all there is, to `sums`.
 * Returns false where the sample tells nothing. */
static bool sample(const Panel *panel, const View *view, const double *h, const double *unknown, const Place *across,
                   const Place *down, double u, double v, float *into, Gains *gains, double sums[2]) {
    const ptrdiff_t n = panel->cells, last = GAIN + n * n;
    double w = 1.0 / (h[6] * u + h[7] * v + h[8]), at[2] = {(h[0] * u + h[1] * v + h[2]) * w, (h[3] * u + h[4] * v + h[5]) * w};
    if (view->lens) ledpi_distort(view->lens, at[0], at[1], at);
    double x = (at[0] - view->first_x) / view->shrink, y = (at[1] - view->first_y) / view->shrink;
    if (!(x >= 0.0 && y >= 0.0 && x <= (double)(view->columns - 1) && y <= (double)(view->rows - 1))) return false;
    double seen = light_at(view, x, y);
    if (!(seen < view->saturated)) return false;
    double shown[2], later[2], shape_by[2][2] = {{0.0}}, slope[2] = {0.0, 0.0}, total = unknown[last], weight, by[GAIN] = {0.0};
    double own[MOST_MET];
    gains->count = 0;
    for (int k = 0; k < 2; k++) {
        const double cycles = unknown[PHASE + k] + at[1] * panel->cycles_a_row[k];
        shown[k] = wave_at(panel->waves + k * STEPS, cycles, &later[k]);
        for (int s = 0; panel->shapes && s < 2; s++) {
            double of_slope;
            shape_by[k][s] = wave_at(panel->waves + (2 + 2 * s + k) * STEPS, cycles, &of_slope);
            shown[k] += unknown[LONGER + s] * shape_by[k][s];
            later[k] += unknown[LONGER + s] * of_slope;
        }
    }
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            if (across->cell[i] < 0 || down->cell[j] < 0) continue;
            const double both = across->light[i] * down->light[j];
            if (both < 1e-4) continue;
            const ptrdiff_t cell = down->cell[j] * n + across->cell[i];
            const int class = panel->white[cell] != 0;
            double shape = 1.0, tilt[2] = {0.0, 0.0};
            const double lit = unknown[GAIN + cell] * shown[class];
            for (int s = 0; s < SPOTS; s++) {
                const double spot = across->spot[i][s] * down->spot[j][s], much = unknown[SPOT + s];
                shape += much * spot;
                tilt[0] += much * across->steep[i][s] * down->spot[j][s];
                tilt[1] += much * across->spot[i][s] * down->steep[j][s];
                by[SPOT + s] += lit * both * spot;
                by[BLUR] += lit * both * much * (across->wider[i][s] * down->spot[j][s] + across->spot[i][s] * down->wider[j][s]);
            }
            slope[0] += lit * (across->slope[i] * down->light[j] * shape + both * tilt[0]);
            slope[1] += lit * (across->light[i] * down->slope[j] * shape + both * tilt[1]);
            by[BLUR] += lit * shape * (across->blurred[i] * down->light[j] + across->light[i] * down->blurred[j]);
            by[GAP] += lit * shape * (across->gapped[i] * down->light[j] + across->light[i] * down->gapped[j]);
            by[RIM] += lit * shape * (across->rimmed[i] * down->light[j] + across->light[i] * down->rimmed[j]);
            by[PHASE + class] += unknown[GAIN + cell] * both * shape * later[class];
            by[LONGER] += unknown[GAIN + cell] * both * shape * shape_by[class][0];
            by[SMOOTHER] += unknown[GAIN + cell] * both * shape * shape_by[class][1];
            own[gains->count] = both * shape * shown[class];
            gains->cell[gains->count++] = cell;
            total += lit * both * shape;
        }
    double outside = 0.0;
    for (int k = 0; k < 2; k++) { /* left, right, top, bottom; at a corner of either's only */
        const double here[2] = {across->beside[k], down->beside[k] * (1.0 - across->beside[0] - across->beside[1])};
        for (int axis = 0; axis < 2; axis++) {
            by[BESIDE + 2 * axis + k] = here[axis];
            total += unknown[BESIDE + 2 * axis + k] * here[axis];
            outside += here[axis];
        }
        const double nearer[2] = {k ? across->falls[1] : -across->falls[0], k ? down->falls[1] : -down->falls[0]};
        by[RIM] += unknown[BESIDE + k] * nearer[0];
        by[RIM] += unknown[BESIDE + 2 + k] * nearer[1] * (1.0 - across->beside[0] - across->beside[1]);
        by[RIM] -= unknown[BESIDE + 2 + k] * down->beside[k] * (across->falls[1] - across->falls[0]);
        slope[0] += unknown[BESIDE + k] * across->falls[k];
        slope[0] -= unknown[BESIDE + 2 + k] * down->beside[k] * (across->falls[0] + across->falls[1]);
        slope[1] += unknown[BESIDE + 2 + k] * down->falls[k] * (1.0 - across->beside[0] - across->beside[1]);
    }
    const double p = 2.0 * u - 1.0, q = 2.0 * v - 1.0, half = 0.5 * (double)n;
    slope[0] *= half, slope[1] *= half;
    by[0] = slope[0], by[1] = p * slope[0], by[2] = q * slope[0];
    by[3] = slope[1], by[4] = p * slope[1], by[5] = q * slope[1];
    by[6] = p * (p * slope[0] + q * slope[1]), by[7] = q * (p * slope[0] + q * slope[1]);
    seen = (seen - panel->dark) * panel->scale;
    weight = 1.0 / sqrt(fmax(total, 0.0) + FLOOR + OUTSIDE * outside);
    for (int k = 0; k < GAIN; k++) into[k] = (float)(weight * by[k]);
    for (ptrdiff_t k = 0; k < gains->count; k++) gains->by[k] = (float)(weight * own[k]);
    into[DARK_COLUMN] = (float)weight;
    into[LEFT_COLUMN] = (float)(weight * (seen - total));
    sums[0] += weight * weight * (seen - total) * (seen - total);
    sums[1] += weight * weight * (seen - unknown[last]) * (seen - unknown[last]);
    return true;
}

/* Sums of products of all columns: `dense` (DENSE, DENSE) on and above the diagonal, `mixed` (cells, DENSE) with the
 * gains, `own` (cells, cells) of these among each other. */
typedef struct {
    float dense[DENSE * DENSE], mixed[MOST_CELLS * MOST_CELLS * DENSE];
    double own[MOST_CELLS * MOST_CELLS][MOST_CELLS * MOST_CELLS];
} Products;

static void add_gains(Products *products, const Gains *gains, const float *dense) {
    for (ptrdiff_t i = 0; i < gains->count; i++) {
        float *into = products->mixed + gains->cell[i] * DENSE;
        for (int k = 0; k < DENSE; k++) into[k] += gains->by[i] * dense[k];
        for (ptrdiff_t j = 0; j < gains->count; j++)
            products->own[gains->cell[i]][gains->cell[j]] += (double)(gains->by[i] * gains->by[j]);
    }
}

/* The product of unknowns i ≥ j; of the first with what is left where i is `size`. */
static double product_of(const Products *products, ptrdiff_t size, ptrdiff_t i, ptrdiff_t j) {
    const ptrdiff_t last = size - 1;
    const int column = i == size ? LEFT_COLUMN : i == last ? DARK_COLUMN : (int)i;
    if (i >= GAIN && i < last) return j >= GAIN ? products->own[i - GAIN][j - GAIN] : products->mixed[(i - GAIN) * DENSE + j];
    if (j >= GAIN && j < last) return products->mixed[(j - GAIN) * DENSE + column];
    return products->dense[(j == last ? DARK_COLUMN : j) * DENSE + column];
}

/* Solves a symmetric positive matrix (size, size) for the right side, which becomes the solution; the matrix becomes its
 * Cholesky factor. */
static bool solve(double *matrix, ptrdiff_t size, double *right) {
    for (ptrdiff_t i = 0; i < size; i++)
        for (ptrdiff_t j = 0; j <= i; j++) {
            double sum = matrix[i * size + j];
            for (ptrdiff_t k = 0; k < j; k++) sum -= matrix[i * size + k] * matrix[j * size + k];
            if (i == j && !(sum > 0.0)) return false;
            matrix[i * size + j] = i == j ? sqrt(sum) : sum / matrix[j * size + j];
        }
    for (ptrdiff_t i = 0; i < size; i++) {
        for (ptrdiff_t k = 0; k < i; k++) right[i] -= matrix[i * size + k] * right[k];
        right[i] /= matrix[i * size + i];
    }
    for (ptrdiff_t i = size - 1; i >= 0; i--) {
        for (ptrdiff_t k = i + 1; k < size; k++) right[i] -= matrix[k * size + i] * right[k];
        right[i] /= matrix[i * size + i];
    }
    return true;
}

/* The corners after the homography has been wrong by these WAYS; those of a rim that is so many times as large. */
static void move(Point corners[4], const double h[9], const double *ways, double rim_share) {
    static const double ends[4][2] = {{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}};
    for (int i = 0; i < 4; i++) {
        double p = ends[i][0] * rim_share, q = ends[i][1] * rim_share, both = ways[6] * p + ways[7] * q;
        double u = 0.5 * (p - ways[0] - ways[1] * p - ways[2] * q - p * both + 1.0);
        double v = 0.5 * (q - ways[3] - ways[4] * p - ways[5] * q - q * both + 1.0);
        double w = h[6] * u + h[7] * v + h[8];
        corners[i] = (Point){(h[0] * u + h[1] * v + h[2]) / w, (h[3] * u + h[4] * v + h[5]) / w};
    }
}

/* How the corners of a rim that is so many times as large move with each of the WAYS, and with the rim at last. */
static void slopes_of(const double h[9], double rim_share, ptrdiff_t cells, double by_way[8][WAYS + 1]) {
    const double little = 1e-4;
    for (int way = 0; way <= WAYS; way++) {
        double ways[WAYS + 1] = {0.0};
        Point moved[4], here[4];
        move(here, h, ways, rim_share);
        ways[way] = little;
        move(moved, h, ways, rim_share - 2.0 * ways[WAYS] / (double)cells);
        for (int i = 0; i < 4; i++) {
            by_way[2 * i][way] = (moved[i].x - here[i].x) / little;
            by_way[2 * i + 1][way] = (moved[i].y - here[i].y) / little;
        }
    }
}

/* By the Cholesky factor of what is known of the unknowns, `sigmas` (2,): the deviation of the coordinates of corners whose
 * rim is where it is taken to be; and that of the square's size, by which all sides move outward alike. Where `undone` is not
 * 0, the rim was that far within the lattice's end, and has been taken there. */
static void deviations(const double *factor, ptrdiff_t size, ptrdiff_t cells, const double h[9], double rim_share,
                       double undone, double sigmas[2]) {
    double of_way[WAYS + 1][MOST_UNKNOWN], by_way[8][WAYS + 1], outward[MOST_UNKNOWN] = {0.0}, of_rim = 0.0, shared = 0.0;
    Point corners[4];
    Side sides[4];
    for (int way = 0; way <= WAYS; way++)
        for (ptrdiff_t i = 0; i < size; i++) {
            double left = i == (way < WAYS ? way : RIM);
            for (ptrdiff_t k = 0; k < i; k++) left -= factor[i * size + k] * of_way[way][k];
            of_way[way][i] = left / factor[i * size + i];
        }
    slopes_of(h, rim_share, cells, by_way);
    move(corners, h, (double[WAYS]){0.0}, rim_share);
    ledpi_sides_of(corners, sides);
    for (ptrdiff_t i = 0; i < size; i++) of_rim += of_way[WAYS][i] * of_way[WAYS][i];
    sigmas[0] = sigmas[1] = 0.0;
    for (int coordinate = 0; coordinate < 8; coordinate++) {
        const Point one = sides[coordinate / 2].inward, other = sides[(coordinate / 2 + 3) & 3].inward;
        const double out = -(coordinate & 1 ? one.y + other.y : one.x + other.x) / 8.0;
        double with_rim = 0.0;
        for (ptrdiff_t i = 0; i < size; i++) {
            double part = 0.0;
            for (int way = 0; way < WAYS; way++) part += by_way[coordinate][way] * of_way[way][i];
            sigmas[0] += part * part / 8.0;
            with_rim += part * of_way[WAYS][i];
            outward[i] += out * (part + by_way[coordinate][WAYS] * of_way[WAYS][i]);
        }
        sigmas[0] -= with_rim * with_rim / of_rim / 8.0;
    }
    for (ptrdiff_t i = 0; i < size; i++) {
        sigmas[1] += outward[i] * outward[i];
        shared += outward[i] * of_way[WAYS][i];
    }
    if (undone != 0.0) sigmas[1] += shared * shared / of_rim * (undone * undone / of_rim / 3.0 - 1.0);
    sigmas[0] = sqrt(sigmas[0]), sigmas[1] = sqrt(sigmas[1]);
}

/* Takes the rim to where the lattice ends, and all else to where it is likeliest then; by the factor of what is known. */
static void close_rim(const double *factor, ptrdiff_t size, Point corners[4], double *unknown) {
    double column[MOST_UNKNOWN] = {0.0}, h[9], ways[WAYS];
    column[RIM] = 1.0 / factor[RIM * size + RIM];
    for (ptrdiff_t i = RIM + 1; i < size; i++) {
        for (ptrdiff_t k = RIM; k < i; k++) column[i] -= factor[i * size + k] * column[k];
        column[i] /= factor[i * size + i];
    }
    for (ptrdiff_t i = size - 1; i >= 0; i--) {
        for (ptrdiff_t k = i + 1; k < size; k++) column[i] -= factor[k * size + i] * column[k];
        column[i] /= factor[i * size + i];
    }
    const double much = -unknown[RIM] / column[RIM];
    for (int i = 0; i < WAYS; i++) ways[i] = much * column[i];
    for (ptrdiff_t i = WAYS; i < size; i++) unknown[i] += much * column[i];
    unknown[RIM] = 0.0;
    ledpi_unit_square_to(corners, h);
    move(corners, h, ways, 1.0);
}

/* Fits it, in `rounds` at most, from `corners` (4) and the values of the unknowns (GAIN + cells² + 1), of which the first
 * WAYS are not used; both become what fits best. `prior` (2, unknowns): what they should be, and how surely. `pitch_px`
 * (2,) of the view, across and down. `result` (5,): the share of the light's squares that is explained before the last step,
 * samples, variance of what is left, and `deviations`. Returns false where it comes to nothing. */
int ledpi_fit_panel(const float *light, ptrdiff_t rows, ptrdiff_t columns, double first_x, double first_y, double shrink,
                    double saturated, const Lens *lens, ptrdiff_t cells, const uint8_t *white, const float *waves,
                    ptrdiff_t shapes, const double *cycles_a_row, double dark, double scale, ptrdiff_t places, const double *along,
                    const double *pitch_px, ptrdiff_t rounds, const double *prior, Point *corners, double *unknown,
                    double *result) {
    const ptrdiff_t size = GAIN + cells * cells + 1;
    const View view = {light, rows, columns, first_x, first_y, shrink, saturated, lens};
    const Panel panel = {cells, white, waves, shapes != 0, {cycles_a_row[0], cycles_a_row[1]}, scale, dark};
    Place grid[2][MOST_ALONG]; /* 170 kB of the stack, with what follows */
    float line[MOST_ALONG * DENSE];
    Products products;
    double matrix[MOST_UNKNOWN * MOST_UNKNOWN], step[MOST_UNKNOWN];
    if (places > MOST_ALONG || cells > MOST_CELLS) return 0;
    for (int i = 0; lens && i < 4; i++) { /* before the lens bends it a panel is a square */
        const double seen[2] = {corners[i].x, corners[i].y};
        double ray[2];
        ledpi_ray_of(lens, seen, ray);
        corners[i] = (Point){ray[0], ray[1]};
    }
    for (ptrdiff_t round = 0; round < rounds; round++) {
        double h[9], sums[2] = {0.0, 0.0};
        ptrdiff_t samples = 0;
        ledpi_unit_square_to(corners, h);
        for (int axis = 0; axis < 2; axis++)
            for (ptrdiff_t i = 0; i < places; i++)
                grid[axis][i] = place_at(along[i], cells, exp(unknown[BLUR]) / pitch_px[axis], unknown[GAP], unknown[RIM]);
        memset(&products, 0, sizeof products);
        for (ptrdiff_t j = 0; j < places; j++) {
            ptrdiff_t count = 0;
            for (ptrdiff_t i = 0; i < places; i++) {
                float *const dense = line + count * DENSE;
                Gains gains;
                for (int k = LEFT_COLUMN + 1; k < DENSE; k++) dense[k] = 0.0f;
                if (!sample(&panel, &view, h, unknown, &grid[0][i], &grid[1][j], along[i] / (double)cells,
                            along[j] / (double)cells, dense, &gains, sums))
                    continue;
                add_gains(&products, &gains, dense);
                count++;
            }
            ledpi_add_products(line, count, DENSE, products.dense);
            samples += count;
        }
        double variance = fmax(sums[0] / (double)(samples > 0 ? samples : 1), 1e-9);
        result[0] = 1.0 - sums[0] / fmax(sums[1], 1e-9), result[1] = (double)samples, result[2] = variance;
        for (ptrdiff_t i = 0; i < size; i++) {
            for (ptrdiff_t j = 0; j <= i; j++) matrix[i * size + j] = product_of(&products, size, i, j) / variance;
            matrix[i * size + i] = matrix[i * size + i] * (1.0 + 1e-6) + 1e-6 + prior[size + i];
            step[i] = product_of(&products, size, size, i) / variance + prior[size + i] * (i < WAYS ? 0.0 : prior[i] - unknown[i]);
        }
        if (samples <= size || !solve(matrix, size, step)) return 0;
        double most = 0.0, usual = 0.0;
        for (int i = 0; i < WAYS; i++) most = fmax(most, fabs(step[i]));
        double share = most > MOST_STEP ? MOST_STEP / most : 1.0;
        for (ptrdiff_t i = 0; i < size; i++) step[i] *= share;
        move(corners, h, step, 1.0);
        for (ptrdiff_t i = WAYS; i < size; i++) unknown[i] += step[i];
        for (ptrdiff_t i = 0; i < cells * cells; i++) usual += unknown[GAIN + i] / (double)(cells * cells);
        for (ptrdiff_t i = 0; i < cells * cells; i++)
            unknown[GAIN + i] = fmax(unknown[GAIN + i], LEAST_GAIN * usual);
        unknown[BLUR] = fmin(fmax(unknown[BLUR], log(LEAST_BLUR_PX)), log(MOST_BLUR_PX));
        unknown[GAP] = fmin(fmax(unknown[GAP], 0.0), MOST_GAP);
        unknown[RIM] = fmin(fmax(unknown[RIM], -0.5 * MOST_GAP), 0.5 * MOST_GAP);
        unknown[LONGER] = fmin(fmax(unknown[LONGER], -MOST_LONGER), MOST_LONGER);
        unknown[SMOOTHER] = fmin(fmax(unknown[SMOOTHER], -MOST_SMOOTHER), MOST_SMOOTHER);
        if ((round > 0 && most < SETTLED) || round == rounds - 1) { /* the first is with gains as they usually are */
            const double rim = unknown[RIM];
            const bool is_rim = rim * fmin(pitch_px[0], pitch_px[1]) * shrink >= NO_RIM_WALL_PX;
            if (!is_rim) close_rim(matrix, size, corners, unknown);
            deviations(matrix, size, cells, h, 1.0 - 2.0 * unknown[RIM] / (double)cells, is_rim ? 0.0 : rim, result + 3);
            for (int i = 3; lens && i < 5; i++) result[i] *= lens->fx;
            break;
        }
    }
    double lattice[9];
    ledpi_unit_square_to(corners, lattice);
    move(corners, lattice, (double[WAYS]){0.0}, 1.0 - 2.0 * unknown[RIM] / (double)cells);
    for (int i = 0; lens && i < 4; i++) {
        double seen[2];
        ledpi_distort(lens, corners[i].x, corners[i].y, seen);
        corners[i] = (Point){seen[0], seen[1]};
    }
    return 1;
}
