/* Light along quads, what is left of it once it is explained by cells, and what is hidden by that: decode/corners/whole.py. */
#include <math.h>

#include "quads.h"
#include "wide.h"

enum { ALONG = 40, SHARES = 20, WHOLE = 5, SMALLER = 2 * SHARES + 2, EXPLAINED = 3 * SHARES };
#define ACROSS_FIRST 0.3 /* of a cell: where the light along the quad is taken, and averaged */
#define ACROSS_SECOND 0.7

/* Light (2, ALONG) from left to right and from top to bottom of a quad, its mean 1. `bends` (4, 2, 2) of its sides, along
 * and inward; `cubics` (2, ALONG) how much of either moves each place. */
LEDPI_WIDE static void light_along(const Picture *picture, const Point corners[4], const double *bends,
                                   const double *cubics, ptrdiff_t cells, double *light) {
    double h[9];
    ledpi_unit_square_to(corners, h);
    for (int axis = 0; axis < 2; axis++) {
        double *into = light + axis * ALONG, sum = 0.0;
        double length = ledpi_length(corners[axis + 1].x - corners[axis].x, corners[axis + 1].y - corners[axis].y);
        const double *onward = bends + 4 * axis, *back = bends + 4 * (axis + 2); /* that side runs the other way */
        double first = 0.5 * (onward[0] - back[2]) / length, second = 0.5 * (onward[2] - back[0]) / length;
        for (int i = 0; i < ALONG; i++) into[i] = 0.0;
        for (ptrdiff_t line = 0; line < 2 * cells; line++) {
            const double across = ((double)(line / 2) + (line % 2 ? ACROSS_SECOND : ACROSS_FIRST)) / (double)cells;
            const double within = ((double)line + 0.5) / (2.0 * (double)cells); /* of a place: else a thin gap falls between two */
            float xs[ALONG], ys[ALONG], seen[ALONG];
            for (int i = 0; i < ALONG; i++) {
                double along = (i + within) / ALONG + first * cubics[i] + second * cubics[ALONG + i];
                double u = axis ? across : along, v = axis ? along : across, scale = 1.0 / (h[6] * u + h[7] * v + h[8]);
                xs[i] = (float)((h[0] * u + h[1] * v + h[2]) * scale);
                ys[i] = (float)((h[3] * u + h[4] * v + h[5]) * scale);
            }
            ledpi_light_at_all(picture, xs, ys, ALONG, seen);
            for (int i = 0; i < ALONG; i++) into[i] += seen[i] / (2.0 * (double)cells);
        }
        for (int i = 0; i < ALONG; i++) sum += into[i];
        for (int i = 0; i < ALONG; i++) into[i] /= fmax(sum / ALONG, 1e-6);
    }
}

/* Mean square that the explanations from … to − 1 leave (to,) of `light`; the best of them. */
LEDPI_WIDE static ptrdiff_t unexplained(const double *light, const Explanations *explanations, double near_edge,
                                        ptrdiff_t from, ptrdiff_t to, double *left) {
    double all = 0.0, places = 0.0;
    ptrdiff_t best = from;
    for (int i = 0; i < ALONG; i++) {
        const double at = (i + 0.5) / ALONG;
        if (!(at > near_edge && at < 1.0 - near_edge)) continue;
        all += light[i] * light[i];
        places += 1.0;
    }
    for (ptrdiff_t e = from; e < to; e++) {
        double explained = 0.0;
        const double *const end = explanations->bases + explanations->first[e + 1] * ALONG;
        for (const double *basis = explanations->bases + explanations->first[e] * ALONG; basis < end; basis += ALONG) {
            double part[4] = {0.0, 0.0, 0.0, 0.0}; /* four sums side by side, as many as fit a register */
            for (int i = 0; i < ALONG; i += 4)
                for (int k = 0; k < 4; k++) part[k] += light[i + k] * basis[i + k];
            const double product = (part[0] + part[1]) + (part[2] + part[3]);
            explained += product * product;
        }
        left[e] = fmax(all - explained, 1e-9) / places;
        if (left[e] < left[best]) best = e;
    }
    return best;
}

/* The share with the least left unexplained, by the parabola through its neighbours; `left` (SHARES,), and of whole cells. */
static double share_of(const Refining *by, const double *left, ptrdiff_t best, double of_whole) {
    if (best < 1 || best > SHARES - 2) return NAN;
    const double tilt = 0.5 * (left[best - 1] - left[best + 1]);
    const double bend = fmax(left[best - 1] + left[best + 1] - 2.0 * left[best], 1e-12);
    const double share = by->first_share + by->share_step * ((double)best + tilt / bend);
    const double least = left[best] - 0.5 * tilt * tilt / bend;
    const double enough = fmax(by->little_left * by->little_left, by->clearly_better * of_whole);
    return fabs(share) < by->most && least < enough ? share : NAN;
}

bool ledpi_hidden(const Picture *picture, const Tables *tables, const Point corners[4], const double *bends,
                  double hidden[2][2], Missing *missing) {
    const Refining *const by = tables->refining;
    static const double ends[3][2] = {{1.0, 0.0}, {0.0, 1.0}, {1.0, 1.0}};
    const double side_px = sqrt(fabs(ledpi_area(corners))), cells = (double)tables->cells;
    double most_bent = 0.0, light[2][ALONG], left[EXPLAINED];
    for (int k = 0; k < 4; k++) {
        hidden[k / 2][k % 2] = 0.0;
        most_bent = fmax(most_bent, fmax(fabs(bends[4 * k + 1]), fabs(bends[4 * k + 3])));
    }
    const double blur = (by->blur_px + most_bent + by->gap * side_px / cells) / fmax(side_px, 1.0);
    if (!(blur > 0.0)) return false; /* the quad is nowhere */
    const double last = (double)(tables->blurs - 1);
    const double step = fmin(fmax(rint(log(blur) / by->blur_step) - (double)tables->first_blur, 0.0), last);
    const Explanations *const explanations = tables->explanations + (ptrdiff_t)step;
    if (!explanations->bases) {
        missing->explanations = 1 + (ptrdiff_t)step;
        return false;
    }
    light_along(picture, corners, bends, tables->cubics, tables->cells, &light[0][0]);
    bool shows[2];
    for (int axis = 0; axis < 2; axis++) {
        unexplained(light[axis], explanations, by->near_edge, WHOLE, WHOLE + 1, left);
        unexplained(light[axis], explanations, by->near_edge, SMALLER, SMALLER + 1, left);
        const double shown = fmax(by->cells_show * by->cells_show * left[WHOLE], by->least_shown * by->least_shown);
        shows[axis] = left[SMALLER] > shown;
        if (!(left[WHOLE] > by->nothing_left * by->nothing_left)) continue;
        const ptrdiff_t best = unexplained(light[axis], explanations, by->near_edge, 0, EXPLAINED, left);
        const ptrdiff_t end = best / SHARES;
        if (!(left[best] < by->better * left[WHOLE])) continue;
        const double share = share_of(by, left + end * SHARES, best % SHARES, left[WHOLE]);
        hidden[axis][0] = share * ends[end][0], hidden[axis][1] = share * ends[end][1];
        shows[axis] = true;
    }
    return shows[0] && shows[1];
}
