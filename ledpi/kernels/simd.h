/* Loops that are worth compiling twice on x86-64, where a processor may have wider vectors than all of its kind have:
 * the loader takes the ones for it. */
#ifndef LEDPI_SIMD_H
#define LEDPI_SIMD_H

#include <stddef.h>
#include <stdint.h> /* tells which C library this is */

#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define LEDPI_SIMD __attribute__((target_clones("fma", "default")))
#define LEDPI_SIMD_BYTES __attribute__((target_clones("avx2", "default"))) /* of which "fma" knows nothing */
#else
#define LEDPI_SIMD
#define LEDPI_SIMD_BYTES
#endif

#define LEDPI_INLINE inline __attribute__((always_inline)) /* so that it is compiled for what calls it */

/* The sum of `count` numbers, four at a time: one after the other each would wait for the last. */
static LEDPI_INLINE double ledpi_sum(const float *numbers, ptrdiff_t count) {
    double lanes[4] = {0};
    ptrdiff_t i = 0;
    for (; i + 4 <= count; i += 4)
        for (int lane = 0; lane < 4; lane++) lanes[lane] += numbers[i + lane];
    for (; i < count; i++) lanes[0] += numbers[i];
    return (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]);
}

#endif
