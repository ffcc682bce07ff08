/* What a fitted panel's light says of the bands in each cell: the fit's own equation once more, with bands that are free.
 *
 * About the fit, light is linear in what is not known: the panel's COMMON, each cell's gain, cosine and sine of each wave in
 * each cell. On a grid that is the same in every cell the profile needs no shapes: it has one free value at each place of a
 * cell, which all cells share in proportion to what they show there. That is projected out of each place's samples. Of the
 * normal equations COMMON and gains are eliminated, held by the fit's priors; what is left are score and information of the
 * bands, over the variance of what they leave. */
#include <math.h>
#include <string.h>

#include "panel_fit.h"
#include "simd.h"

#define TURN 6.283185307179586
enum {
    MOST_EACH = 12, LINES = MOST_EACH * MOST_CELLS, /* of the grid: along a cell, and in all */
    FREE = 5, MOST_FREE = FREE * MOST_CELLS * MOST_CELLS, /* of a cell: its gain, cosine and sine of either wave; of all */
    MOST_SUMS = DENSE + MOST_FREE, /* a multiple of LEDPI_WIDTH */
};
/* Pixels: noise that is further apart is not alike in any picture; what is alike there is light that was not explained. */
static const double FURTHEST_PX = 2.0;

/* The cells that meet at a sample, its slopes by their FREE, and the light that they show there without bands; none where the
 * sample tells nothing. */
typedef struct {
    int count;
    ptrdiff_t cell[4];
    float by[4][FREE], shown;
} Met;

/* Sums over the grid: products of the samples' columns (COMMON, residual, padding) and the cells' FREE; and, at each place of a
 * cell, of what is shown there times all of these, over its norm: what their products explain is `shared2`. */
typedef struct {
    float columns[LINES][LINES][DENSE], left[LINES][LINES];
    Met met[LINES][LINES];
    float common[DENSE * DENSE], mixed[MOST_FREE][DENSE], own[MOST_FREE * MOST_FREE];
    float shared[MOST_EACH * MOST_EACH * MOST_SUMS], shared2[MOST_SUMS * MOST_SUMS];
    double matrix[MOST_SUMS * (MOST_SUMS + 1)], solution[MOST_SUMS];
    ptrdiff_t samples, places;
} Sums;

typedef struct {
    Work work;
    Sums sums;
} Room;

ptrdiff_t ledpi_panel_evidence_room(void) { return (ptrdiff_t)sizeof(Room); }

typedef struct {
    Fitting fit;
    const PanelEvidence *asked;
    ptrdiff_t each, free, frees, width; /* samples along a cell; of a cell's FREE those that are sought; of all cells; DENSE with
                                         * these, padded */
} Weighing;

/* The slopes at a sample by what is free of a cell: what cosine and sine of each wave are, the waveform at the fit's phase and
 * its slope make up. */
static LEDPI_INLINE void put_free(const Weighing *w, const Samples *s, int lane, float shown, float gain, float by[FREE]) {
    by[0] = shown;
    for (int k = 0; 2 * k + 1 < w->free; k++) {
        const float cosine = gain * (float)w->asked->turn[k][0], sine = gain * (float)w->asked->turn[k][1];
        const float wave = shown * s->wave[k][lane], later = shown * s->later[k][lane] * (float)(1.0 / TURN);
        by[1 + 2 * k] = cosine * wave - sine * later;
        by[2 + 2 * k] = -sine * wave - cosine * later;
    }
}

