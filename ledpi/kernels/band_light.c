/* What the light around a square says of blinking cells there: `explains` and `Bands.at` of decode/striped/band_light.py. */
#include <math.h>
#include <string.h>

#include "kernels.h"

#define AS_A_SQUARE 0.5 /* as in decode/striped/band_light.py, and the next */
#define UNKNOWN (-0.3f)
#define EVEN 0.85f
#define DARK 0.05
#define BRIGHT 0.9
#define SURE_POINTS 1.0f
enum { PHASES = 32, STEPS = 512, EACH = STEPS / PHASES, LOOKS = 2, MOST_CELLS = 64, MOST_POINTS = 64 };

/* Relative light (rows, columns) of a part of the picture, and what either class shows there (2, rows). */
typedef struct {
    const float *light, *shown;
    ptrdiff_t rows, columns;
} Bands;

/* Points (cells, points): places across and down the panel, and the share of it that each stands for: of a cell, a wall. */
typedef struct {
    ptrdiff_t cells, points;
    const float *across, *down, *of_cells, *of_walls;
} Lattice;

/* What a pixel gains as part of a cell of either class: seen[k] − expected[k]. */
static inline void gains_at(const Bands *bands, float x, float y, float seen[2], float expected[2]) {
    if (!(x >= 0.0f && y >= 0.0f && x <= (float)(bands->columns - 1) && y <= (float)(bands->rows - 1))) {
        seen[0] = seen[1] = UNKNOWN, expected[0] = expected[1] = 0.0f;
        return;
    }
    float right, down;
    ptrdiff_t column = ledpi_before(x, bands->columns, &right), row = ledpi_before(y, bands->rows, &down);
    const float *above = bands->light + row * bands->columns + column, *below = above + bands->columns;
    float upper = above[0] + right * (above[1] - above[0]), lower = below[0] + right * (below[1] - below[0]);
    float light = upper + down * (lower - upper);
    for (int k = 0; k < 2; k++) {
        const float *shown = bands->shown + k * bands->rows + row;
        float of_class = shown[0] + down * (shown[1] - shown[0]);
        seen[k] = 2.0f * of_class * light;
        expected[k] = of_class * of_class;
    }
}

/* By how much depth across a quad differs from that of a square foreshortened as it is: `unlike_a_square`. `depth`: change
 * of relative depth over the quad, across and down. */
static double unlike_a_square(const Point c[4], double g, double h, double focal_px) {
    double across[2] = {0.5 * (c[1].x + c[2].x - c[0].x - c[3].x), 0.5 * (c[1].y + c[2].y - c[0].y - c[3].y)};
    double down[2] = {0.5 * (c[3].x + c[2].x - c[0].x - c[1].x), 0.5 * (c[3].y + c[2].y - c[0].y - c[1].y)};
    double middle = 1.0 + 0.5 * (g + h), u = across[0] * across[0] + across[1] * across[1];
    double v = down[0] * down[0] + down[1] * down[1], both = across[0] * down[0] + across[1] * down[1];
    double expected = sqrt(hypot(u - v, 2.0 * both)) / focal_px, angle = 0.5 * atan2(2.0 * both, u - v);
    double x = -expected * sin(angle), y = expected * cos(angle); /* the way, in the square, in which it is shorter */
    return fmin(hypot(g / middle - x, h / middle - y), hypot(g / middle + x, h / middle + y));
}

static double explained(const Bands *bands, const Lattice *lattice, const Point c[4], double focal_px) {
    Point far = {c[1].x - c[2].x, c[1].y - c[2].y}, near = {c[3].x - c[2].x, c[3].y - c[2].y};
    Point all = {c[0].x - c[1].x + c[2].x - c[3].x, c[0].y - c[1].y + c[2].y - c[3].y};
    double det = far.x * near.y - far.y * near.x;
    double g = (all.x * near.y - all.y * near.x) / det, h = (far.x * all.y - far.y * all.x) / det;
    float gf = (float)g, hf = (float)h, x0 = (float)c[0].x, y0 = (float)c[0].y;
    float xu = (float)(c[1].x - c[0].x + g * c[1].x), xv = (float)(c[3].x - c[0].x + h * c[3].x);
    float yu = (float)(c[1].y - c[0].y + g * c[1].y), yv = (float)(c[3].y - c[0].y + h * c[3].y);
    double total = 0.0, of_walls = 0.0, of_lit_walls = 0.0, nearness = 0.0;
    const ptrdiff_t points = lattice->points;
    for (ptrdiff_t cell = 0, i = 0; cell < lattice->cells; cell++) {
        float of_class[2] = {0.0f, 0.0f}, wall_seen[2] = {0.0f, 0.0f}, wall_expected[2] = {0.0f, 0.0f}, sum = 0.0f;
        for (ptrdiff_t end = i + points; i < end; i++) {
            float u = lattice->across[i], v = lattice->down[i], inverse = 1.0f / (gf * u + hf * v + 1.0f);
            float nearer = inverse * inverse * inverse, seen[2], expected[2]; /* of the picture's area */
            gains_at(bands, (xu * u + xv * v + x0) * inverse, (yu * u + yv * v + y0) * inverse, seen, expected);
            float open = nearer * lattice->of_cells[i], wall = nearer * lattice->of_walls[i];
            for (int k = 0; k < 2; k++) {
                of_class[k] += open * (seen[k] - expected[k]);
                wall_seen[k] += wall * seen[k];
                wall_expected[k] += wall * expected[k];
            }
            sum += nearer;
        }
        int own = of_class[1] > of_class[0];
        total += of_class[own];
        of_walls += wall_seen[own];
        of_lit_walls += wall_expected[own];
        nearness += sum;
    }
    double area = fabs(ledpi_area(c)), scale = area * (double)(lattice->cells * points) / nearness;
    double share = fmin(fmax(0.5 * of_walls / fmax(of_lit_walls, 1e-9), 0.0), 1.0);
    double off = unlike_a_square(c, g, h, focal_px);
    return scale * (total + share * of_walls - share * share * of_lit_walls) - AS_A_SQUARE * area * off * off;
}

