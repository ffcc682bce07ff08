/* Squares of lattices of cells: on each picture of a pyramid what is brighter than around it, its blobs (blobs.c), their
 * lattices (lattices.c), and the panels that these may be the cells of, or the LEDs in them. */
#include <math.h>
#include <string.h>

#include "find.h"
#include "normal.h"
#include "simd.h"

/* Half the neighbourhoods, less their middle, that a pixel is compared with: one shows cells of a third to all of its width.
 * Before a bright wall only the smaller one ends within the panel. Pictures are an octave apart: what the larger one would show in
 * the first of them, the smaller one does in the next. Powers of 2. */
static const ptrdiff_t AROUND[] = {8, 4};
enum { WIDEST = 8, PAD = 16 };
#define CONTRAST 4 /* grey levels: twice what read-out noise leaves of a mean over a few pixels */
#define MIN_SEEN 0.6 /* share of the cells: others may be dead, hidden, or one with their neighbours */
#define MIN_FULL 0.5 /* share of a cell's area: walls of up to a fifth of a cell, and what blur takes of it at either side */
enum { MOST_LEDS = 3 }; /* along a cell: each may be seen by itself */
enum { PASSES = 3 }; /* in which a homography's weights settle */
enum { BESIDE = 2 }; /* rows of other spots that may continue a lattice of cells: one on each side */
enum { MOST_PIECES = 40000, MOST_BLOBS = 1500, MOST_LATTICES = 400 }; /* in a picture: what has more is texture */
enum { SPAN_NODES = LEDPI_LATTICE_SPAN * LEDPI_LATTICE_SPAN, TABLE = LEDPI_LATTICE_SPAN + 1, NUMBERS = 8 };

/* Each of `count` sums and the one `on` further. */
static inline void add(const uint16_t *restrict sums, ptrdiff_t on, ptrdiff_t count, uint16_t *restrict into) {
    const uint16_t *const further = sums + on;
    for (ptrdiff_t i = 0; i < count; i++) into[i] = (uint16_t)(sums[i] + further[i]);
}

static inline void change(const uint8_t *restrict in, const uint8_t *restrict out, ptrdiff_t count, uint16_t *restrict sums) {
    for (ptrdiff_t i = 0; i < count; i++) sums[i] = (uint16_t)(sums[i] + in[i] - out[i]);
}

/* Binarizes a row (`lit`): `area` times a pixel is more than the sum around it and `least`; halves where sums are. */
static inline void compare(const uint8_t *restrict row, const uint16_t *restrict sums, const uint16_t *restrict last, ptrdiff_t count,
                           uint16_t area, uint16_t least, bool halved, uint8_t *restrict lit) {
    if (halved)
        for (ptrdiff_t i = 0; i < count; i++)
            lit[i] = (uint16_t)(area / 2 * row[i] + row[i] / 2) > (uint16_t)(sums[i] + last[i] + least) ? 255 : 0;
    else
        for (ptrdiff_t i = 0; i < count; i++)
            lit[i] = (uint16_t)(area * row[i]) > (uint16_t)(sums[i] + last[i] + least) ? 255 : 0;
}

/* Binarizes (`lit` (height, width), 0 or 255): brighter by CONTRAST than the mean of the pixels up to `reach` to either side; those
 * of the border count for what is beyond. Sums are of columns, then of rows; halves, of many, so that 16 bits hold them.
 * `room` (4, width + 2 PAD). */
LEDPI_SIMD_BYTES static void put_lit(const PyramidPicture *from, ptrdiff_t reach, uint16_t *room, uint8_t *lit) {
    const ptrdiff_t width = from->width, height = from->height, stride = width + 2 * PAD, side = 2 * reach + 1;
    const bool halved = side * side * 255 > UINT16_MAX;
    uint16_t *const columns = room + PAD, *const padded = room + stride, *one = padded + stride, *other = one + stride;
    const uint16_t area = (uint16_t)(side * side), least = (uint16_t)(CONTRAST * area / (halved ? 2 : 1));
    memset(room, 0, sizeof(uint16_t) * (size_t)(4 * stride));
    for (ptrdiff_t k = -reach; k <= reach; k++) {
        const ptrdiff_t y = k < 0 ? 0 : k < height ? k : height - 1;
        for (ptrdiff_t x = 0; x < width; x++) columns[x] = (uint16_t)(columns[x] + from->pixels[y * width + x]);
    }
    for (ptrdiff_t y = 0; y < height; y++) {
        for (ptrdiff_t x = 0; x < width; x++) padded[reach + x] = halved ? columns[x] / 2 : columns[x];
        for (ptrdiff_t k = 0; k < reach; k++)
            padded[k] = padded[reach], padded[reach + width + k] = padded[reach + width - 1];
        add(padded, 1, width + 2 * reach, one);
        for (ptrdiff_t on = 2; on < 2 * reach; on *= 2) { /* pairs, pairs of pairs … */
            add(one, on, width + 2 * reach, other);
            uint16_t *const done = one;
            one = other, other = done;
        }
        compare(from->pixels + y * width, one, padded + 2 * reach, width, area, least, halved, lit + y * width);
        const ptrdiff_t comes = y + reach + 1 < height ? y + reach + 1 : height - 1, goes = y > reach ? y - reach : 0;
        change(from->pixels + comes * width, from->pixels + goes * width, width, columns);
    }
}