/* Puts one sample, its residual being that of the panel without bands. */
static LEDPI_INLINE void put_sample(const Weighing *w, const Samples *s, int lane, const Lines *across, const Line *down, float *columns,
                                    Met *met) {
    const float weight = s->weight[lane];
    for (int k = 0; k < DENSE; k++) columns[k] = s->by[k][lane];
    columns[PHASE] = columns[PHASE + 1] = 0.0f; /* bands are free instead */
    met->shown = 0.0f;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            if (!(across->light[i][lane] * down->light[j] > NO_LIGHT)) continue;
            met->cell[met->count] = down->cell[j] * w->fit.panel.cells + across->cell[i][lane];
            const double *unknown = w->fit.unknown + COMMON + OWN * met->cell[met->count];
            const float shown = weight * s->own[j][i][0][lane], gain = (float)unknown[0];
            put_free(w, s, lane, shown, gain, met->by[met->count++]);
            met->shown += shown * gain;
            for (int k = 0; k < 2; k++) columns[RESIDUAL] += weight * (float)unknown[1 + k] * s->own[j][i][1 + k][lane];
        }
}

/* Puts the samples of the grid that are within the panel and tell something. */
static LEDPI_SIMD void put_samples(const Weighing *w, Work *work, Sums *sums) {
    const Fitting *const fit = &w->fit;
    sums->samples = 0;
    for (ptrdiff_t j = 0; j < fit->lines; j++)
        for (ptrdiff_t i = 0; i < fit->lines; i += LEDPI_WIDTH) {
            Samples s;
            const Lines *const across = work->across + i / LEDPI_WIDTH;
            ledpi_panel_sample(&fit->panel, &fit->view, work->numbers, work->unknown, across, &work->grid[1][j],
                               (float)(fit->along[j] / (double)fit->panel.cells), &s);
            for (int lane = 0; lane < LEDPI_WIDTH && i + lane < fit->lines; lane++) {
                sums->met[j][i + lane].count = 0, sums->left[j][i + lane] = 0.0f;
                memset(sums->columns[j][i + lane], 0, sizeof **sums->columns);
                if (!s.tells[lane] || !(s.outside[lane] < 0.5f)) continue;
                put_sample(w, &s, lane, across, &work->grid[1][j], sums->columns[j][i + lane], &sums->met[j][i + lane]);
                sums->left[j][i + lane] = s.by[RESIDUAL][lane];
                sums->samples += sums->met[j][i + lane].count > 0;
            }
        }
}

/* Does something at each place of a cell, `across` and `down`. */
static void each_place(const Weighing *w, void (*act)(const Weighing *, ptrdiff_t across, ptrdiff_t down, Sums *), Sums *sums) {
    for (ptrdiff_t j = 0; j < w->each; j++)
        for (ptrdiff_t i = 0; i < w->each; i++) act(w, i, j, sums);
}

/* Takes off the residuals at a place of every cell what the one value that cells share there explains of them. */
static LEDPI_SIMD void take_shared_off(const Weighing *w, ptrdiff_t across, ptrdiff_t down, Sums *sums) {
    double shown2 = 0.0, with_left = 0.0;
    for (ptrdiff_t j = down; j < w->fit.lines; j += w->each)
        for (ptrdiff_t i = across; i < w->fit.lines; i += w->each) {
            if (!sums->met[j][i].count) continue;
            const double shown = sums->met[j][i].shown;
            shown2 += shown * shown, with_left += shown * sums->left[j][i];
        }
    for (ptrdiff_t j = down; j < w->fit.lines; j += w->each)
        for (ptrdiff_t i = across; i < w->fit.lines; i += w->each)
            if (sums->met[j][i].count) sums->left[j][i] -= (float)(with_left / fmax(shown2, 1e-12)) * sums->met[j][i].shown;
}