/* Into `worth` (quads,): how much a lattice in each of the corners (quads, 4) explains; −∞ where it is nowhere. */
void ledpi_lattices_explain(const float *light, const float *shown, ptrdiff_t rows, ptrdiff_t columns, ptrdiff_t cells,
                            ptrdiff_t points, const float *across, const float *down, const float *of_cells,
                            const float *of_walls, double focal_px, ptrdiff_t quads, const Point *corners, double *worth) {
    const Bands bands = {light, shown, rows, columns};
    const Lattice lattice = {cells, points, across, down, of_cells, of_walls};
    for (ptrdiff_t i = 0; i < quads; i++) {
        worth[i] = explained(&bands, &lattice, corners + 4 * i, focal_px);
        if (!isfinite(worth[i])) worth[i] = -INFINITY;
    }
}

/* The share-th quantile of `numbers` (count,), between the nearest two; puts them into another order. */
static double quantile(double *numbers, ptrdiff_t count, double share) {
    double at = share * (double)(count - 1);
    ptrdiff_t before = (ptrdiff_t)at, next = before + 1 < count ? before + 1 : before;
    double low = ledpi_kth(numbers, count, before), high = ledpi_kth(numbers, count, next);
    return low + (at - (double)before) * (high - low);
}

/* A period's table (STEPS,) as rows (EACH, 2·PHASES): from entry b on, each later phase next to the one before. */
static void spread(const float *table, float *rows) {
    for (int rest = 0; rest < EACH; rest++)
        for (int phase = 0; phase < 2 * PHASES; phase++)
            rows[rest * 2 * PHASES + phase] = table[phase % PHASES * EACH + rest];
}

static inline int step_of(double row, double a_row, double before) {
    const double cycles = before + row * a_row;
    return (int)((cycles - floor(cycles)) * STEPS) % STEPS;
}

/* Into `gain` (cells, PHASES): what each cell explains as one of this class, in each phase, with a `profile` (points,) and
 * a gain of its own. */
static void gains_of(const Lattice *lattice, const float *profile, const float *table, const double *rows,
                     const float *light, double a_row, double before, float *gain) {
    const float sure = SURE_POINTS / (float)(lattice->cells * lattice->points);
    float shown[EACH * 2 * PHASES];
    spread(table, shown);
    for (ptrdiff_t cell = 0, i = 0; cell < lattice->cells; cell++, gain += PHASES) {
        float seen[PHASES] = {0.0f}, lit[PHASES] = {0.0f};
        for (ptrdiff_t point = 0; point < lattice->points; point++, i++) {
            const int step = step_of(rows[i], a_row, before);
            const float *of_phase = shown + step % EACH * 2 * PHASES + step / EACH;
            const float share = lattice->of_cells[i] * profile[point], of_light = share * light[i];
            const float of_lit = share * profile[point];
            for (int phase = 0; phase < PHASES; phase++) {
                seen[phase] += of_light * of_phase[phase];
                lit[phase] += of_lit * of_phase[phase] * of_phase[phase];
            }
        }
        for (int phase = 0; phase < PHASES; phase++)
            gain[phase] = (seen[phase] + sure) * (seen[phase] + sure) / (lit[phase] + sure) - sure;
    }
}

/* Into `profile` (points,): the relative light that cells have in common, which show these `phases` of `tables`. */
static void put_profile(const Lattice *lattice, const float *tables, const double *rows, const float *light,
                        const double *a_row, const double *before, const int *phases, const uint8_t *is_white,
                        float *profile) {
    const float sure = SURE_POINTS / (float)(lattice->cells * lattice->points);
    for (ptrdiff_t point = 0; point < lattice->points; point++) {
        float seen = EVEN * sure, lit = sure;
        for (ptrdiff_t cell = 0; cell < lattice->cells; cell++) {
            const ptrdiff_t i = cell * lattice->points + point, own = is_white[cell] != 0;
            const int step = (step_of(rows[i], a_row[own], before[own]) + phases[own] * EACH) % STEPS;
            const float of_class = tables[own * STEPS + step];
            seen += lattice->of_cells[i] * light[i] * of_class;
            lit += lattice->of_cells[i] * of_class * of_class;
        }
        profile[point] = seen / lit;
    }
}

