/* Sub-pixel corners of lit squares, as decode/corners/edges.py explains and decode/corners/looks.py does it: one quad at a time, from a
 * first look to the last, without any array but on the stack. */
#include <math.h>

#include "quads.h"
#include "wide.h"

enum { T = RIM_T, AT_SIDE = 2 };

typedef struct {
    const Picture *picture;
    const Refining *by;
    const Approaching *approaching;
    const Shares *shares;
    const Filters *filters;
    double bend[4][MOST_PROFILES]; /* how far inward the lens moves each place of a side, in pixels */
    ptrdiff_t cells;
    ptrdiff_t missing; /* the filter that is wanted and not made, counted from 1; else 0 */
} Look;

/* What looks have found of a quad, as `_Fit` there. */
typedef struct {
    Point corners[4];
    Side sides[4];
    double blur_px[2], weights[4][MOST_PROFILES], spread[4], variance[4], size_variance;
    bool seen, settled;
} SquareFit;

/* Light across the sides, and the edge and the step's height in each profile. */
typedef struct {
    float light[4][MOST_PROFILES][T];
    double found[4][MOST_PROFILES], height[4][MOST_PROFILES];
} Profiles;

static double clipped(double value, double least, double most) {
    return value > least ? value < most ? value : most : least; /* what is no number is the least */
}

const Filter *ledpi_filter_for(const Filters *all, double pitch_px, double blur_px, ptrdiff_t *missing) {
    double pitch = log(clipped(pitch_px, all->least_pitch_px, all->most_pitch_px));
    double blur = log(clipped(blur_px, all->least_blur_px, all->most_blur_px));
    ptrdiff_t row = (ptrdiff_t)rint(pitch / all->pitch_step) - all->first_pitch;
    ptrdiff_t column = (ptrdiff_t)rint(blur / all->blur_step) - all->first_blur;
    const Filter *filter = &all->filters[row * all->blurs + column];
    if (filter->made == 0.0) *missing = 1 + row * all->blurs + column;
    return filter;
}

/* Those of either pair of opposite sides. */
static void filters_for(Look *look, const Side sides[4], const double blur_px[2], const Filter *filters[2]) {
    for (int pair = 0; pair < 2; pair++) {
        double pitch = 0.0;
        for (int k = pair; k < 4; k += 2) {
            const Side *here = &sides[k], *there = &sides[(k + 2) & 3];
            double x = there->start.x + 0.5 * there->along.x - here->start.x;
            double y = there->start.y + 0.5 * there->along.y - here->start.y;
            double depth = x * here->inward.x + y * here->inward.y;
            double shrunk = (double)look->cells * there->length - there->length + here->length;
            pitch += 0.5 * depth * here->length / fmax(shrunk, 1e-9);
        }
        filters[pair] = ledpi_filter_for(look->filters, pitch, blur_px[pair], &look->missing);
    }
}

LEDPI_WIDE static void take_profiles(const Look *look, const Side sides[4], const Filter *filters[2], Profiles *into) {
    for (int k = 0; k < 4; k++) {
        const Side *side = &sides[k];
        const Filter *filter = filters[k & 1];
        float across_x[T], across_y[T], xs[MOST_PROFILES * T], ys[MOST_PROFILES * T];
        for (int t = 0; t < T; t++) {
            across_x[t] = (float)(side->inward.x * (RIM_FIRST_ACROSS + t));
            across_y[t] = (float)(side->inward.y * (RIM_FIRST_ACROSS + t));
        }
        for (ptrdiff_t p = 0; p < look->shares->count; p++) {
            double share = look->shares->share[p], bend = look->bend[k][p];
            float x = (float)(side->start.x + side->along.x * share + side->inward.x * bend);
            float y = (float)(side->start.y + side->along.y * share + side->inward.y * bend);
            for (int t = 0; t < T; t++) xs[p * T + t] = x + across_x[t], ys[p * T + t] = y + across_y[t];
        }
        ledpi_light_at_all(look->picture, xs, ys, look->shares->count * T, into->light[k][0]);
        for (ptrdiff_t p = 0; p < look->shares->count; p++) {
            const float *light = into->light[k][p];
            double edge = 0.0, height = 0.0;
            for (int t = 0; t < T; t++) {
                edge += light[t] * filter->single[t][0];
                height += light[t] * filter->single[t][1];
            }
            into->height[k][p] = height = fmax(height, look->by->least_height);
            into->found[k][p] = edge / height - filter->single_offset;
        }
    }
}

