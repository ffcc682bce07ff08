/* From corners nearby to a lit square's own, or why there is none: decode/corners/edges.py, one quad after the other. */
#include <math.h>

#include "lattice.h"
#include "quads.h"

/* In this order in kernels/edges.py. */
typedef enum { WHOLE, PARTLY_HIDDEN, NO_EDGE, NOT_STRAIGHT, NOT_WHOLE, NOT_CONVEX, TOO_SMALL, AT_BORDER } Outcome;

/* A row there: the square's corners, those of what is seen of it, the corners' deviation and what all sides share of that,
 * how far the lens bends it, and how far beyond it the lattice of its cells ends; whether its cells show, 1 or 0. */
typedef struct {
    Point corners[4], seen[4];
    double sigma_px, size_sigma_px, bend_px, rim_wall, cells_show;
} Refined;

/* The corners of a quad that lacks `hidden` of its panel, of the whole panel. */
static void uncover(const Point corners[4], double hidden[2][2], Point whole[4]) {
    double h[9], ends[2][2];
    for (int axis = 0; axis < 2; axis++) {
        const double seen = 1.0 - (hidden[axis][0] + hidden[axis][1]);
        ends[axis][0] = -hidden[axis][0] / seen, ends[axis][1] = 1.0 + hidden[axis][1] / seen;
    }
    ledpi_unit_square_to(corners, h);
    for (int k = 0; k < 4; k++) {
        const double u = ends[0][k == 1 || k == 2], v = ends[1][k >= 2], w = h[6] * u + h[7] * v + h[8];
        whole[k] = (Point){(h[0] * u + h[1] * v + h[2]) / w, (h[3] * u + h[4] * v + h[5]) / w};
    }
}

/* Whether a quad has the shape of a square, and is wholly in the picture: `outcome` then, else why not. */
static Outcome checked(const Picture *picture, const Refining *by, const Point c[4], Outcome outcome) {
    for (int k = 0; k < 4; k++) {
        const Point *before = &c[(k + 3) & 3], *here = &c[k], *next = &c[(k + 1) & 3];
        const double turn = (here->x - before->x) * (next->y - here->y) - (here->y - before->y) * (next->x - here->x);
        if (!(turn > 0.0)) return NOT_CONVEX; /* also where a corner is not finite */
    }
    if (ledpi_area(c) < by->min_side_px * by->min_side_px) return TOO_SMALL;
    const double right = (double)picture->width - 1.0 - by->border_px, bottom = (double)picture->height - 1.0 - by->border_px;
    for (int k = 0; k < 4; k++)
        if (c[k].x < by->border_px || c[k].y < by->border_px || c[k].x > right || c[k].y > bottom) return AT_BORDER;
    return outcome;
}

static Outcome refine(const Picture *picture, const Tables *tables, const Lens *lens, const Point near[4], Refined *into,
                      Missing *missing) {
    const Refining *const by = tables->refining;
    const double side_px = sqrt(fabs(ledpi_area(near))), cells = (double)tables->cells;
    double bends[16] = {0.0}, hidden[2][2];
    Found found;
    if (lens) ledpi_bends(lens, 1, &near[0].x, bends);
    ledpi_find_sides(picture, tables, near, bends, &found, missing);
    if (missing->filter) return NO_EDGE;
    if (!found.seen || !(ledpi_farthest(found.corners, near) < by->max_move * side_px)) return NO_EDGE;
    if (!(found.spread_px <= by->max_spread_px && found.used >= by->min_used)) return NOT_STRAIGHT;
    into->cells_show = ledpi_hidden(picture, tables, found.corners, bends, hidden, missing);
    if (missing->explanations) return NO_EDGE;
    into->sigma_px = found.sigma_px, into->size_sigma_px = found.size_sigma_px;
    into->bend_px = into->rim_wall = 0.0;
    double lacks = 0.0; /* half a wall at the rim, about */
    for (int axis = 0; axis < 2; axis++)
        if (hidden[axis][0] == hidden[axis][1] && hidden[axis][0] > 0.0 && hidden[axis][0] < by->no_rim_wall) {
            lacks = fmax(lacks, by->rim_wall * hidden[axis][0]);
            hidden[axis][0] = hidden[axis][1] = 0.0;
        }
    for (int k = 0; k < 8; k++) into->bend_px = fmax(into->bend_px, fabs(bends[2 * k + 1]));
    for (int k = 0; k < 4; k++) into->corners[k] = into->seen[k] = found.corners[k];
    if (hidden[0][0] != 0.0 || hidden[0][1] != 0.0 || hidden[1][0] != 0.0 || hidden[1][1] != 0.0) {
        if (!isfinite(hidden[0][0] + hidden[0][1] + hidden[1][0] + hidden[1][1])) return NOT_WHOLE;
        uncover(found.corners, hidden, into->corners);
        into->sigma_px += by->hidden_sigma * side_px;
        return checked(picture, by, into->corners, PARTLY_HIDDEN);
    }
    const Outcome outcome = checked(picture, by, into->corners, WHOLE);
    into->rim_wall = lacks;
    const double least_px = cells * by->min_pitch_px; /* nearer, lines blur into each other, and sides are better known */
    if (outcome != WHOLE || cells < by->least_cells || tables->cells > MOST_CELLS) return outcome;
    if (!(ledpi_area(found.corners) > least_px * least_px)) return outcome;
    Adjusted better;
    ledpi_adjust(picture, tables, found.corners, bends, lens, &better, missing);
    if (better.rim_wall > 0.0) into->rim_wall = better.rim_wall;
    if (!isfinite(better.sigma_px)) return outcome;
    for (int k = 0; k < 4; k++) into->corners[k] = better.corners[k];
    into->sigma_px = better.sigma_px, into->size_sigma_px = better.size_sigma_px;
    return outcome;
}

/* Of `quads` quads whose corners (quads, 4, 2) are `near`: what they are, and their `outcomes`. `lens` is NULL where it
 * bends nothing. False where something is `missing` that must be made first. */
bool ledpi_refine(const uint8_t *pixels, ptrdiff_t height, ptrdiff_t width, ptrdiff_t stride, const float *table,
                  const Tables *tables, const Lens *lens, ptrdiff_t quads, const Point *near, Refined *refined,
                  int32_t *outcomes, Missing *missing) {
    const Picture picture = {pixels, height, width, stride, table};
    *missing = (Missing){0, 0};
    for (ptrdiff_t i = 0; i < quads; i++) {
        outcomes[i] = refine(&picture, tables, lens, near + 4 * i, refined + i, missing);
        if (missing->filter || missing->explanations) return false;
    }
    return true;
}
