/* A glance at candidates: how much likelier a panel is there than smooth texture, by one fixed template.
 *
 * On the picture of a pyramid where a cell has 5 to 10 pixels all panels look alike. So slopes and the projection onto them are
 * the same in every round of every candidate (inverse composition; Baker and Matthews, Lucas-Kanade 20 years on, 2004): a round is
 * as many dot products as there are unknowns. decode/finding/glance.py makes the template, and derives what is likely enough. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "panel.h"
#include "simd.h"

enum { ROUNDS = 3 };
enum { MOST = 256 }; /* in a picture: what has more is texture */
#define SAME 0.25 /* cells: candidates no further apart lead to the same fit */
#define LEAST_CELL 5.0 /* pixels, of the smallest picture in which a candidate is looked at */
#define SMALL_MOVE 0.004 /* a hundredth of a cell: it is there */
#define FARTHEST 3.0 /* sizes of the picture */

static double side_of(const double *c) {
    return sqrt(0.5 * fabs((c[4] - c[0]) * (c[7] - c[3]) - (c[6] - c[2]) * (c[5] - c[1])));
}

static ptrdiff_t level_of(const PyramidPicture *pictures, ptrdiff_t count, double cell) {
    ptrdiff_t level = 0;
    while (level + 1 < count && cell / (double)(2 << level) >= LEAST_CELL && pictures[level + 1].height > 1 && pictures[level + 1].width > 1)
        level++;
    return level;
}

/* No less than 0, which what is not a number counts for, and no more than `most`. */
static LEDPI_INLINE void limit(float most, Floats *of) {
    const Floats least = {0}, end = least + most;
    const Ints less = *of < end;
    *of = (Floats)((((Ints)*of & less) | ((Ints)end & ~less)) & (*of > least));
}

/* Puts the samples (lines²) of a square's picture, by straight lines between pixels. */
static LEDPI_INLINE void put_seen(const GlanceTemplate *t, const PyramidPicture *picture, double scale, const double h[9], float *seen) {
    const float right = (float)(picture->width - 1), bottom = (float)(picture->height - 1);
    const float size = (float)(1.0 / scale), off = 0.5f * size - 0.5f;
    for (ptrdiff_t j = 0; j < t->lines; j++) {
        const float v = t->along[j];
        const float a = (float)(h[1] * v + h[2]), b = (float)(h[4] * v + h[5]), c = (float)(h[7] * v + h[8]);
        for (ptrdiff_t i = 0; i < t->lines; i += LEDPI_WIDTH) {
            const Floats u = *(const Floats *)(t->along + i), w = size / ((float)h[6] * u + c);
            Floats across = ((float)h[0] * u + a) * w + off, down = ((float)h[3] * u + b) * w + off;
            limit(right, &across), limit(bottom, &down);
            Floats left = across, top = down;
            limit(right - 1.0f, &left), limit(bottom - 1.0f, &top);
            const Ints column = __builtin_convertvector(left, Ints), row = __builtin_convertvector(top, Ints);
            float before[2][2][LEDPI_WIDTH]; /* the four pixels around */
            for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
                const uint8_t *const above = picture->pixels + row[lane] * picture->width + column[lane], *const below = above + picture->width;
                before[0][0][lane] = (float)above[0], before[0][1][lane] = (float)above[1];
                before[1][0][lane] = (float)below[0], before[1][1][lane] = (float)below[1];
            }
            across -= __builtin_convertvector(column, Floats), down -= __builtin_convertvector(row, Floats);
            const Floats *const corner = (const Floats *)before;
            const Floats upper = corner[0] + across * (corner[1] - corner[0]), lower = corner[2] + across * (corner[3] - corner[2]);
            *(Floats *)(seen + j * t->lines + i) = upper + down * (lower - upper); /* the next row overwrites those beyond its lines */
        }
    }
}

/* Grey levels: of what is bright in a panel and what is dimmed there, and of what is dark around. */
typedef struct {
    float dark, dimmed, bright;
} Levels;

