/* A panel that is followed: the picture that a fit had of it, moved until it lies on the light of another frame.
 *
 * The picture has its slopes by all unknowns where it was fitted, so these, and the inverse of their products, are the same in
 * every round of every frame; the panel moves instead, by the inverse of what the picture would (inverse composition; Baker and
 * Matthews, Lucas-Kanade 20 years on, 2004). Bands are elsewhere in each frame: four columns more, cosine and sine of each wave in
 * the cells that show it. decode/following.py says how long such a picture holds. */
#include <math.h>
#include <string.h>

#include "panel_fit.h"
#include "simd.h"

enum { ROUNDS = 6, MOST_BANDS = 4, MOST_SLOPES = COMMON + MOST_CELLS * MOST_CELLS };
#define SMALL_MOVE 1e-3 /* half sides: what the next round would move is a tenth of it, or less */
#define MOST_LOST 0.01 /* share of the picture's weight: the covariance, which does not know of it, is too small by as much */

/* The pixel of a place in the panel, and how that changes with the place. */
static void put_pixel(const double h[9], const Lens *lens, const double place[2], double pixel[2], double by[2][2]) {
    const double w = 1.0 / (h[6] * place[0] + h[7] * place[1] + h[8]);
    for (int i = 0; i < 2; i++) {
        pixel[i] = (h[3 * i] * place[0] + h[3 * i + 1] * place[1] + h[3 * i + 2]) * w;
        for (int k = 0; k < 2; k++) by[i][k] = (h[3 * i + k] - pixel[i] * h[6 + k]) * w;
    }
    if (!lens) return;
    double seen[2], bent[2][2];
    ledpi_distort(lens, pixel[0], pixel[1], seen, bent);
    for (int k = 0; k < 2; k++) {
        const double x = by[0][k], y = by[1][k];
        by[0][k] = bent[0][0] * x + bent[0][1] * y, by[1][k] = bent[1][0] * x + bent[1][1] * y;
    }
    memcpy(pixel, seen, sizeof seen);
}

/* The corners of what is lit, by the panel's rims, where homography h has them; and their slopes by their places in the panel. */
static void put_lit(Fitting *fit, const double h[9], double lit[8], double by[4][2][2], double hidden[4]) {
    ledpi_panel_put_lit(fit, (double[]){1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}, hidden);
    for (int i = 0; i < 4; i++) put_pixel(h, fit->view.lens, (double[]){fit->lit[i].x, fit->lit[i].y}, lit + 2 * i, by[i]);
}

/* The corners' covariance (8, 8) where they are moved by these slopes. */
static void put_covariance(double by[4][2][2], const double *from, double *to) {
    for (int i = 0; i < 8; i++)
        for (int j = 0; j < 8; j++) {
            const double *const left = by[i / 2][i % 2], *const right = by[j / 2][j % 2], *const of = from + 16 * (i / 2) + 2 * (j / 2);
            to[8 * i + j] = left[0] * (of[0] * right[0] + of[1] * right[1]) + left[1] * (of[8] * right[0] + of[9] * right[1]);
        }
}

static void put_covariance_of(Fitting *fit, const double h[9], const PanelFit *fitted, PanelPicture *p) {
    double lit[8], hidden[4], by[4][2][2], back[4][2][2];
    put_lit(fit, h, lit, by, hidden);
    for (int i = 0; i < 4; i++) {
        const double over = 1.0 / (by[i][0][0] * by[i][1][1] - by[i][0][1] * by[i][1][0]);
        back[i][0][0] = over * by[i][1][1], back[i][0][1] = -over * by[i][0][1];
        back[i][1][0] = -over * by[i][1][0], back[i][1][1] = over * by[i][0][0];
    }
    put_covariance(back, fitted->covariance, p->covariance);
}