/* Nodes of a lattice, and where they are seen; both about their mean, in deviations. */
typedef struct {
    ptrdiff_t count, node[2][SPAN_NODES], low[2], high[2];
    double at[2][SPAN_NODES], mean[2][2], spread[2]; /* mean: of nodes, of places; spread likewise */
    double seen[TABLE][TABLE], area[TABLE][TABLE]; /* sums over the nodes before a row and a column: of 1, of their area */
} Nodes;

static void put_nodes(const int32_t *lattice, const Blob *blobs, Nodes *n) {
    double squares[2] = {0.0, 0.0}, sums[2][2] = {{0.0}};
    n->count = 0;
    for (int axis = 0; axis < 2; axis++) n->low[axis] = LEDPI_LATTICE_SPAN, n->high[axis] = -1;
    for (ptrdiff_t j = 0; j < LEDPI_LATTICE_SPAN; j++) {
        double seen = 0.0, area = 0.0;
        for (ptrdiff_t i = 0; i < LEDPI_LATTICE_SPAN; i++) {
            const int32_t blob = lattice[j * LEDPI_LATTICE_SPAN + i];
            if (blob >= 0) {
                const ptrdiff_t node[2] = {i, j};
                const double at[2] = {blobs[blob].x, blobs[blob].y};
                for (int axis = 0; axis < 2; axis++) {
                    n->node[axis][n->count] = node[axis], n->at[axis][n->count] = at[axis];
                    n->low[axis] = node[axis] < n->low[axis] ? node[axis] : n->low[axis];
                    n->high[axis] = node[axis] > n->high[axis] ? node[axis] : n->high[axis];
                    sums[0][axis] += (double)node[axis], sums[1][axis] += at[axis];
                }
                n->count++, seen += 1.0, area += blobs[blob].area;
            }
            n->seen[j + 1][i + 1] = n->seen[j][i + 1] + seen, n->area[j + 1][i + 1] = n->area[j][i + 1] + area;
        }
    }
    for (int of = 0; of < 2; of++)
        for (int axis = 0; axis < 2; axis++) n->mean[of][axis] = sums[of][axis] / (double)n->count;
    for (ptrdiff_t k = 0; k < n->count; k++)
        for (int axis = 0; axis < 2; axis++) {
            const double node = (double)n->node[axis][k] - n->mean[0][axis], at = n->at[axis][k] - n->mean[1][axis];
            squares[0] += node * node, squares[1] += at * at;
        }
    for (int of = 0; of < 2; of++) n->spread[of] = sqrt(squares[of] / (double)(2 * n->count)) + 1e-9;
}

/* Some rows and columns of a lattice: the first of `side` each. */
typedef struct {
    ptrdiff_t first[2], side;
} Part;

static bool is_in(const Nodes *n, const Part *part, ptrdiff_t k) {
    for (int axis = 0; axis < 2; axis++)
        if (n->node[axis][k] < part->first[axis] || n->node[axis][k] >= part->first[axis] + part->side) return false;
    return true;
}

enum { PRODUCTS = 6 }; /* uu, uv, u, vv, v, 1: those that u, v and 1 have */

/* Adds up over a part's nodes these products, each times its weight and 1, x, y, x² + y² of where it is seen. */
static void add_products(const Nodes *n, const Part *part, const double h[NUMBERS], double sums[4][PRODUCTS]) {
    for (ptrdiff_t k = 0; k < n->count; k++) {
        if (!is_in(n, part, k)) continue;
        const double u = ((double)n->node[0][k] - n->mean[0][0]) / n->spread[0], v = ((double)n->node[1][k] - n->mean[0][1]) / n->spread[0];
        const double x = (n->at[0][k] - n->mean[1][0]) / n->spread[1], y = (n->at[1][k] - n->mean[1][1]) / n->spread[1];
        const double depth = h[6] * u + h[7] * v + 1.0, weight = 1.0 / fmax(depth * depth, 1e-6);
        const double products[PRODUCTS] = {u * u, u * v, u, v * v, v, 1.0}, of[4] = {weight, weight * x, weight * y, weight * (x * x + y * y)};
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < PRODUCTS; j++) sums[i][j] += of[i] * products[j];
    }
}