/* Of each side, relative to the step's height. */
static void mean_profiles(const Look *look, const Profiles *profiles, const SquareFit *fit, double mean[4][T]) {
    for (int k = 0; k < 4; k++) {
        double sum = 0.0;
        for (int t = 0; t < T; t++) mean[k][t] = 0.0;
        for (ptrdiff_t p = 0; p < look->shares->count; p++) {
            double weight = fit->weights[k][p];
            if (weight == 0.0) continue;
            sum += weight;
            weight /= profiles->height[k][p];
            for (int t = 0; t < T; t++) mean[k][t] += weight * profiles->light[k][p][t];
        }
        for (int t = 0; t < T; t++) mean[k][t] /= fmax(sum, 1e-9);
    }
}

/* What the filters make of the mean profiles: each side's place, and both pairs' blur, as a logarithm. */
static void places(const Filter *filters[2], double mean[4][T], double place[4], double blur[2]) {
    for (int k = 0; k < 2; k++) {
        const Filter *f = filters[k];
        double both = 0.0, apart = 0.0, blurred = 0.0;
        for (int t = 0; t < T; t++) {
            double sum = 0.5 * (mean[k][t] + mean[k + 2][t]), difference = 0.5 * (mean[k][t] - mean[k + 2][t]);
            both += f->both[0][t] * sum;
            blurred += f->both[1][t] * sum;
            apart += f->apart[t] * difference;
        }
        place[k] = both + apart + f->both_offset[0];
        place[k + 2] = both - apart + f->both_offset[0];
        blur[k] = blurred + f->both_offset[1];
    }
}

/* Whether all sides' mean profiles are about as steep at the side as anywhere. */
static bool steep(const Refining *by, double mean[4][T]) {
    for (int k = 0; k < 4; k++) {
        double here = mean[k][AT_SIDE + 2] - mean[k][AT_SIDE];
        for (int t = 0; t + 2 < T; t++)
            if (!(here >= by->steepest * (mean[k][t + 2] - mean[k][t]))) return false;
    }
    return true;
}

/* Corners after each side has moved to where its mean profile has it, turned as the single ones say; as they were where
 * that is nowhere. Returns whether it is somewhere. */
static bool move(const Look *look, const Profiles *profiles, const double place[4], SquareFit *fit, Point corners[4]) {
    double by[4], slope[4];
    for (int k = 0; k < 4; k++) {
        double middle, sum = 0.0, found = 0.0;
        ledpi_fit_line(look->shares, profiles->found[k], fit->weights[k], &middle, &slope[k]);
        for (ptrdiff_t p = 0; p < look->shares->count; p++) {
            sum += fit->weights[k][p];
            found += fit->weights[k][p] * profiles->found[k][p];
        }
        by[k] = place[k] - found / fmax(sum, 1e-9) + middle;
    }
    ledpi_moved(fit->sides, by, slope, corners);
    bool finite = true;
    for (int k = 0; k < 4; k++) finite = finite && isfinite(corners[k].x) && isfinite(corners[k].y);
    for (int k = 0; k < 4; k++) fit->corners[k] = finite ? corners[k] : fit->sides[k].start;
    return finite;
}

static void change_blur(const Refining *by, const double seen[2], double blur_px[2]) {
    for (int k = 0; k < 2; k++) blur_px[k] *= exp(fmin(fmax(seen[k], -by->max_blur_change), by->max_blur_change));
}

static void first_look(Look *look, const Point corners[4], Profiles *profiles, SquareFit *fit) {
    const Filter *filters[2];
    double mean[4][T], place[4], blur[2];
    bool good[4 * MOST_PROFILES];
    ptrdiff_t count = look->shares->count;
    ledpi_sides_of(corners, fit->sides);
    fit->blur_px[0] = fit->blur_px[1] = look->filters->usual_blur_px;
    filters_for(look, fit->sides, fit->blur_px, filters);
    take_profiles(look, fit->sides, filters, profiles);
    double height[4 * MOST_PROFILES];
    for (int k = 0; k < 4; k++)
        for (ptrdiff_t p = 0; p < count; p++) height[k * count + p] = profiles->height[k][p];
    fit->seen = ledpi_steps(count, height, good);
    for (int k = 0; k < 4; k++) {
        double middle, slope;
        const bool *steps = good + k * count;
        ledpi_near_median(count, profiles->found[k], steps, look->by->near_px, fit->weights[k]);
        ledpi_fit_line(look->shares, profiles->found[k], fit->weights[k], &middle, &slope);
        fit->spread[k] = ledpi_deviation(look->shares, profiles->found[k], steps, middle, slope, fit->weights[k]);
    }
    mean_profiles(look, profiles, fit, mean);
    places(filters, mean, place, blur);
    change_blur(look->by, blur, fit->blur_px);
    filters_for(look, fit->sides, fit->blur_px, filters); /* those that fit the blur that is seen */
    places(filters, mean, place, blur);
    Point moved[4];
    fit->seen = move(look, profiles, place, fit, moved) && fit->seen;
    ledpi_sides_of(fit->corners, fit->sides);
    change_blur(look->by, blur, fit->blur_px);
    for (int k = 0; k < 4; k++) fit->variance[k] = filters[k & 1]->both_variance + filters[k & 1]->apart_variance;
    fit->size_variance = PAIRS_ALIKE * sqrt(filters[0]->both_variance * filters[1]->both_variance);
    fit->settled = fit->seen && steep(look->by, mean) && ledpi_farthest(moved, corners) < look->by->settled_px &&
                   fabs(blur[0]) < look->by->settled_blur && fabs(blur[1]) < look->by->settled_blur;
}

