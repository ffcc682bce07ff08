/* Cosines of bands. */
#ifndef LEDPI_WAVES_H
#define LEDPI_WAVES_H

/* sin 2πy for y within ±¼, by its series: off by less than 1e-7. */
static inline float ledpi_sine(float y) {
    const float turn = 6.28318530717958648f * y, s = turn * turn;
    return turn * (1.0f + s * (-1.0f / 6 + s * (1.0f / 120 + s * (-1.0f / 5040 + s * (1.0f / 362880 - s / 39916800)))));
}

/* Cycles less whole ones: within ±½. */
static inline float ledpi_part(float cycles) {
    const float round = 12582912.0f; /* 1.5·2²³: what is added to it loses all behind the point */
    return cycles - ((cycles + round) - round);
}

/* cos 2πy for y within ±½. */
static inline float ledpi_cosine(float part) { return ledpi_sine(0.25f - (part < 0.0f ? -part : part)); }

#endif