/* Puts one sample as the fit explains it, without bands; how much it shows of each wave. Returns its residual, bands included. */
static LEDPI_INLINE double put_sample(const Fitting *fit, const Samples *s, int lane, const Lines *across, const Line *down,
                                      const double *shares, ptrdiff_t at, PanelPicture *p) {
    const ptrdiff_t size = p->lines * p->width;
    const float weight = s->weight[lane];
    float picture = weight * s->predicted[lane];
    for (int k = 0; k < COMMON; k++) p->slopes[k * size + at] = k == PHASE || k == PHASE + 1 ? 0.0f : s->by[k][lane];
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            if (!(across->light[i][lane] * down->light[j] > NO_LIGHT)) continue;
            const ptrdiff_t cell = down->cell[j] * fit->panel.cells + across->cell[i][lane];
            const double *const unknown = fit->unknown + COMMON + OWN * cell;
            const float shown = weight * s->own[j][i][0][lane];
            p->slopes[(COMMON + cell) * size + at] = shown;
            for (ptrdiff_t k = 0; k < p->waves; k++) p->shown[k * size + at] += (float)(shares[cell * p->waves + k] * unknown[0]) * shown;
            for (int k = 0; k < 2; k++) picture -= weight * (float)unknown[1 + k] * s->own[j][i][1 + k][lane];
        }
    p->weight[at] = weight, p->light[at] = picture;
    return s->by[RESIDUAL][lane];
}

/* Weighs each block by what the fit leaves there. */
static void weigh(const Work *work, PanelPicture *p) {
    const ptrdiff_t size = p->lines * p->width;
    for (ptrdiff_t j = 0; j < p->lines; j++)
        for (ptrdiff_t i = 0; i < p->lines; i++) {
            const ptrdiff_t at = j * p->width + i;
            const float root = (float)sqrt(work->weight[work->block[j][i]]);
            p->weight[at] *= root, p->light[at] *= root;
            for (ptrdiff_t k = 0; k < p->unknowns; k++) p->slopes[k * size + at] *= root;
            for (ptrdiff_t k = 0; k < p->waves; k++) p->shown[k * size + at] *= root;
        }
}

LEDPI_SIMD void ledpi_panel_picture(const PanelFit *fitted, const double *shares, PanelPicture *p, uint8_t *room) {
    Work *const work = (Work *)room;
    Fitting fit = ledpi_panel_begun(fitted, NULL);
    const ptrdiff_t cells = fit.panel.cells, size = p->lines * p->width;
    double h[9];
    ledpi_unit_square_homography(fit.corners, h);
    put_covariance_of(&fit, h, fitted, p);
    for (ptrdiff_t i = 0; i < COMMON + OWN * cells * cells; i++) work->unknown[i] = (float)fit.unknown[i];
    ledpi_panel_put_grid(&fit, h, work);
    ledpi_panel_put_blocks(&fit, work);
    memset(p->weight, 0, sizeof(float) * (size_t)size), memset(p->light, 0, sizeof(float) * (size_t)size);
    memset(p->slopes, 0, sizeof(float) * (size_t)(size * p->unknowns)), memset(p->shown, 0, sizeof(float) * (size_t)(size * p->waves));
    memset(work->squares, 0, sizeof work->squares), memset(work->count, 0, sizeof work->count);
    for (ptrdiff_t j = 0; j < p->lines; j++) {
        const Profile profile = ledpi_panel_profile(work->unknown, &work->grid[1][j]);
        for (ptrdiff_t i = 0; i < p->lines; i += LEDPI_WIDTH) {
            Samples s;
            const Lines *const across = work->across + i / LEDPI_WIDTH;
            ledpi_panel_sample_at(&fit, work, &profile, i, j, &s);
            for (int lane = 0; lane < LEDPI_WIDTH && i + lane < p->lines; lane++) {
                if (!s.valid[lane]) continue;
                const ptrdiff_t block = work->block[j][i + lane];
                const double left = put_sample(&fit, &s, lane, across, &work->grid[1][j], shares, j * p->width + i + lane, p);
                work->squares[block] += left * left, work->count[block] += 1.0;
            }
        }
    }
    ledpi_panel_weigh_blocks(cells, work);
    weigh(work, p);
}

/* A frame's unknowns: by the template's slopes, and of the bands; in `room` (2 + 2·MOST_BANDS, size) residuals, rows and
 * the columns of the bands. */
typedef struct {
    double with[MOST_SLOPES], step[MOST_SLOPES], mixed[MOST_BANDS][MOST_SLOPES], by[MOST_BANDS][MOST_SLOPES], bands[MOST_BANDS];
    float *left, *rows, *waves;
    ptrdiff_t count;
} Frame;

