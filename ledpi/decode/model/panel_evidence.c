/* Evidence of a fitted panel's light for the bands in each cell: the fit's own equation once more, with bands that are free.
 *
 * About the fit, light is linear in what is not known: the panel's COMMON, each cell's gain, cosine and sine of each wave in
 * each cell. Of the normal equations COMMON and gains are eliminated, held by the fit's priors; what is left are score and
 * information of the bands, over the variance of what they leave.
 *
 * Of a frame alone, or the mean of several, the grid is the same in every cell, so that the profile needs no shapes: it has one
 * free value at each place of a cell, which all cells share in proportion to what they show there. That is projected out of
 * each place's samples. A frame that is compared with the mean of those before differs from it in bands, in what moves it
 * (COMMON, as far as it is not built into the panel) and in the light's level; a mean of n frames has a noise of its own. */
#include <math.h>
#include <string.h>

#include "panel_evidence.h"
#include "simd.h"

#define TURN 6.283185307179586
/* Indices in COMMON, which lacks phases here, as bands are free: the light's level, where frames are compared. */
#define LEVEL PHASE

typedef struct {
    Work work;
    Sums sums;
} Room;

ptrdiff_t ledpi_panel_evidence_room(void) { return (ptrdiff_t)sizeof(Room); }

/* Cosine and sine of each wave in a sample's row; where its phase is known, with the harmonics that it then has: the wave there and
 * its slope, turned to a phase of 0. */
static LEDPI_INLINE void put_waves(const Weighing *w, float row, float waves[FREE - 1]) {
    for (ptrdiff_t k = 0; k < w->asked->waves; k++) {
        if (w->asked->turns) {
            const float *const turn = w->asked->turns + 2 * k;
            float later;
            const float wave = ledpi_panel_wave(&w->fit.panel, k, (float)w->asked->phases[k], row, &later);
            later /= (float)TURN;
            waves[2 * k] = turn[0] * wave + turn[1] * later, waves[2 * k + 1] = turn[1] * wave - turn[0] * later;
            continue;
        }
        const float cycles = (float)w->asked->cycles_before[k] + row * (float)w->fit.panel.cycles_a_row[k];
        const float angle = (float)TURN * (cycles - rintf(cycles));
        waves[2 * k] = (float)w->asked->row_average[k] * cosf(angle), waves[2 * k + 1] = (float)w->asked->row_average[k] * sinf(angle);
    }
}

/* Puts the cells that meet at a sample: the slopes of their light by gain in the last of their FREE, how much the fit's bands add
 * to it in the first; of a mean of frames, which has others, none. Returns these bands. */
static LEDPI_INLINE float fill_overlap(const Weighing *w, const Samples *s, int lane, const Lines *across, const Line *down, CellOverlap *overlap) {
    float bands = 0.0f;
    overlap->shown = 0.0f;
    for (int j = 0; j < 2; j++)
        for (int i = 0; i < 2; i++) {
            if (!(across->light[i][lane] * down->light[j] > NO_LIGHT)) continue;
            overlap->cell[overlap->count] = down->cell[j] * w->fit.panel.cells + across->cell[i][lane];
            const double *unknown = w->fit.unknown + COMMON + OWN * overlap->cell[overlap->count];
            const float by_gain = s->own[j][i][0][lane], light = (float)unknown[0] * by_gain;
            float own = 0.0f, *const by = overlap->by[overlap->count++];
            for (int k = 0; k < 2; k++) own += (float)unknown[1 + k] * s->own[j][i][1 + k][lane];
            by[0] = w->asked->mean_light ? 0.0f : fminf(1.0f, fmaxf(-1.0f, own / fmaxf(light, 1e-12f)));
            by[FREE - 1] = by_gain;
            for (int k = FREE; k < PADDED; k++) by[k] = 0.0f;
            overlap->shown += light * (1.0f + by[0]);
            bands += own;
        }
    return bands;
}

/* A sample: of a frame by itself, of the mean, or of how they differ; and the deviation of its noise, over one
 * frame's. */
typedef struct {
    float left, level, deviation, waves[FREE - 1];
} Shown;

