/* Lattices of blobs, seen from anywhere: a blob's own second moments say how its neighbourhood is foreshortened. Of cells
 * with the lattice's steps v and w these moments are proportional to v·vᵀ + w·wᵀ; where they are made a unit circle's, v and
 * w are as long, and at right angles. */
#include <math.h>
#include <string.h>

#include "find.h"

enum { LATTICE_SPAN = LEDPI_LATTICE_SPAN };

/* A step where the moments are a unit circle's: √12 of cells that are lit all over, more where only their middles are. */
#define NEAREST 2.6
#define FARTHEST 9.0
#define SQUARE 0.4 /* cosine of the angle between both steps, at most */
#define EVEN 1.8   /* the length of one over the other's, */
#define ALIKE 3.5  /* and the area of a blob over its neighbour's: hot spots, gains, perspective */
#define ASTRAY 0.3 /* steps, from where the next blob should be */

enum { NEAR = 12 }; /* neighbours that are looked at */

typedef struct {
    double x, y;
} Step;

static bool are_alike(const Blob *one, const Blob *other) {
    return one->area < ALIKE * other->area && other->area < ALIKE * one->area;
}

/* The first blob at y or below: they come from the top down. Halves are chosen without a branch, as none is likelier. */
static ptrdiff_t first_below(const Blob *blobs, ptrdiff_t count, double y) {
    ptrdiff_t first = 0;
    while (count > 1) {
        const ptrdiff_t half = count / 2;
        first += blobs[first + half - 1].y < y ? half : 0;
        count -= half;
    }
    return first + (count == 1 && blobs[first].y < y);
}

/* A neighbour, and where it is once a blob's moments are a unit circle's: how far, squared. */
typedef struct {
    const Blob *blob;
    double x, y, away2;
} Neighbour;

/* Neighbours of a blob, the nearest first. */
static ptrdiff_t neighbours_of(const Blob *blobs, ptrdiff_t count, const Blob *own, Neighbour near[NEAR]) {
    const double l = sqrt(own->xx), m = own->xy / l, r = sqrt(fmax(own->yy - m * m, 1e-6)), per_l = 1.0 / l, per_r = 1.0 / r;
    const double reach = FARTHEST * sqrt(fmax(own->xx, own->yy)), lowest = own->y + reach;
    ptrdiff_t found = 0;
    for (const Blob *at = blobs + first_below(blobs, count, own->y - reach), *end = blobs + count; at < end && at->y <= lowest; at++) {
        const double dx = at->x - own->x, dy = at->y - own->y;
        if (fabs(dx) > reach || !are_alike(at, own)) continue;
        const double x = dx * per_l, y = (dy - m * x) * per_r, away2 = x * x + y * y;
        if (away2 < NEAREST * NEAREST || away2 > FARTHEST * FARTHEST || (found == NEAR && away2 >= near[NEAR - 1].away2)) continue;
        ptrdiff_t k = found < NEAR ? found++ : NEAR - 1;
        for (; k > 0 && near[k - 1].away2 > away2; k--) near[k] = near[k - 1];
        near[k] = (Neighbour){at, x, y, away2};
    }
    return found;
}

/* Both steps of the lattice that a blob is in: to the nearest pair of neighbours that are as far, at right angles. */
static bool put_steps(const Blob *blobs, ptrdiff_t count, const Blob *own, Step steps[2]) {
    Neighbour near[NEAR];
    const ptrdiff_t found = neighbours_of(blobs, count, own, near);
    for (ptrdiff_t b = 1; b < found; b++)
        for (ptrdiff_t a = 0; a < b; a++) {
            const Neighbour *const one = near + a, *const other = near + b;
            const double product = one->x * other->x + one->y * other->y;
            if (other->away2 > EVEN * EVEN * one->away2 || product * product > SQUARE * SQUARE * one->away2 * other->away2) continue;
            steps[0] = (Step){one->blob->x - own->x, one->blob->y - own->y};
            steps[1] = (Step){other->blob->x - own->x, other->blob->y - own->y};
            return true;
        }
    return false;
}

