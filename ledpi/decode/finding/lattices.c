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
#define ASTRAY 0.3 /* of a step, from where the next blob should be */

enum { NEAR = 12 }; /* neighbours that are looked at */

typedef struct {
    double x, y;
} Step;

static bool are_alike(const Blob *one, const Blob *other) {
    return one->area < ALIKE * other->area && other->area < ALIKE * one->area;
}

/* The first blob at y or below: they come from the top down. */
static ptrdiff_t first_below(const Blob *blobs, ptrdiff_t count, double y) {
    ptrdiff_t low = 0;
    while (low < count) {
        const ptrdiff_t middle = (low + count) / 2;
        if (blobs[middle].y < y) low = middle + 1;
        else count = middle;
    }
    return low;
}

/* Neighbours of a blob, the nearest first, and where they are once its moments are a unit circle's: (NEAR, 3) with how far. */
static ptrdiff_t neighbours_of(const Blob *blobs, ptrdiff_t count, const Blob *own, ptrdiff_t which[NEAR], double at[NEAR][3]) {
    const double l = sqrt(own->xx), m = own->xy / l, r = sqrt(fmax(own->yy - m * m, 1e-6));
    const double reach = FARTHEST * sqrt(fmax(own->xx, own->yy));
    ptrdiff_t near = 0;
    for (ptrdiff_t j = first_below(blobs, count, own->y - reach); j < count && blobs[j].y <= own->y + reach; j++) {
        const double dx = blobs[j].x - own->x, dy = blobs[j].y - own->y;
        if (fabs(dx) > reach || !are_alike(blobs + j, own)) continue;
        const double x = dx / l, y = (dy - m * x) / r, away = sqrt(x * x + y * y);
        if (away < NEAREST || away > FARTHEST || (near == NEAR && away >= at[NEAR - 1][2])) continue;
        ptrdiff_t k = near < NEAR ? near++ : NEAR - 1;
        for (; k > 0 && at[k - 1][2] > away; k--) {
            which[k] = which[k - 1];
            memcpy(at[k], at[k - 1], sizeof *at);
        }
        which[k] = j, at[k][0] = x, at[k][1] = y, at[k][2] = away;
    }
    return near;
}

/* Both steps of the lattice that a blob is in: to the nearest pair of neighbours that are as far, at right angles. */
static bool put_steps(const Blob *blobs, ptrdiff_t count, const Blob *own, Step steps[2]) {
    ptrdiff_t which[NEAR];
    double at[NEAR][3];
    const ptrdiff_t near = neighbours_of(blobs, count, own, which, at);
    for (ptrdiff_t b = 1; b < near; b++)
        for (ptrdiff_t a = 0; a < b; a++) {
            const double product = at[a][0] * at[b][0] + at[a][1] * at[b][1];
            if (at[b][2] > EVEN * at[a][2] || fabs(product) > SQUARE * at[a][2] * at[b][2]) continue;
            const Blob *const ends[2] = {blobs + which[a], blobs + which[b]};
            for (int k = 0; k < 2; k++) steps[k] = (Step){ends[k]->x - own->x, ends[k]->y - own->y};
            return true;
        }
    return false;
}

/* The blob nearest to (x, y), in steps of the lattice; −1 where all are astray. */
static ptrdiff_t blob_near(const Blob *blobs, ptrdiff_t count, const Blob *own, const Step steps[2], double x, double y) {
    const double det = steps[0].x * steps[1].y - steps[0].y * steps[1].x;
    const double reach = ASTRAY * (fabs(steps[0].y) + fabs(steps[1].y));
    double least = ASTRAY;
    ptrdiff_t best = -1;
    for (ptrdiff_t k = first_below(blobs, count, y - reach); k < count && blobs[k].y <= y + reach; k++) {
        const double dx = blobs[k].x - x, dy = blobs[k].y - y;
        const double a = (dx * steps[1].y - dy * steps[1].x) / det, b = (dy * steps[0].x - dx * steps[0].y) / det;
        if (!(fabs(a) < least && fabs(b) < least) || !are_alike(blobs + k, own)) continue;
        const double away = sqrt(a * a + b * b);
        if (away < least) least = away, best = k;
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