static LEDPI_INLINE Shown shown_at(const Weighing *w, const Samples *s, int lane, float bands, ptrdiff_t at) {
    const PanelEvidence *const asked = w->asked;
    const ptrdiff_t all = w->fit.lines * w->fit.lines;
    const float seen = s->seen[lane], steady = s->predicted[lane] - bands;
    Shown shown = {.left = seen - steady, .level = 0.0f, .deviation = 1.0f};
    put_waves(w, s->row[lane], shown.waves);
    asked->light[at] = seen, asked->valid[at] = 1.0f;
    for (ptrdiff_t p = 0; p < 2 * asked->waves; p++) asked->wave[p * all + at] = shown.waves[p];
    if (!asked->mean_light) return shown;
    const float mean = asked->mean_light[at], before = asked->mean_count[at];
    shown.left = asked->compared ? seen - mean : mean - steady;
    if (asked->compared) shown.level = mean, shown.deviation = sqrtf((before + 1.0f) / fmaxf(before, 1e-6f));
    for (ptrdiff_t p = 0; p < 2 * asked->waves; p++)
        shown.waves[p] = asked->mean_wave[p * all + at] * (asked->compared ? -1.0f : 1.0f) + (asked->compared ? shown.waves[p] : 0.0f);
    return shown;
}

/* Puts the columns of a sample, over its deviation. */
static LEDPI_INLINE void put_sample(const Weighing *w, const Samples *s, int lane, const Shown *shown, float *columns, CellOverlap *overlap) {
    const float less = 1.0f / shown->deviation, weight = s->weight[lane] * less;
    const ptrdiff_t gain = !w->asked->compared;
    for (int k = 0; k < DENSE; k++) columns[k] = less * s->by[k][lane];
    columns[RESIDUAL] = weight * shown->left, columns[LEVEL] = weight * shown->level, columns[PHASE + 1] = 0.0f;
    if (gain) columns[DARK] = 0.0f; /* as fitted: what is beside the panel tells it, and no sample here is there */
    for (int m = 0; m < overlap->count; m++) {
        const float by_gain = weight * overlap->by[m][FREE - 1], light = by_gain * (float)w->fit.unknown[COMMON + OWN * overlap->cell[m]];
        if (gain) overlap->by[m][0] = by_gain * (1.0f + overlap->by[m][0]);
        for (ptrdiff_t p = 0; p < 2 * w->asked->waves; p++) overlap->by[m][gain + p] = light * shown->waves[p];
    }
    overlap->shown *= weight;
}

/* Puts the samples of the grid that are within the panel and tell something. */
static LEDPI_SIMD void put_samples(const Weighing *w, Work *work, Sums *sums) {
    const Fitting *const fit = &w->fit;
    sums->samples = 0;
    for (ptrdiff_t j = 0; j < fit->lines; j++) {
        const Profile profile = ledpi_panel_profile(work->unknown, &work->grid[1][j]);
        for (ptrdiff_t i = 0; i < fit->lines; i += LEDPI_WIDTH) {
            Samples s;
            const Lines *const across = work->across + i / LEDPI_WIDTH;
            ledpi_panel_sample_at(fit, work, &profile, i, j, &s);
            for (int lane = 0; lane < LEDPI_WIDTH && i + lane < fit->lines; lane++) {
                const ptrdiff_t x = i + lane, at = j * fit->lines + x;
                CellOverlap *const overlap = &sums->overlap[j][x];
                overlap->count = 0, sums->left[j][x] = sums->root[j][x] = w->asked->light[at] = w->asked->valid[at] = 0.0f;
                memset(sums->columns[j][x], 0, sizeof **sums->columns);
                if (!s.valid[lane] || !(s.outside[lane] < 0.5f)) continue;
                const float bands = fill_overlap(w, &s, lane, across, &work->grid[1][j], overlap);
                const Shown shown = shown_at(w, &s, lane, bands, at);
                if (w->asked->mean_light && !(w->asked->mean_count[at] > 0.0f)) overlap->count = 0;
                if (!overlap->count) continue;
                put_sample(w, &s, lane, &shown, sums->columns[j][x], overlap);
                sums->root[j][x] = s.weight[lane] / shown.deviation;
                sums->left[j][x] = w->asked->mean_light ? sums->columns[j][x][RESIDUAL] : s.by[RESIDUAL][lane];
                sums->samples++;
            }
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
            if (!sums->overlap[j][i].count) continue;
            const double shown = sums->overlap[j][i].shown;
            shown2 += shown * shown, with_left += shown * sums->left[j][i];
        }
    for (ptrdiff_t j = down; j < w->fit.lines; j += w->each)
        for (ptrdiff_t i = across; i < w->fit.lines; i += w->each)
            if (sums->overlap[j][i].count) sums->left[j][i] -= (float)(with_left / fmax(shown2, 1e-12)) * sums->overlap[j][i].shown;
}

static LEDPI_INLINE void weigh(float root, ptrdiff_t j, ptrdiff_t i, Sums *sums) {
    CellOverlap *const overlap = &sums->overlap[j][i];
    for (int k = 0; k < DENSE; k++) sums->columns[j][i][k] *= root;
    for (int m = 0; m < overlap->count; m++)
        for (int k = 0; k < FREE; k++) overlap->by[m][k] *= root;
    overlap->shown *= root, sums->left[j][i] *= root, sums->root[j][i] *= root;
}

/* Weighs each place of a cell by what the fit, and what cells share, leave there and around it in all cells: they are less alike
 * beside walls than within. */
static LEDPI_SIMD void weigh_places(const Weighing *w, Sums *sums) {
    const ptrdiff_t each = w->each, lines = w->fit.lines;
    double left2[MOST_EACH + 2][MOST_EACH + 2] = {{0}}, count[MOST_EACH + 2][MOST_EACH + 2] = {{0}}, all2 = 0.0;
    float root[MOST_EACH][MOST_EACH];
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) {
            if (!sums->overlap[j][i].count) continue;
            const double square = sums->left[j][i] * sums->left[j][i];
            left2[1 + j % each][1 + i % each] += square, count[1 + j % each][1 + i % each] += 1.0, all2 += square;
        }
    for (ptrdiff_t j = 0; j < each; j++)
        for (ptrdiff_t i = 0; i < each; i++) {
            double around2 = 0.0, around = 0.0;
            for (ptrdiff_t k = 0; k < 9; k++) around2 += left2[j + k / 3][i + k % 3], around += count[j + k / 3][i + k % 3];
            root[j][i] = (float)sqrt(all2 / fmax((double)sums->samples, 1.0) * around / fmax(around2, 1e-12));
        }
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) weigh(root[j % each][i % each], j, i, sums);
}