/* The pair of phases in which all cells together explain most, each as that class in which it does. */
static float best_phases(ptrdiff_t cells, const float *black, const float *white, bool antiphase, int best[2]) {
    float most = -INFINITY;
    for (int of_black = 0; of_black < PHASES; of_black++) {
        float sums[PHASES] = {0.0f};
        for (ptrdiff_t cell = 0; cell < cells; cell++) {
            const float *of_cell = white + cell * PHASES, own = black[cell * PHASES + of_black];
            for (int phase = 0; phase < PHASES; phase++) sums[phase] += own > of_cell[phase] ? own : of_cell[phase];
        }
        for (int phase = 0; phase < PHASES; phase++)
            if (sums[phase] > most && (!antiphase || phase == (of_black + PHASES / 2) % PHASES))
                most = sums[phase], best[0] = of_black, best[1] = phase;
    }
    return most;
}

/* The bands that explain best what a square with these corners (4) shows, of those of several panels: `tables` (specs, 2,
 * STEPS), `cycles_a_row` (specs, 2) of the window, and in its row 0 (specs, 2); `antiphase` (specs,). What is brighter than
 * `most` times the bright level counts no more. `room`: 3 numbers a point. Into `found` (7,): dark and bright level, which
 * spec, both phases, the share of the light's squares that is explained, and the brightness of cells over the bright level;
 * into `is_white` (cells,) which are of the white class. False where nothing is bright enough. */
int ledpi_bands_at(const float *light, ptrdiff_t rows, ptrdiff_t columns, double darkest, double contrast, double most,
                   ptrdiff_t cells, ptrdiff_t points, const float *across, const float *down, const float *of_cells, ptrdiff_t specs,
                   const float *tables, const double *cycles_a_row, const double *cycles_before, const uint8_t *antiphase,
                   const Point *corners, double *room, double *found, uint8_t *is_white) {
    const Lattice lattice = {cells, points, across, down, of_cells, NULL};
    const ptrdiff_t count = cells * points;
    double h[9], *at_row = room, *sorted = room + count, energy = 0.0;
    float *relative = (float *)(room + 2 * count), gain[2][MOST_CELLS * PHASES], profile[MOST_POINTS];
    uint8_t white[MOST_CELLS];
    ledpi_unit_square_to(corners, h);
    for (ptrdiff_t i = 0; i < count; i++) {
        double u = across[i], v = down[i], w = h[6] * u + h[7] * v + h[8];
        double x = fmin(fmax((h[0] * u + h[1] * v + h[2]) / w + 0.5, 0.0), (double)(columns - 1));
        double y = fmin(fmax((h[3] * u + h[4] * v + h[5]) / w + 0.5, 0.0), (double)(rows - 1));
        ptrdiff_t row = y > 0.0 ? (ptrdiff_t)y : 0, column = x > 0.0 ? (ptrdiff_t)x : 0;
        at_row[i] = (double)row;
        sorted[i] = relative[i] = light[row * columns + column];
    }
    found[0] = quantile(sorted, count, DARK), found[1] = quantile(sorted, count, BRIGHT);
    if (!(found[1] > contrast * found[0]) || cells > MOST_CELLS || points > MOST_POINTS) return 0;
    found[0] = fmin(darkest, found[0]);
    for (ptrdiff_t i = 0; i < count; i++) {
        float n = (relative[i] - (float)found[0]) * (float)(1.0 / (found[1] - found[0]));
        relative[i] = n > (float)most ? (float)most : n > 0.0f ? n : 0.0f;
        energy += of_cells[i] * relative[i] * relative[i];
    }
    found[5] = -INFINITY;
    for (ptrdiff_t spec = 0; spec < specs; spec++, tables += 2 * STEPS, cycles_a_row += 2, cycles_before += 2) {
        int best[2] = {0, 0};
        float explained = 0.0f, level = 0.0f;
        for (ptrdiff_t point = 0; point < points; point++) profile[point] = EVEN;
        for (int look = 0; look < LOOKS; look++) {
            if (look) put_profile(&lattice, tables, at_row, relative, cycles_a_row, cycles_before, best, white, profile);
            for (int k = 0; k < 2; k++)
                gains_of(&lattice, profile, tables + k * STEPS, at_row, relative, cycles_a_row[k], cycles_before[k], gain[k]);
            explained = best_phases(cells, gain[0], gain[1], antiphase[spec], best);
            for (ptrdiff_t cell = 0; cell < cells; cell++)
                white[cell] = gain[1][cell * PHASES + best[1]] > gain[0][cell * PHASES + best[0]];
        }
        if (!(explained / fmax(energy, 1e-9) > found[5])) continue;
        for (ptrdiff_t point = 0; point < points; point++) level += profile[point] / (float)points;
        found[2] = (double)spec, found[3] = best[0], found[4] = best[1], found[5] = explained / fmax(energy, 1e-9);
        found[6] = level;
        memcpy(is_white, white, (size_t)cells);
    }
    return 1;
}