static LEDPI_INLINE Levels levels_of(const GlanceTemplate *t, const float *seen) {
    int32_t counts[2][256];
    memset(counts, 0, sizeof counts);
    for (ptrdiff_t i = 0; i < t->lines * t->lines; i++) counts[t->inside[i]][(int)seen[i] & 255]++;
    const int bright = ledpi_quantile(counts[1], LEDPI_BRIGHT), dimmed = ledpi_quantile(counts[1], LEDPI_DARK);
    for (int i = 0; i < 256; i++) counts[0][i] += counts[1][i];
    return (Levels){(float)ledpi_quantile(counts[0], LEDPI_DARK), (float)dimmed, (float)bright};
}

/* Squares of the light about a hypothesis' mean, over its variance: what the `ranks` directions in which it varies explain
 * taken off (Woodbury). */
static LEDPI_INLINE float squares_of(const GlanceTemplate *t, const GlanceHypothesis *of, const float *light, float *about) {
    for (ptrdiff_t i = 0; i < t->size; i++) about[i] = light[i] - of->mean[i];
    float left = ledpi_product(about, about, t->size);
    for (ptrdiff_t k = 0; k < of->ranks; k++) {
        const float explained = ledpi_product(of->directions + k * t->size, about, t->size);
        left -= explained * explained;
    }
    return left;
}

/* Moves a square as its light has it. False once that is hardly anything, or beyond all bounds. */
static LEDPI_INLINE bool moves(const GlanceTemplate *t, const double h[9], const float *light, double farthest, float *about, Point corners[4]) {
    double ways[WAYS], gain = 0.0;
    Point next[4];
    for (ptrdiff_t i = 0; i < t->size; i++) about[i] = light[i] - t->panel.mean[i];
    for (ptrdiff_t k = 0; k < t->cells * t->cells; k++) gain += 1.0 + ledpi_product(t->gains + k * t->size, about, t->size);
    for (ptrdiff_t k = 0; k < WAYS; k++) ways[k] = ledpi_product(t->ways + k * t->size, about, t->size);
    if (!(ledpi_panel_compose(h, ways, gain / (double)(t->cells * t->cells), next) > SMALL_MOVE)) return false;
    for (int i = 0; i < 4; i++)
        if (!(fabs(next[i].x) < farthest && fabs(next[i].y) < farthest)) return false;
    memcpy(corners, next, sizeof next);
    return true;
}

/* Log-likelihood ratio of a panel to texture, both of a variance that nothing is known of. */
static double evidence_of(const GlanceTemplate *t, double panel, double texture) {
    return 0.5 * (t->independent * log(texture / panel) - t->log_volume);
}

LEDPI_SIMD static void glance(const GlanceTemplate *t, const GlancePictures *in, float *work, Glimpse *of) {
    float *const seen = work, *const light = seen + t->size, *const about = light + t->size;
    const ptrdiff_t level = level_of(in->pyramid, in->count, of->side_px / (double)t->cells);
    const PyramidPicture *const picture = in->pyramid + level;
    const double farthest = FARTHEST * fmax((double)in->pyramid->height, (double)in->pyramid->width);
    Point corners[4];
    double h[9];
    memcpy(corners, of->corners, sizeof corners);
    memcpy(of->moved, corners, sizeof corners);
    of->evidence = -INFINITY;
    if (picture->height < 2 || picture->width < 2) return;
    for (int round = 0;; round++) {
        ledpi_unit_square_homography(corners, h);
        for (int i = 0; i < 9; i++)
            if (!isfinite(h[i])) return;
        if (round == 0 && in->bridged.pixels) {
            put_seen(t, &in->bridged, 1.0, h, seen);
            const Levels there = levels_of(t, seen);
            if (there.dimmed > (float)in->most_dimmed * there.bright) return;
        }
        put_seen(t, picture, (double)(1 << level), h, seen);
        const Levels here = levels_of(t, seen);
        if (!(here.bright > here.dark)) return;
        for (ptrdiff_t i = 0; i < t->size; i++) light[i] = i < t->lines * t->lines ? (seen[i] - here.dark) / (here.bright - here.dark) : 0.0f;
        if (round == 0 || round == ROUNDS) {
            const double evidence = evidence_of(t, squares_of(t, &t->panel, light, about), squares_of(t, &t->texture, light, about));
            if (evidence > of->evidence) {
                of->evidence = evidence;
                memcpy(of->moved, corners, sizeof of->moved);
            }
        }
        if (round == ROUNDS) return;
        if (!moves(t, h, light, farthest, about, corners)) round = ROUNDS - 1;
    }
}