/* Weighs each block by what the fit, and what cells share, leave there. Returns their variance. */
static LEDPI_SIMD double weigh_blocks(const Weighing *w, Work *work, Sums *sums) {
    const ptrdiff_t cells = w->fit.panel.cells, lines = w->fit.lines;
    double left2 = 0.0;
    ledpi_panel_put_blocks(&w->fit, work);
    memset(work->squares, 0, sizeof work->squares);
    memset(work->count, 0, sizeof work->count);
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) {
            const ptrdiff_t block = work->block[j][i];
            if (!sums->overlap[j][i].count) continue;
            work->squares[block] += sums->left[j][i] * sums->left[j][i], work->count[block] += 1.0;
        }
    for (ptrdiff_t b = 0; b < MOST_BLOCKS; b++) work->weight[b] = 1.0;
    ledpi_panel_weigh_blocks(cells, work);
    for (ptrdiff_t j = 0; j < lines; j++)
        for (ptrdiff_t i = 0; i < lines; i++) {
            weigh((float)sqrt(work->weight[work->block[j][i]]), j, i, sums);
            if (sums->overlap[j][i].count) left2 += sums->left[j][i] * sums->left[j][i];
        }
    return left2 / fmax((double)sums->samples, 1.0);
}

/* `to` += `factor` × the columns, `count` of them. */
static LEDPI_INLINE void add_columns(float factor, const float *columns, const int count, float *to) {
    for (int column = 0; column < count; column += LEDPI_WIDTH) *(Floats *)(to + column) += factor * *(const Floats *)(columns + column);
}

static LEDPI_INLINE void add_overlap(const Weighing *w, const CellOverlap *overlap, const float *columns, Sums *sums) {
    for (int i = 0; i < overlap->count; i++)
        for (ptrdiff_t k = 0; k < w->free; k++) {
            const ptrdiff_t row = overlap->cell[i] * w->free + k;
            add_columns(overlap->by[i][k], columns, DENSE, sums->mixed[row]);
            for (int j = 0; j < overlap->count; j++) add_columns(overlap->by[i][k], overlap->by[j], PADDED, sums->own[row][overlap->cell[j]]);
        }
}