/* Puts the residuals and rows of all samples where the panel is. Returns the share of the weight that is not seen. */
static double look(const PanelPicture *p, const Fitting *fit, const double h[9], Frame *frame) {
    float numbers[9];
    double lost = 0.0, all = 0.0;
    for (int k = 0; k < 9; k++) numbers[k] = (float)h[k];
    for (ptrdiff_t at = 0; at < p->lines * p->width; at += LEDPI_WIDTH) {
        Samples s;
        ledpi_panel_look(&fit->panel, &fit->view, numbers, p->along + at % p->width, p->along[at / p->width], &s);
        for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
            const float weight = p->weight[at + lane];
            all += weight * weight, lost += s.valid[lane] ? 0.0 : weight * weight;
            frame->left[at + lane] = s.valid[lane] ? weight * s.seen[lane] - p->light[at + lane] : 0.0f;
            frame->rows[at + lane] = s.row[lane];
        }
    }
    return lost / fmax(all, 1e-12);
}

/* Cosine and sine of so many cycles, to 1e-5: Taylor's series of a quarter turn at most. */
static LEDPI_INLINE void put_turn(Floats cycles, Floats *cosine, Floats *sine) {
    for (int lane = 0; lane < LEDPI_WIDTH; lane++) cycles[lane] -= floorf(cycles[lane] + 0.5f);
    const Floats half = 3.14159265f * cycles, h2 = half * half; /* half of the angle, from which both follow */
    const Floats s = half * (1.0f - h2 / 6.0f * (1.0f - h2 / 20.0f * (1.0f - h2 / 42.0f * (1.0f - h2 / 72.0f))));
    const Floats c = 1.0f - h2 / 2.0f * (1.0f - h2 / 12.0f * (1.0f - h2 / 30.0f * (1.0f - h2 / 56.0f * (1.0f - h2 / 90.0f))));
    *cosine = c * c - s * s, *sine = 2.0f * s * c;
}

static LEDPI_SIMD void put_bands(const PanelPicture *p, const double *cycles_a_row, Frame *frame) {
    const ptrdiff_t size = p->lines * p->width;
    for (ptrdiff_t k = 0; k < p->waves; k++)
        for (ptrdiff_t at = 0; at < size; at += LEDPI_WIDTH) {
            const Floats shown = *(const Floats *)(p->shown + k * size + at);
            Floats cosine, sine;
            put_turn((float)cycles_a_row[k] * *(const Floats *)(frame->rows + at), &cosine, &sine);
            *(Floats *)(frame->waves + 2 * k * size + at) = shown * cosine;
            *(Floats *)(frame->waves + (2 * k + 1) * size + at) = shown * sine;
        }
}

static LEDPI_SIMD void put_products(const PanelPicture *p, const float *column, double *products) {
    const ptrdiff_t size = p->lines * p->width;
    for (ptrdiff_t k = 0; k < p->unknowns; k++) products[k] = ledpi_product(p->slopes + k * size, column, size);
}

/* inverse · column */
static void put_solved(const PanelPicture *p, const double *column, double *solved) {
    for (ptrdiff_t i = 0; i < p->unknowns; i++) {
        const double *const row = p->inverse + i * p->unknowns;
        double sum = 0.0;
        for (ptrdiff_t k = 0; k < p->unknowns; k++) sum += row[k] * column[k];
        solved[i] = sum;
    }
}

/* Puts what the bands are, all else being free, and takes what they explain off the step. */
static void take_bands_off(const PanelPicture *p, Frame *frame) {
    const ptrdiff_t size = p->lines * p->width, count = frame->count, unknowns = p->unknowns;
    double matrix[MOST_BANDS * (MOST_BANDS + 1)];
    for (ptrdiff_t i = 0; i < count; i++) {
        put_products(p, frame->waves + i * size, frame->mixed[i]);
        put_solved(p, frame->mixed[i], frame->by[i]);
    }
    for (ptrdiff_t i = 0; i < count; i++) {
        double *const row = matrix + i * (count + 1);
        for (ptrdiff_t j = i; j < count; j++) {
            row[j] = ledpi_product(frame->waves + i * size, frame->waves + j * size, size) + (i == j ? p->ridge[i / 2] : 0.0);
            for (ptrdiff_t k = 0; k < unknowns; k++) row[j] -= frame->mixed[i][k] * frame->by[j][k];
        }
        row[count] = ledpi_product(frame->waves + i * size, frame->left, size);
        for (ptrdiff_t k = 0; k < unknowns; k++) row[count] -= frame->mixed[i][k] * frame->step[k];
    }
    ledpi_eliminate(matrix, count, 0, count);
    ledpi_solve(matrix, count, frame->bands);
    for (ptrdiff_t i = 0; i < count; i++)
        for (ptrdiff_t k = 0; k < unknowns; k++) frame->step[k] -= frame->bands[i] * frame->by[i][k];
}

