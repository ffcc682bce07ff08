/* How much lattices of blinking cells explain of the light around a square: `explains` of decode/band_light.py. */
#include <math.h>

#include "kernels.h"

#define AS_A_SQUARE 0.5 /* as in decode/band_light.py, and the next */
#define UNKNOWN (-0.3f)

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