/* The blob nearest to (x, y), in steps of the lattice; −1 where all are astray. */
static ptrdiff_t blob_near(const Blob *blobs, ptrdiff_t count, const Blob *own, const Step steps[2], double x, double y) {
    const Step v = steps[0], w = steps[1];
    const double per_det = 1.0 / (v.x * w.y - v.y * w.x);
    const double reach = ASTRAY * (fabs(v.y) + fabs(w.y)), reach_x = ASTRAY * (fabs(v.x) + fabs(w.x));
    double least = ASTRAY * ASTRAY;
    ptrdiff_t best = -1;
    for (ptrdiff_t k = first_below(blobs, count, y - reach); k < count && blobs[k].y <= y + reach; k++) {
        const double dx = blobs[k].x - x, dy = blobs[k].y - y;
        if (fabs(dx) > reach_x || !are_alike(blobs + k, own)) continue;
        const double a = (dx * w.y - dy * w.x) * per_det, b = (dy * v.x - dx * v.y) * per_det, away2 = a * a + b * b;
        if (away2 < least) least = away2, best = k;
    }
    return best;
}

typedef struct {
    int32_t i, j;
    Step steps[2];
} Node;

/* The lattice around a blob, `at` (LATTICE_SPAN, LATTICE_SPAN). Returns how many blobs. */
static ptrdiff_t grow(const Blob *blobs, ptrdiff_t count, ptrdiff_t seed, const Step steps[2], int32_t *at) {
    static const int ways[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    Node nodes[LATTICE_SPAN * LATTICE_SPAN];
    ptrdiff_t first = 0, last = 0;
    for (int k = 0; k < LATTICE_SPAN * LATTICE_SPAN; k++) at[k] = -1;
    at[LATTICE_REACH * LATTICE_SPAN + LATTICE_REACH] = (int32_t)seed;
    nodes[last++] = (Node){LATTICE_REACH, LATTICE_REACH, {steps[0], steps[1]}};
    for (; first < last; first++) {
        const Node *const node = nodes + first;
        const Blob *const own = blobs + at[node->j * LATTICE_SPAN + node->i];
        for (int way = 0; way < 4; way++) {
            const int32_t i = node->i + ways[way][0], j = node->j + ways[way][1];
            const int axis = way / 2, sign = ways[way][axis];
            const Step *const step = node->steps + axis;
            if (i < 0 || j < 0 || i >= LATTICE_SPAN || j >= LATTICE_SPAN || at[j * LATTICE_SPAN + i] >= 0) continue;
            const ptrdiff_t found = blob_near(blobs, count, own, node->steps, own->x + sign * step->x, own->y + sign * step->y);
            if (found < 0) continue;
            at[j * LATTICE_SPAN + i] = (int32_t)found;
            Node next = {i, j, {node->steps[0], node->steps[1]}}; /* steps change slowly, as the perspective has it */
            next.steps[axis].x = 0.5 * (step->x + sign * (blobs[found].x - own->x));
            next.steps[axis].y = 0.5 * (step->y + sign * (blobs[found].y - own->y));
            nodes[last++] = next;
        }
    }
    return last;
}

ptrdiff_t ledpi_lattices(const Blob *blobs, ptrdiff_t count, ptrdiff_t least, uint8_t *used, ptrdiff_t most, int32_t *lattices) {
    ptrdiff_t found = 0;
    memset(used, 0, (size_t)count);
    for (ptrdiff_t seed = 0; seed < count && found < most; seed++) {
        int32_t *const at = lattices + found * LATTICE_SPAN * LATTICE_SPAN;
        Step steps[2];
        if (used[seed] || !put_steps(blobs, count, blobs + seed, steps)) continue;
        const ptrdiff_t size = grow(blobs, count, seed, steps, at);
        if (size < least) continue;
        for (int k = 0; k < LATTICE_SPAN * LATTICE_SPAN; k++)
            if (at[k] >= 0) used[at[k]] = 1;
        found++;
    }
    return found;
}