/* As many looks more as it takes, each with the blur that the last has seen, at the same profiles; none at what does not
 * show edges on all sides, which is refused wherever it is. */
static void more_looks(Look *look, Profiles *profiles, SquareFit *fit) {
    const Filter *filters[2];
    double mean[4][T], place[4], blur[2];
    Point moved[4];
    for (int round = 0; round < look->by->more_looks && fit->seen && !fit->settled; round++) {
        filters_for(look, fit->sides, fit->blur_px, filters);
        take_profiles(look, fit->sides, filters, profiles);
        mean_profiles(look, profiles, fit, mean);
        places(filters, mean, place, blur);
        bool finite = move(look, profiles, place, fit, moved);
        double farthest = 0.0;
        for (int k = 0; k < 4; k++)
            farthest = fmax(farthest, ledpi_length(fit->corners[k].x - fit->sides[k].start.x, fit->corners[k].y - fit->sides[k].start.y));
        ledpi_sides_of(fit->corners, fit->sides);
        change_blur(look->by, blur, fit->blur_px);
        fit->settled = finite && fit->seen && steep(look->by, mean) && farthest < look->by->converged_px;
    }
}

static void find_sides(Look *look, const Shares *coarse, const float *templates, const Point near[4], SquareFit *fit) {
    Profiles profiles;
    first_look(look, near, &profiles, fit);
    if (ledpi_farthest(fit->corners, near) < look->by->first_look_px) more_looks(look, &profiles, fit);
    if (fit->settled) return;
    Point nearest[4]; /* too far off for the filters, or nothing there */
    double spread;
    ledpi_nearest(look->picture, look->approaching, coarse, templates, near, look->approaching->finest_step_px, nearest,
                  &spread);
    bool there = ledpi_farthest(nearest, near) < look->by->max_move * sqrt(fabs(ledpi_area(near)));
    first_look(look, there ? nearest : near, &profiles, fit);
    more_looks(look, &profiles, fit);
}

/* How far inward the lens moves the places along the sides, from where it moves their thirds (4, 2, 2: along, inward). */
static void bend_sides(Look *look, const double *bends) {
    ptrdiff_t count = look->shares->count;
    for (int k = 0; k < 4; k++)
        for (ptrdiff_t p = 0; p < count; p++)
            look->bend[k][p] = bends[4 * k + 1] * look->shares->bend[p] + bends[4 * k + 3] * look->shares->bend[count + p];
}

void ledpi_find_sides(const Picture *picture, const Tables *tables, const Point near[4], const double *bends, Found *found,
                      Missing *missing) {
    Look look = {.picture = picture, .by = tables->refining, .approaching = tables->approaching,
                 .shares = &tables->profiles, .filters = &tables->filters, .cells = tables->cells, .missing = 0};
    SquareFit fit;
    double used = 0.0, squares = 0.0, variance = 0.0;
    const ptrdiff_t count = look.shares->count;
    bend_sides(&look, bends);
    find_sides(&look, &tables->coarse, tables->templates, near, &fit);
    missing->filter = look.missing;
    for (int k = 0; k < 4; k++) {
        double weights = 0.0, spread2 = fit.spread[k] * fit.spread[k];
        for (ptrdiff_t p = 0; p < count; p++) {
            weights += fit.weights[k][p];
            used += fit.weights[k][p] > 0.0;
        }
        squares += spread2;
        variance += fit.variance[k] + 4 * spread2 / fmax(fmin(weights, fit.sides[k].length), 1.0);
        found->corners[k] = fit.corners[k];
    }
    found->seen = fit.seen;
    found->used = used / (4.0 * (double)count);
    found->spread_px = sqrt(squares / 4);
    found->sigma_px = sqrt(variance / 4 + fit.size_variance);
    found->size_sigma_px = sqrt(fit.size_variance);
}