/* Weighs each block by what the fit, and what cells share, leave there. Returns their variance. */
static LEDPI_SIMD double weigh_samples(const Weighing *w, Work *work, Sums *sums) {
    const ptrdiff_t cells = w->fit.panel.cells, lines = w->fit.lines;
    const double *const along = w->fit.along;
    double left2 = 0.0;
    memset(work->squares, 0, sizeof work->squares);
    memset(work->count, 0, sizeof work->count);
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) {
            const ptrdiff_t block = ledpi_panel_block(along[i], along[j], cells);
            if (!sums->met[j][i].count) continue;
            work->squares[block] += sums->left[j][i] * sums->left[j][i], work->count[block] += 1.0;
        }
    for (ptrdiff_t b = 0; b < MOST_BLOCKS; b++) work->weight[b] = 1.0;
    ledpi_panel_weigh_blocks(cells, work);
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) {
            Met *const met = &sums->met[j][i];
            const float root = (float)sqrt(work->weight[ledpi_panel_block(along[i], along[j], cells)]);
            left2 += root * root * sums->left[j][i] * sums->left[j][i];
            for (int k = 0; k < DENSE; k++) sums->columns[j][i][k] *= root;
            for (int m = 0; m < met->count; m++)
                for (int k = 0; k < FREE; k++) met->by[m][k] *= root;
            met->shown *= root;
        }
    return left2 / fmax((double)sums->samples, 1.0);
}

/* `to` += `factor` × the columns. */
static LEDPI_INLINE void add_columns(float factor, const float *columns, float *to) {
    for (int column = 0; column < DENSE; column += LEDPI_WIDTH) *(Eight *)(to + column) += factor * *(const Eight *)(columns + column);
}

static LEDPI_INLINE void add_met(const Weighing *w, const Met *met, const float *columns, Sums *sums) {
    for (int i = 0; i < met->count; i++)
        for (ptrdiff_t k = 0; k < w->free; k++) {
            const ptrdiff_t row = met->cell[i] * w->free + k;
            add_columns(met->by[i][k], columns, sums->mixed[row]);
            for (int j = 0; j < met->count; j++)
                for (ptrdiff_t n = 0; n < w->free; n++) sums->own[row * w->frees + met->cell[j] * w->free + n] += met->by[i][k] * met->by[j][n];
        }
}

/* Puts what the one value explains that cells share at a place of theirs, `across` and `down`. */
static LEDPI_SIMD void put_shared(const Weighing *w, ptrdiff_t across, ptrdiff_t down, Sums *sums) {
    float *const shared = sums->shared + sums->places * w->width, shown2 = 0.0f;
    memset(shared, 0, sizeof *shared * (size_t)w->width);
    for (ptrdiff_t j = down; j < w->fit.lines; j += w->each)
        for (ptrdiff_t i = across; i < w->fit.lines; i += w->each) {
            const Met *const met = &sums->met[j][i];
            if (!met->count) continue;
            shown2 += met->shown * met->shown;
            add_columns(met->shown, sums->columns[j][i], shared);
            for (int m = 0; m < met->count; m++)
                for (ptrdiff_t k = 0; k < w->free; k++) shared[DENSE + met->cell[m] * w->free + k] += met->shown * met->by[m][k];
        }
    if (!(shown2 > 0.0f)) return;
    const float norm = 1.0f / sqrtf(shown2);
    for (ptrdiff_t k = 0; k < w->width; k++) shared[k] *= norm;
    sums->places++;
}

static LEDPI_SIMD void sum_up(const Weighing *w, Sums *sums) {
    memset(sums->common, 0, sizeof sums->common);
    memset(sums->mixed, 0, sizeof *sums->mixed * (size_t)w->frees);
    memset(sums->own, 0, sizeof *sums->own * (size_t)(w->frees * w->frees));
    sums->places = 0;
    for (ptrdiff_t j = 0; j < w->fit.lines; j++) {
        ledpi_add_products(*sums->columns[j], w->fit.lines, DENSE, sums->common);
        for (ptrdiff_t i = 0; i < w->fit.lines; i++) add_met(w, &sums->met[j][i], sums->columns[j][i], sums);
    }
    each_place(w, put_shared, sums);
    memset(sums->shared2, 0, sizeof *sums->shared2 * (size_t)(w->width * w->width));
    ledpi_add_products(sums->shared, sums->places, w->width, sums->shared2);
}

