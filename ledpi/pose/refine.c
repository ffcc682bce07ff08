/* Poses by least squares: Levenberg and Marquardt's method, as pose/refine.py explains it. */
#include <math.h>

#include "core.h"
#include "pose.h"

typedef struct {
    double rotation[9], position[3], chi2;
    double information[6][6], pull[6];
} Look;

/* Four points' part of a look. */
static void look_at_four(Look *look, const double *points, const double *seen_px, const double *whitener, const Lens *lens,
                         double *off_px) {
    double slopes[8][6], off[8];
    for (int p = 0; p < 4; p++) {
        const double *r = look->rotation, *at = points + 3 * p;
        double arm[3], place[3], pixel[2], by_point[2][3];
        for (int i = 0; i < 3; i++) {
            arm[i] = r[3 * i] * at[0] + r[3 * i + 1] * at[1] + r[3 * i + 2] * at[2];
            place[i] = arm[i] + look->position[i];
        }
        ledpi_project(lens, place, pixel, by_point);
        for (int j = 0; j < 2; j++) {
            const double *by = by_point[j];
            double *slope = slopes[2 * p + j];
            off_px[2 * p + j] = off[2 * p + j] = seen_px[2 * p + j] - pixel[j];
            slope[0] = by[0], slope[1] = by[1], slope[2] = by[2];
            slope[3] = arm[1] * by[2] - arm[2] * by[1]; /* by the turn: arm × by */
            slope[4] = arm[2] * by[0] - arm[0] * by[2];
            slope[5] = arm[0] * by[1] - arm[1] * by[0];
        }
    }
    for (int row = 0; row < 8; row++) {
        double left = 0.0, by[6] = {0};
        for (int k = 0; k < 8; k++) {
            double weight = whitener[8 * row + k];
            left += weight * off[k];
            for (int j = 0; j < 6; j++) by[j] += weight * slopes[k][j];
        }
        look->chi2 += left * left;
        for (int i = 0; i < 6; i++) {
            look->pull[i] += by[i] * left;
            for (int j = 0; j <= i; j++) look->information[i][j] += by[i] * by[j];
        }
    }
}

static void look_from(Look *look, const Body *body, const Lens *lens, double *off_px) {
    look->chi2 = 0.0;
    for (int i = 0; i < 6; i++) {
        look->pull[i] = 0.0;
        for (int j = 0; j < 6; j++) look->information[i][j] = i == j && i >= 3 ? 1.0 : 0.0; /* no turn by a radian is known */
    }
    for (ptrdiff_t four = 0; four < body->points / 4; four++)
        look_at_four(look, body->place + 12 * four, body->seen_px + 8 * four, body->whiteners + 64 * four, lens,
                     off_px + 8 * four);
    for (int i = 0; i < 6; i++)
        for (int j = i + 1; j < 6; j++) look->information[i][j] = look->information[j][i];
}

/* Cholesky's factor of a symmetric matrix, damped; what no row knows of is known a little. */
static void factor(double matrix[6][6], double damping, double root[6][6]) {
    for (int i = 0; i < 6; i++)
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i][j] * (i == j ? 1.0 + damping : 1.0);
            for (int k = 0; k < j; k++) sum -= root[i][k] * root[j][k];
            root[i][j] = i == j ? sqrt(fmax(sum, fmax(1e-14 * matrix[i][i], 1e-300))) : sum / root[j][j];
        }
}

static void solve(double root[6][6], const double right[6], double out[6]) {
    for (int i = 0; i < 6; i++) {
        double sum = right[i];
        for (int k = 0; k < i; k++) sum -= root[i][k] * out[k];
        out[i] = sum / root[i][i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++) out[i] -= root[k][i] * out[k];
        out[i] /= root[i][i];
    }
}

/* Turned further by a small turn about fixed axes, by Cayley's map, and moved. */
static void step_from(const Look *from, const double step[6], Look *to) {
    double a = 0.5 * step[3], b = 0.5 * step[4], c = 0.5 * step[5], scale = 2.0 / (1.0 + a * a + b * b + c * c);
    const double half[9] = {0, -c, b, c, 0, -a, -b, a, 0};
    double by[9];
    for (int i = 0; i < 3; i++) {
        to->position[i] = from->position[i] + step[i];
        for (int j = 0; j < 3; j++) {
            double sum = half[3 * i + j];
            for (int k = 0; k < 3; k++) sum += half[3 * i + k] * half[3 * k + j];
            by[3 * i + j] = scale * sum;
        }
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = from->rotation[3 * i + j];
            for (int k = 0; k < 3; k++) sum += by[3 * i + k] * from->rotation[3 * k + j];
            to->rotation[3 * i + j] = sum;
        }
}

