/* How far noise is alike, and what that leaves of the evidence: decode/evidence/noise.py says why. */
#include <math.h>

#include "core.h"

/* With a deviation of ln(inflation) that is more than this, what is left tells nothing: cells of 3 x 3 samples, all fitted. */
#define MOST_UNSURE 0.7

/* `correlation`: excess, its deviation, and growth, all 0 where a fit does not tell, as that of white noise. `of_fit`: how
 * many samples are free, and the sums of squared differences a lag and two lags apart. */
void ledpi_correlation(const WhiteNoise *expected, const double *of_fit, double *correlation) {
    const bool tells = of_fit[2] > 0.0 && of_fit[0] >= expected->least_free;
    const double alike = 1.0 - (of_fit[1] / expected->once) / (of_fit[2] / expected->twice);
    correlation[0] = tells ? alike - expected->white : 0.0;
    correlation[1] = tells ? expected->chance / sqrt(of_fit[0]) : 0.0;
    correlation[2] = tells ? expected->growth : 0.0;
}

/* By how much evidence claims too much: 1 or more. */
double ledpi_variance_inflation(double excess, double deviation, double growth) {
    if (!(deviation * growth < MOST_UNSURE)) return 1.0;
    return exp(fmax(0.0, growth * (excess - deviation)));
}