static int larger_first(const void *one, const void *other) {
    const double a = ((const Glimpse *)one)->side_px, b = ((const Glimpse *)other)->side_px;
    return (a < b) - (a > b);
}

static int likelier_first(const void *one, const void *other) {
    const double a = ((const Glimpse *)one)->evidence, b = ((const Glimpse *)other)->evidence;
    return (a < b) - (a > b);
}

/* True if each corner of one square is near one of the other's, in whichever order both are. */
static bool are_near(const double *one, const double *other, double near) {
    for (int i = 0; i < 4; i++) {
        bool found = false;
        for (int j = 0; j < 4 && !found; j++)
            found = ledpi_length(one[2 * i] - other[2 * j], one[2 * i + 1] - other[2 * j + 1]) < near;
        if (!found) return false;
    }
    return true;
}

/* Keeps the first of those that lead to one fit. Returns how many are kept. */
static ptrdiff_t keep_distinct(const GlanceTemplate *t, bool moved, ptrdiff_t count, Glimpse *glimpses) {
    ptrdiff_t kept = 0;
    for (ptrdiff_t i = 0; i < count; i++) {
        const Glimpse own = glimpses[i];
        bool is_new = true;
        for (ptrdiff_t j = 0; j < kept && is_new; j++) {
            const Glimpse *const other = glimpses + j;
            const double near = SAME * own.side_px / (double)t->cells;
            is_new = !(fabs(own.side_px - other->side_px) < 2.0 * near && are_near(moved ? own.moved : own.corners, moved ? other->moved : other->corners, near));
        }
        if (is_new) glimpses[kept++] = own;
    }
    return kept;
}

/* Looks at each of `glimpses` (most), of which the corners are given. `work` (3, template's size). */
void ledpi_glance_at(const GlanceTemplate *t, const GlancePictures *in, float *work, ptrdiff_t most, Glimpse *glimpses) {
    for (ptrdiff_t i = 0; i < most; i++) {
        glimpses[i].side_px = side_of(glimpses[i].corners);
        glance(t, in, work, glimpses + i);
    }
}

/* Looks at those of `glimpses` (most) that are not smaller than `smallest_px`; of each size every so many, from `turn` on, so that
 * they are no more than `at_once`. Returns how many different ones there are, of those that lead to one fit the likeliest; the
 * largest first, as a texture's are small. */
ptrdiff_t ledpi_glance(const GlanceTemplate *t, const GlancePictures *in, double smallest_px, ptrdiff_t at_once, ptrdiff_t turn,
                       float *work, ptrdiff_t most, Glimpse *glimpses) {
    ptrdiff_t large = 0;
    for (ptrdiff_t i = 0; i < most; i++) {
        Glimpse own = glimpses[i];
        own.side_px = side_of(own.corners);
        if (own.side_px >= smallest_px && isfinite(own.side_px)) glimpses[large++] = own;
    }
    qsort(glimpses, (size_t)large, sizeof *glimpses, larger_first);
    const ptrdiff_t distinct = keep_distinct(t, false, large < MOST ? large : MOST, glimpses), every = (distinct - 1) / at_once + 1;
    large = 0;
    for (ptrdiff_t i = (turn - 1) % every; i < distinct; i += every) glimpses[large++] = glimpses[i];
    ledpi_glance_at(t, in, work, large, glimpses);
    qsort(glimpses, (size_t)large, sizeof *glimpses, likelier_first);
    large = keep_distinct(t, !in->bridged.pixels, large, glimpses);
    qsort(glimpses, (size_t)large, sizeof *glimpses, larger_first);
    return large;
}