void ledpi_fit(const Body *body, const Lens *lens, int starts, const Stop *stop, Fit *fits, double *off_px, double *trial_px) {
    Look best[MOST_STARTS], trial;
    double damping[MOST_STARTS] = {0}, step[MOST_STARTS][6], root[6][6];
    ptrdiff_t residuals = 2 * body->points;
    for (int k = 0; k < starts; k++) {
        for (int i = 0; i < 9; i++) best[k].rotation[i] = fits[k].rotation[i];
        for (int i = 0; i < 3; i++) best[k].position[i] = fits[k].position[i];
        look_from(&best[k], body, lens, off_px + k * residuals);
    }
    for (int round = 0; round < stop->rounds; round++) {
        double least = INFINITY, gain[MOST_STARTS];
        bool at_end = true;
        for (int k = 0; k < starts; k++) {
            gain[k] = 0.0;
            factor(best[k].information, damping[k], root);
            solve(root, best[k].pull, step[k]);
            for (int i = 0; i < 6; i++) gain[k] += step[k][i] * best[k].pull[i];
            least = fmin(least, best[k].chi2);
        }
        for (int k = 0; k < starts; k++) /* a step would change nothing, or what is beaten with it too */
            at_end = at_end && (gain[k] < stop->converged * (1.0 + best[k].chi2) ||
                                best[k].chi2 - gain[k] > least + stop->beaten_by);
        if (at_end) break;
        for (int k = 0; k < starts; k++) {
            step_from(&best[k], step[k], &trial);
            look_from(&trial, body, lens, trial_px);
            bool better = trial.chi2 < best[k].chi2;
            damping[k] = better ? 0.25 * damping[k] : 1.0 + 4.0 * damping[k];
            if (!better) continue;
            best[k] = trial;
            for (ptrdiff_t i = 0; i < residuals; i++) off_px[k * residuals + i] = trial_px[i];
        }
    }
    for (int k = 0; k < starts; k++) {
        for (int i = 0; i < 9; i++) fits[k].rotation[i] = best[k].rotation[i];
        for (int i = 0; i < 3; i++) fits[k].position[i] = best[k].position[i];
        fits[k].chi2 = best[k].chi2;
        factor(best[k].information, 0.0, root);
        for (int column = 0; column < 6; column++) {
            double unit[6] = {0}, out[6];
            unit[column] = 1.0;
            solve(root, unit, out);
            for (int row = 0; row < 6; row++) fits[k].covariance[6 * row + column] = out[row];
        }
    }
}

/* One body (points, a multiple of 4) from `starts` poses, of which only the `at_most` likeliest are followed: rotations
 * (starts, 9) and positions (starts, 3), `fits` (at_most) with their residuals `off_px` (at_most, points, 2): in the order
 * of the starts, or the likeliest start's first where there are more than `at_most`. `room` is (2, points, 2). Returns how
 * many there are. */
ptrdiff_t ledpi_fit_body(const double *lens_numbers, ptrdiff_t points, const double *place, const double *seen_px,
                         const double *whiteners, ptrdiff_t starts, const double *rotations, const double *positions,
                         ptrdiff_t at_most, const double *stop_numbers, double *numbers, double *off_px, double *room) {
    const Body body = {points, place, seen_px, whiteners};
    const Lens *lens = (const Lens *)lens_numbers;
    const Stop *stop = (const Stop *)stop_numbers;
    Fit *fits = (Fit *)numbers;
    const Stop at_once = {0.0, stop->converged, stop->beaten_by};
    ptrdiff_t count = 0;
    for (ptrdiff_t i = 0; i < starts; i++) {
        Fit start;
        for (int j = 0; j < 9; j++) start.rotation[j] = rotations[9 * i + j];
        for (int j = 0; j < 3; j++) start.position[j] = positions[3 * i + j];
        ledpi_fit(&body, lens, 1, &at_once, &start, room, room + 2 * points);
        if (count == at_most && !(start.chi2 < fits[count - 1].chi2)) continue;
        ptrdiff_t at = count < at_most ? count++ : count - 1;
        for (; starts > at_most && at > 0 && start.chi2 < fits[at - 1].chi2; at--) fits[at] = fits[at - 1];
        fits[at] = start;
    }
    for (ptrdiff_t i = 0; i < count; i++) ledpi_fit(&body, lens, 1, stop, fits + i, off_px + 2 * points * i, room);
    return count;
}
