/* The phases of a panel's two waves, where nothing is known of its cells' classes: on a grid. */
#include <math.h>

#include "panel.h"

enum { PHASES = 12 }; /* of half a cycle: a mix of either sign is a wave that is half a cycle later */

/* Sums over a cell's rows: of its steady light with itself and with either wave, and of these with what is seen. */
typedef struct {
    double one, a, b, aa, ab, bb, y, ya, yb;
} Sums;

/* What both waves explain beside a gain, in log-likelihood's unit times two. A wave that is all but even in a cell tells
 * nothing of it: `ridge`. */
static double explained(const Sums *s) {
    if (!(s->one > 0.0)) return 0.0;
    const double ridge = 1e-3 * s->one, aa = s->aa - s->a * s->a / s->one + ridge, bb = s->bb - s->b * s->b / s->one + ridge;
    const double ab = s->ab - s->a * s->b / s->one, ya = s->ya - s->a * s->y / s->one, yb = s->yb - s->b * s->y / s->one;
    const double determinant = aa * bb - ab * ab;
    return determinant > 0.0 ? (ya * ya * bb - 2.0 * ya * yb * ab + yb * yb * aa) / determinant : 0.0;
}

void ledpi_panel_phases(const Panel *panel, const View *view, ptrdiff_t rows, const float *squares, const float *products,
                        double phases[2]) {
    float wave[2][PHASES][MOST_ROWS];
    for (int k = 0; k < 2; k++)
        for (int p = 0; p < PHASES; p++)
            for (ptrdiff_t r = 0; r < rows; r++) {
                double slope;
                const double row = view->first_y + view->shrink * (double)r;
                wave[k][p][r] = (float)ledpi_wave_at(panel->waves + k * WAVE_STEPS,
                                                     0.5 * p / PHASES + row * panel->cycles_a_row[k], &slope);
            }
    double most = -1.0;
    for (int a = 0; a < PHASES; a++)
        for (int b = 0; b < PHASES; b++) {
            double all = 0.0;
            for (ptrdiff_t c = 0; c < panel->cells * panel->cells; c++) {
                const float *own = squares + c * rows, *with = products + c * rows;
                Sums s = {0};
                for (ptrdiff_t r = 0; r < rows; r++) {
                    if (own[r] == 0.0f) continue;
                    const double wa = wave[0][a][r], wb = wave[1][b][r], sa = own[r] * wa, sb = own[r] * wb;
                    s.one += own[r], s.a += sa, s.b += sb, s.aa += sa * wa, s.ab += sa * wb, s.bb += sb * wb;
                    s.y += with[r], s.ya += with[r] * wa, s.yb += with[r] * wb;
                }
                all += explained(&s);
            }
            if (all > most) most = all, phases[0] = 0.5 * a / PHASES, phases[1] = 0.5 * b / PHASES;
        }
}
