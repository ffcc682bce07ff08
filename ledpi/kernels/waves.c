/* Cosine and sine of bands in each row. */
#include <math.h>
#include <stddef.h>

#include "core.h"
#include "waves.h"
#include "simd.h"

/* `cosines` and `sines` (count) of 2π(a_row·row + start) for each of `rows` (count). */
LEDPI_SIMD void ledpi_waves(const float *rows, ptrdiff_t count, float a_row, float start, float *cosines, float *sines) {
    for (ptrdiff_t i = 0; i < count; i++) {
        const float part = ledpi_part(rows[i] * a_row + start), off = (part < 0.0f ? -part : part) - 0.25f;
        const float folded = 0.25f - (off < 0.0f ? -off : off);
        cosines[i] = ledpi_cosine(part);
        sines[i] = ledpi_sine(part < 0.0f ? -folded : folded);
    }
}

enum { AT_ONCE = 64 }; /* samples of square waves */

/* What a square wave is on for, from 0 to `cycles`, in cycles; `part`: what is behind the point. */
static LEDPI_INLINE double on_until(double cycles, double duty, double *part) {
    const double whole = floor(cycles);
    *part = cycles - whole;
    return whole * duty + (*part < duty ? *part : duty);
}

/* `bands` and `later` (count), as `square_wave_bands` in shutter.py has them, in `rows` (count), meaned over `averaged`
 * rows around each, so far `apart`; `start` is the fundamental's phase in row 0, in cycles, `exposed` the exposure,
 * `fundamental` its amplitude, negative where it is on when the light is off. */
LEDPI_SIMD void ledpi_square_waves(const float *rows, ptrdiff_t count, double a_row, double start, ptrdiff_t averaged,
                                   double apart, double exposed, double duty, double fundamental, float *bands, float *later) {
    const double size = fabs(fundamental), turn = 2.0 * 3.14159265358979323846;
    const double of_on = 1.0 / ((double)averaged * exposed * duty * size), of_rise = -of_on / turn;
    start += 0.5 * duty - 0.5 * exposed + (fundamental < 0.0 ? 0.5 : 0.0) - 0.5 * (double)(averaged - 1) * apart * a_row;
    for (ptrdiff_t first = 0; first < count; first += AT_ONCE) {
        const ptrdiff_t here = count - first < AT_ONCE ? count - first : AT_ONCE;
        double on[AT_ONCE] = {0}, rise[AT_ONCE] = {0};
        for (ptrdiff_t row = 0; row < averaged; row++)
            for (ptrdiff_t i = 0; i < here; i++) {
                double before, after;
                const double from = rows[first + i] * a_row + start + (double)row * apart * a_row;
                on[i] += on_until(from + exposed, duty, &after) - on_until(from, duty, &before);
                rise[i] += (after < duty ? 1.0 : 0.0) - (before < duty ? 1.0 : 0.0);
            }
        for (ptrdiff_t i = 0; i < here; i++) bands[first + i] = (float)(on[i] * of_on - 1.0 / size);
        for (ptrdiff_t i = 0; i < here; i++) later[first + i] = (float)(rise[i] * of_rise);
    }
}