/* Where one of all cells' FREE is in the matrix: after COMMON the gains, then the bands, cell by cell. */
static ptrdiff_t place_of(const Weighing *w, ptrdiff_t one) {
    const ptrdiff_t cell = one / w->free, k = one % w->free;
    return COMMON + (k ? w->frees / w->free + (w->free - 1) * cell + k - 1 : cell);
}

/* Adds what is known of an unknown beforehand, in units of the variance. Returns by how many squares the fit is off that. */
static double add_prior(const Weighing *w, ptrdiff_t unknown, double variance, ptrdiff_t at, double *matrix) {
    const ptrdiff_t all = COMMON + OWN * w->fit.panel.cells * w->fit.panel.cells, size = COMMON + w->frees;
    const double weight = variance * w->fit.prior[all + unknown];
    const double off = unknown < WAYS ? 0.0 : w->fit.prior[unknown] - w->fit.unknown[unknown];
    matrix[at * (size + 2)] += weight;
    matrix[at * (size + 1) + size] += weight * off;
    return weight * off * off;
}

/* The normal equations, right side last. Returns all squares, those of what is known beforehand, too. */
static double put_matrix(const Weighing *w, const Sums *sums, double variance, double *matrix) {
    const ptrdiff_t frees = w->frees, size = COMMON + frees, stride = size + 1, width = w->width;
    double squares = sums->common[RESIDUAL * (DENSE + 1)] - sums->shared2[RESIDUAL * (width + 1)];
    for (ptrdiff_t i = 0; i < COMMON; i++) {
        const float *const common = sums->common + i * DENSE, *const shared2 = sums->shared2 + i * width;
        for (ptrdiff_t j = i; j < COMMON; j++) matrix[i * stride + j] = common[j] - shared2[j];
        for (ptrdiff_t e = 0; e < frees; e++) matrix[i * stride + place_of(w, e)] = sums->mixed[e][i] - shared2[DENSE + e];
        matrix[i * stride + size] = common[RESIDUAL] - shared2[RESIDUAL];
        if (i != PHASE && i != PHASE + 1) squares += add_prior(w, i, variance, i, matrix);
    }
    for (ptrdiff_t e = 0; e < frees; e++) {
        const ptrdiff_t at = place_of(w, e);
        for (ptrdiff_t f = e; f < frees; f++) {
            const ptrdiff_t to = place_of(w, f), row = at < to ? at : to, column = at < to ? to : at;
            matrix[row * stride + column] = sums->own[e * frees + f] - sums->shared2[(DENSE + e) * width + DENSE + f];
        }
        matrix[at * stride + size] = sums->mixed[e][RESIDUAL] - sums->shared2[RESIDUAL * width + DENSE + e];
        if (e % w->free == 0) squares += add_prior(w, COMMON + OWN * (e / w->free), variance, at, matrix);
    }
    return squares;
}

/* Puts the residuals of all samples by the solution. */
static LEDPI_SIMD void put_left(const Weighing *w, Sums *sums) {
    float by[DENSE] = {0}, own[MOST_FREE];
    for (int k = 0; k < COMMON; k++) by[k] = (float)-sums->solution[k];
    by[RESIDUAL] = 1.0f;
    for (ptrdiff_t e = 0; e < w->frees; e++) own[e] = (float)sums->solution[place_of(w, e)];
    for (ptrdiff_t j = 0; j < w->fit.lines; j++)
        for (ptrdiff_t i = 0; i < w->fit.lines; i++) {
            const Met *const met = &sums->met[j][i];
            float left = 0.0f;
            Eight sum = {0};
            for (int k = 0; k < DENSE; k += LEDPI_WIDTH) sum += *(const Eight *)(by + k) * *(const Eight *)(sums->columns[j][i] + k);
            for (int k = 0; k < LEDPI_WIDTH; k++) left += sum[k];
            for (int m = 0; m < met->count; m++)
                for (ptrdiff_t k = 0; k < w->free; k++) left -= met->by[m][k] * own[met->cell[m] * w->free + k];
            sums->left[j][i] = left;
        }
}