/* Puts what the one value explains that cells share at a place of theirs, `across` and `down`. */
static LEDPI_SIMD void put_shared(const Weighing *w, ptrdiff_t across, ptrdiff_t down, Sums *sums) {
    const ptrdiff_t place = down * w->each + across;
    float *const shared = sums->shared + place * w->width, shown2 = 0.0f;
    sums->norm[place] = 0.0f;
    memset(shared, 0, sizeof *shared * (size_t)w->width);
    for (ptrdiff_t j = down; j < w->fit.lines; j += w->each)
        for (ptrdiff_t i = across; i < w->fit.lines; i += w->each) {
            const CellOverlap *const overlap = &sums->overlap[j][i];
            if (!overlap->count) continue;
            shown2 += overlap->shown * overlap->shown;
            add_columns(overlap->shown, sums->columns[j][i], DENSE, shared);
            for (int m = 0; m < overlap->count; m++)
                for (ptrdiff_t k = 0; k < w->free; k++) shared[DENSE + overlap->cell[m] * w->free + k] += overlap->shown * overlap->by[m][k];
        }
    if (!(shown2 > 0.0f)) return;
    const float norm = sums->norm[place] = 1.0f / sqrtf(shown2);
    for (ptrdiff_t k = 0; k < w->width; k++) shared[k] *= norm;
    sums->places++;
}

static LEDPI_SIMD void sum_up(const Weighing *w, Sums *sums) {
    memset(sums->common, 0, sizeof sums->common);
    memset(sums->mixed, 0, sizeof *sums->mixed * (size_t)w->frees);
    for (ptrdiff_t e = 0; e < w->frees; e++) memset(sums->own[e], 0, sizeof **sums->own * (size_t)(w->frees / w->free));
    sums->places = 0;
    for (ptrdiff_t j = 0; j < w->fit.lines; j++) {
        ledpi_add_products(*sums->columns[j], w->fit.lines, DENSE, sums->common);
        for (ptrdiff_t i = 0; i < w->fit.lines; i++) add_overlap(w, &sums->overlap[j][i], sums->columns[j][i], sums);
    }
    if (!w->asked->compared) each_place(w, put_shared, sums);
    memset(sums->shared2, 0, sizeof *sums->shared2 * (size_t)(w->width * w->width));
    if (!w->asked->compared) ledpi_add_products(sums->shared, w->each * w->each, w->width, sums->shared2);
}

/* Adds what is known of an unknown beforehand, in units of the variance. Returns by how many squares the fit is off that. */
static double add_prior(const Weighing *w, ptrdiff_t unknown, double variance, ptrdiff_t at, double *matrix, double *fitted) {
    const ptrdiff_t all = COMMON + OWN * w->fit.panel.cells * w->fit.panel.cells, size = COMMON + w->frees;
    const double weight = variance * w->fit.prior[all + unknown];
    const double off = unknown < WAYS || w->asked->compared ? 0.0 : w->fit.prior[unknown] - w->fit.unknown[unknown];
    const double told = fmax(0.0, matrix[at * (size + 2)]); /* the cells' common part is taken off, so rounding may leave less than none */
    *fitted += told / fmax(told + weight, 1e-12);
    matrix[at * (size + 2)] += weight;
    matrix[at * (size + 1) + size] += weight * off;
    return weight * off * off;
}

/* The normal equations, right side last. Returns all squares, those of what is known beforehand, too. */
static double put_matrix(const Weighing *w, Sums *sums, double variance) {
    const ptrdiff_t frees = w->frees, size = COMMON + frees, stride = size + 1, width = w->width;
    const bool compared = w->asked->compared;
    double *const matrix = sums->matrix, squares = sums->common[RESIDUAL * (DENSE + 1)] - sums->shared2[RESIDUAL * (width + 1)];
    sums->fitted = (double)(compared ? frees + 1 : frees - frees / w->free);
    for (ptrdiff_t i = 0; i < COMMON; i++) {
        const float *const common = sums->common + i * DENSE, *const shared2 = sums->shared2 + i * width;
        for (ptrdiff_t j = i; j < COMMON; j++) matrix[i * stride + j] = common[j] - shared2[j];
        for (ptrdiff_t e = 0; e < frees; e++) matrix[i * stride + ledpi_place_of(w, e)] = sums->mixed[e][i] - shared2[DENSE + e];
        matrix[i * stride + size] = common[RESIDUAL] - shared2[RESIDUAL];
        if (i != LEVEL && i != PHASE + 1) squares += add_prior(w, i, variance, i, matrix, &sums->fitted);
    }
    for (ptrdiff_t e = 0; e < frees; e++) {
        const ptrdiff_t at = ledpi_place_of(w, e);
        for (ptrdiff_t f = e; f < frees; f++) {
            const ptrdiff_t to = ledpi_place_of(w, f), row = at < to ? at : to, column = at < to ? to : at;
            matrix[row * stride + column] = sums->own[e][f / w->free][f % w->free] - sums->shared2[(DENSE + e) * width + DENSE + f];
        }
        matrix[at * stride + size] = sums->mixed[e][RESIDUAL] - sums->shared2[RESIDUAL * width + DENSE + e];
        if (!compared && e % w->free == 0) squares += add_prior(w, COMMON + OWN * (e / w->free), variance, at, matrix, &sums->fitted);
    }
    return squares;
}