/* The mean square of what is left within the panel, and which share of the squares about the light's mean is not. */
static LEDPI_SIMD void put_left(const PanelPicture *p, Frame *frame, PanelFit *into) {
    const ptrdiff_t size = p->lines * p->width;
    double left2 = 0.0, samples = 0.0, used = 0.0, light = 0.0, light2 = 0.0;
    for (ptrdiff_t at = 0; at < size; at += LEDPI_WIDTH) {
        Floats left = *(Floats *)(frame->left + at);
        const Floats weight = *(const Floats *)(p->weight + at), seen = left + *(const Floats *)(p->light + at);
        for (ptrdiff_t k = 0; k < p->unknowns; k++) left -= (float)frame->step[k] * *(const Floats *)(p->slopes + k * size + at);
        for (ptrdiff_t k = 0; k < frame->count; k++) left -= (float)frame->bands[k] * *(const Floats *)(frame->waves + k * size + at);
        const float v = p->along[at / p->width];
        for (int lane = 0; lane < LEDPI_WIDTH; lane++) {
            const float u = p->along[at % p->width + lane];
            if (!(weight[lane] > 0.0f && u > 0.0f && u < 1.0f && v > 0.0f && v < 1.0f)) continue;
            left2 += left[lane] * left[lane], samples += 1.0;
            used += weight[lane] * weight[lane], light += weight[lane] * seen[lane], light2 += seen[lane] * seen[lane];
        }
    }
    into->variance = left2 / fmax(samples - (double)(p->unknowns + frame->count), 1.0);
    into->explained = 1.0 - left2 / fmax(light2 - light * light / fmax(used, 1e-12), 1e-12);
}

/* The light of all cells over that when they were fitted. */
static double gain_of(const Fitting *fit, const double *step) {
    const ptrdiff_t cells = fit->panel.cells;
    double usual = 0.0, gain = 0.0;
    for (ptrdiff_t c = 0; c < cells * cells; c++) usual += fit->unknown[COMMON + OWN * c], gain += step[COMMON + c];
    return 1.0 + gain / usual;
}

bool ledpi_follow_panel(PanelFit *asked, const PanelPicture *p, float *room) {
    Fitting fit = ledpi_panel_begun(asked, NULL);
    const ptrdiff_t size = p->lines * p->width;
    Frame frame = {.left = room, .rows = room + size, .waves = room + 2 * size};
    double h[9], most = INFINITY, lost = 1.0;
    for (int round = 0; round < ROUNDS && !(most < SMALL_MOVE && round > 1); round++) {
        ledpi_unit_square_homography(fit.corners, h);
        for (int k = 0; k < 9; k++)
            if (!isfinite(h[k])) return false;
        lost = look(p, &fit, h, &frame);
        put_products(p, frame.left, frame.with);
        for (ptrdiff_t k = 0; k < p->unknowns; k++) frame.with[k] += p->pull[k];
        put_solved(p, frame.with, frame.step);
        frame.count = round ? 2 * p->waves : 0;
        if (round) {
            put_bands(p, asked->cycles_a_row, &frame);
            take_bands_off(p, &frame);
        }
        most = ledpi_panel_compose(h, frame.step, gain_of(&fit, frame.step), fit.corners);
        if (!isfinite(most)) return false;
        asked->sampled += p->lines * p->lines;
    }
    put_left(p, &frame, asked);
    asked->settled = most < SMALL_MOVE && lost < MOST_LOST;
    ledpi_unit_square_homography(fit.corners, h);
    double by[4][2][2];
    put_lit(&fit, h, asked->lit, by, asked->hidden);
    put_covariance(by, p->covariance, asked->covariance);
    for (int i = 0; i < 4; i++) put_pixel(h, fit.view.lens, (double[]){i == 1 || i == 2, i > 1}, asked->corners + 2 * i, by[i]);
    return true;
}