/* The homography (8 numbers, and 1) of least error in the picture from a part's nodes to where they are seen, both in
 * deviations about their means. The algebraic error (Hartley and Zisserman, Multiple View Geometry, 4.1) over a point's depth
 * is the geometric one, and depths are known after a first pass. A node's rows are (u, v, 1, 0, 0, 0, -xu, -xv | x) and
 * (0, 0, 0, u, v, 1, -yu, -yv | y). */
static bool put_homography(const Nodes *n, const Part *part, double h[NUMBERS]) {
    static const int product[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    enum { ROW = NUMBERS + 1 };
    for (int k = 0; k < NUMBERS; k++) h[k] = 0.0;
    for (int pass = 0; pass < PASSES; pass++) {
        double matrix[NUMBERS * ROW] = {0.0}, sums[4][PRODUCTS] = {{0.0}};
        add_products(n, part, h, sums);
        for (int axis = 0; axis < 2; axis++)
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    matrix[(3 * axis + i) * ROW + 3 * axis + j] = sums[0][product[i][j]];
                    matrix[(3 * axis + i) * ROW + 6 + j] = (j < 2 ? -1.0 : 1.0) * sums[1 + axis][product[i][j]];
                }
        for (int i = 0; i < 2; i++)
            for (int j = 0; j < 3; j++) matrix[(6 + i) * ROW + 6 + j] = (j < 2 ? 1.0 : -1.0) * sums[3][product[i][j]];
        ledpi_eliminate(matrix, NUMBERS, 0, NUMBERS);
        for (int i = 0; i < NUMBERS; i++)
            if (!(matrix[i * (NUMBERS + 2)] > 0.0)) return false;
        ledpi_solve(matrix, NUMBERS, h);
    }
    return true;
}

/* Puts where a part's corners are seen, clockwise, a pixel being `scale` of the frame's. False where it reaches beyond the
 * horizon. */
static bool put_corners(const Nodes *n, const Part *part, double scale, double corners[4][2]) {
    static const double right[4] = {0.0, 1.0, 1.0, 0.0}, lower[4] = {0.0, 0.0, 1.0, 1.0};
    double h[NUMBERS];
    if (!put_homography(n, part, h)) return false;
    for (int i = 0; i < 4; i++) {
        const double side = (double)part->side;
        const double u = ((double)part->first[0] - 0.5 + side * right[i] - n->mean[0][0]) / n->spread[0];
        const double v = ((double)part->first[1] - 0.5 + side * lower[i] - n->mean[0][1]) / n->spread[0];
        const double depth = h[6] * u + h[7] * v + 1.0;
        if (!(depth > 0.0)) return false;
        for (int axis = 0; axis < 2; axis++) {
            const double at = (h[3 * axis] * u + h[3 * axis + 1] * v + h[3 * axis + 2]) / depth;
            corners[i][axis] = (n->mean[1][axis] + n->spread[1] * at + 0.5) * scale - 0.5;
        }
    }
    const double *a = corners[0], *b = corners[1], *c = corners[2], *d = corners[3];
    if ((c[0] - a[0]) * (d[1] - b[1]) - (d[0] - b[0]) * (c[1] - a[1]) > 0.0) return true;
    for (int i = 0; i < 2; i++)
        for (int axis = 0; axis < 2; axis++) {
            const double kept = corners[i][axis];
            corners[i][axis] = corners[3 - i][axis], corners[3 - i][axis] = kept;
        }
    return true;
}

static ptrdiff_t within_span(ptrdiff_t node) { return node < 0 ? 0 : node > LEDPI_LATTICE_SPAN ? LEDPI_LATTICE_SPAN : node; }

/* Sum over a part, by a table of sums over all before each row and column. */
static double sum_in(double table[TABLE][TABLE], const Part *part) {
    const ptrdiff_t left = within_span(part->first[0]), right = within_span(part->first[0] + part->side);
    const ptrdiff_t top = within_span(part->first[1]), bottom = within_span(part->first[1] + part->side);
    return (table[bottom][right] - table[bottom][left]) - (table[top][right] - table[top][left]);
}

/* Tells whether cells of this area, in pixels of `scale`, fill a panel with these corners but for their walls. */
static bool are_full(double area, ptrdiff_t seen, ptrdiff_t side, double scale, double corners[4][2]) {
    const double *a = corners[0], *b = corners[1], *c = corners[2], *d = corners[3];
    const double all = 0.5 * ((c[0] - a[0]) * (d[1] - b[1]) - (d[0] - b[0]) * (c[1] - a[1])) / (scale * scale);
    return area * (double)(side * side) > MIN_FULL * all * (double)seen;
}