static LEDPI_INLINE float product_of(const float *a, const float *b) {
    Floats sum = {0};
    for (int k = 0; k < DENSE; k += LEDPI_WIDTH) sum += *(const Floats *)(a + k) * *(const Floats *)(b + k);
    return ledpi_total(sum);
}

/* Puts the residuals of all samples by the solution; and of a frame that is compared takes off its light what moved it, so that
 * a mean of many is no softer than one. */
static LEDPI_SIMD void put_left(const Weighing *w, Sums *sums) {
    float by[DENSE] = {0}, own[MOST_FREE];
    for (int k = 0; k < COMMON; k++) by[k] = (float)sums->solution[k];
    for (ptrdiff_t e = 0; e < w->frees; e++) own[e] = (float)sums->solution[ledpi_place_of(w, e)];
    for (ptrdiff_t j = 0; j < w->fit.lines; j++)
        for (ptrdiff_t i = 0; i < w->fit.lines; i++) {
            const CellOverlap *const overlap = &sums->overlap[j][i];
            if (!overlap->count) continue;
            const float moved = product_of(by, sums->columns[j][i]);
            float left = sums->columns[j][i][RESIDUAL] - moved;
            for (int m = 0; m < overlap->count; m++)
                for (ptrdiff_t k = 0; k < w->free; k++) left -= overlap->by[m][k] * own[overlap->cell[m] * w->free + k];
            sums->left[j][i] = left;
            if (w->asked->compared) w->asked->light[j * w->fit.lines + i] -= moved / sums->root[j][i];
        }
}

bool ledpi_panel_evidence(PanelEvidence *asked, uint8_t *room) {
    Work *const work = &((Room *)room)->work;
    Sums *const sums = &((Room *)room)->sums;
    const ptrdiff_t cells = asked->fit.cells, n = cells * cells;
    if (cells > MOST_CELLS || asked->fit.lines > MOST_EACH * cells) return false;
    Weighing w = {.fit = ledpi_panel_begun(&asked->fit, &asked->fit), .asked = asked, .each = asked->fit.lines / cells};
    w.free = !asked->compared + 2 * asked->waves, w.frees = w.free * n;
    w.width = DENSE + (w.frees + LEDPI_WIDTH - 1) / LEDPI_WIDTH * LEDPI_WIDTH;
    const ptrdiff_t size = COMMON + w.frees;
    double h[9];
    w.fit.view.cubic = true; /* noise then is hardly alike in neighbours, and no place between pixels is softer than others */
    ledpi_unit_square_homography(w.fit.corners, h);
    for (ptrdiff_t i = 0; i < COMMON + OWN * n; i++) work->unknown[i] = (float)w.fit.unknown[i];
    ledpi_panel_put_grid(&w.fit, h, work);
    put_samples(&w, work, sums);
    if (!asked->compared) each_place(&w, take_shared_off, sums);
    if (!asked->mean_light) weigh_places(&w, sums); /* the fit of a mean has no bands, so they would be left there */
    const double variance = weigh_blocks(&w, work, sums);
    sum_up(&w, sums);
    const double squares = put_matrix(&w, sums, variance);
    asked->freedom = (double)(sums->samples - sums->places) - sums->fitted;
    if (!ledpi_weigh(sums->matrix, size, COMMON + (asked->compared ? 0 : n), squares, asked->freedom, asked->score, asked->information))
        return false;
    ledpi_solve(sums->matrix, size, sums->solution);
    put_left(&w, sums);
    if (!asked->compared) each_place(&w, take_shared_off, sums);
    asked->inflation = ledpi_noise_inflation(&w, sums);
    return true;
}