/* The mean product of the residuals of two samples that are so many lines apart. */
static LEDPI_SIMD double alike(const Sums *sums, ptrdiff_t lines, ptrdiff_t aside, ptrdiff_t below) {
    double sum = 0.0, count = 0.0;
    for (ptrdiff_t j = below; j < lines; j++)
        for (ptrdiff_t i = aside > 0 ? aside : 0; i < lines + (aside < 0 ? aside : 0); i++) {
            if (!sums->met[j][i].count || !sums->met[j - below][i - aside].count) continue;
            sum += (double)sums->left[j][i] * sums->left[j - below][i - aside], count += 1.0;
        }
    return sum / fmax(count, 1.0);
}

/* By how much noise that is alike in samples near each other makes what bands meet of it vary more than if it were not: the sum
 * of its autocorrelation. What the fit takes of it makes samples near each other less alike, by its share of them. */
static double inflation_of(const Weighing *w, const Sums *sums) {
    const double *const step_px = w->asked->step_px, left = (double)(sums->samples - sums->places), lost = (left - w->asked->freedom) / left;
    const double variance = alike(sums, w->fit.lines, 0, 0) / (1.0 - lost);
    const ptrdiff_t most_below = (ptrdiff_t)fmin(FURTHEST_PX / step_px[1], (double)(w->each - 1));
    const ptrdiff_t most_aside = (ptrdiff_t)fmin(FURTHEST_PX / step_px[0], (double)(w->each - 1));
    double inflation = 1.0;
    for (ptrdiff_t below = 0; below <= most_below; below++)
        for (ptrdiff_t aside = below ? -most_aside : 1; aside <= most_aside; aside++)
            if (ledpi_length((double)aside * step_px[0], (double)below * step_px[1]) <= FURTHEST_PX)
                inflation += 2.0 * (alike(sums, w->fit.lines, aside, below) / fmax(variance, 1e-12) + lost);
    return fmax(1.0, inflation);
}

bool ledpi_panel_evidence(PanelEvidence *asked, uint8_t *room) {
    Work *const work = &((Room *)room)->work;
    Sums *const sums = &((Room *)room)->sums;
    const ptrdiff_t cells = asked->fit.cells, n = cells * cells;
    if (asked->fit.lines > LINES || cells > MOST_CELLS) return false;
    Weighing w = {.fit = ledpi_panel_begun(&asked->fit, &asked->fit), .asked = asked, .each = asked->fit.lines / cells};
    w.free = 1 + 2 * asked->waves, w.frees = w.free * n;
    w.width = DENSE + (w.frees + LEDPI_WIDTH - 1) / LEDPI_WIDTH * LEDPI_WIDTH;
    const ptrdiff_t size = COMMON + w.frees;
    double h[9];
    ledpi_unit_square_homography(w.fit.corners, h);
    for (ptrdiff_t i = 0; i < COMMON + OWN * n; i++) work->unknown[i] = (float)w.fit.unknown[i];
    ledpi_panel_put_grid(&w.fit, h, work);
    put_samples(&w, work, sums);
    each_place(&w, take_shared_off, sums);
    const double variance = weigh_samples(&w, work, sums);
    sum_up(&w, sums);
    asked->freedom = (double)(sums->samples - sums->places - size);
    const double squares = put_matrix(&w, sums, variance, sums->matrix);
    if (!ledpi_weigh(sums->matrix, size, COMMON + n, squares, asked->freedom, 1.0, asked->score, asked->information)) return false;
    ledpi_solve(sums->matrix, size, sums->solution);
    put_left(&w, sums);
    each_place(&w, take_shared_off, sums);
    asked->inflation = inflation_of(&w, sums);
    return true;
}