/* Adds the corners of each panel that a lattice of its cells, or of the LEDs in them, may be: several where rows are not seen, or
 * where something continues them. Of a panel before what is as bright only the inner cells may be seen, as nothing parts the others
 * from it; these are full then. A larger lattice of LEDs is none: it has so many rows that chance continues none of them.
 * Returns how many. */
static ptrdiff_t add_panels(Nodes *n, ptrdiff_t cells, double scale, ptrdiff_t most, double (*found)[4][2]) {
    ptrdiff_t count = 0;
    for (ptrdiff_t leds = 1; leds <= MOST_LEDS; leds++) {
        const ptrdiff_t side = cells * leds, few = side + (leds == 1 ? BESIDE : 0), inner = leds == 1 ? cells - 2 : side;
        ptrdiff_t from[2], to[2];
        for (int axis = 0; axis < 2; axis++) {
            const ptrdiff_t low = n->low[axis], end = n->high[axis] - side + 1;
            from[axis] = low < end ? low : end;
            to[axis] = n->high[axis] - low < few ? (low < end ? end : low) : from[axis] - 1;
        }
        for (ptrdiff_t x = from[0]; x <= to[0]; x++)
            for (ptrdiff_t y = from[1]; y <= to[1]; y++) {
                const Part part = {{x, y}, side}, within = {{x + 1, y + 1}, inner};
                const bool is_seen = sum_in(n->seen, &part) >= MIN_SEEN * (double)(side * side);
                if (!is_seen && sum_in(n->seen, &within) < (double)(inner * inner)) continue;
                if (count == most || !put_corners(n, &part, scale, found[count])) continue;
                count += is_seen || are_full(sum_in(n->area, &within), inner * inner, side, scale, found[count]);
            }
    }
    return count;
}

typedef struct {
    BlobPiece pieces[MOST_PIECES];
    Blob blobs[MOST_BLOBS];
    uint8_t used[MOST_BLOBS];
    int32_t lattices[MOST_LATTICES][SPAN_NODES];
    Nodes nodes; /* the tables' first rows and columns stay zeros */
} BlobRoom;

static ptrdiff_t room_of(ptrdiff_t height, ptrdiff_t width, ptrdiff_t *runs, ptrdiff_t *sums, ptrdiff_t *lit) {
    *runs = (ptrdiff_t)sizeof(BlobRoom);
    *sums = *runs + (ptrdiff_t)sizeof(BlobRun) * 2 * width;
    *lit = *sums + (ptrdiff_t)sizeof(uint16_t) * 4 * (width + 2 * PAD);
    return *lit + height * width;
}

ptrdiff_t ledpi_lattice_room(ptrdiff_t height, ptrdiff_t width) {
    ptrdiff_t runs, sums, lit;
    return room_of(height, width, &runs, &sums, &lit);
}

/* Corners (most, 4, 2) in the frame of panels of `cells` × `cells` that `pictures` (count) may show. Returns how many. */
ptrdiff_t ledpi_lattice_squares(const PyramidPicture *pictures, ptrdiff_t count, ptrdiff_t cells, uint8_t *room, ptrdiff_t most,
                                double *corners) {
    double (*const found)[4][2] = (double (*)[4][2])corners;
    BlobRoom *const own = (BlobRoom *)room;
    ptrdiff_t squares = 0, runs_at, sums_at, lit_at;
    room_of(pictures->height, pictures->width, &runs_at, &sums_at, &lit_at);
    BlobRun *const runs = (BlobRun *)(room + runs_at);
    uint8_t *const lit = room + lit_at;
    memset(&own->nodes, 0, sizeof own->nodes);
    for (ptrdiff_t level = 0; level < count; level++)
        for (size_t around = level ? 0 : 1; around < sizeof AROUND / sizeof *AROUND; around++) {
            const PyramidPicture *const seen = pictures + level;
            const double width = 2.0 * (double)AROUND[around] + 1.0;
            put_lit(seen, AROUND[around], (uint16_t *)(room + sums_at), lit);
            const ptrdiff_t blobs = ledpi_blobs(lit, seen->height, seen->width, 2.0 * width * width, runs, MOST_PIECES, own->pieces,
                                                MOST_BLOBS, own->blobs);
            const ptrdiff_t lattices = ledpi_lattices(own->blobs, blobs, (cells - 2) * (cells - 2), own->used,
                                                      MOST_LATTICES, own->lattices[0]);
            for (ptrdiff_t k = 0; k < lattices; k++) {
                put_nodes(own->lattices[k], own->blobs, &own->nodes);
                squares += add_panels(&own->nodes, cells, (double)(1 << level), most - squares, found + squares);
            }
        }
    return squares;
}
