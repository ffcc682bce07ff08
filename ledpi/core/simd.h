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

/* Numbers that are treated at once: eight, but on 64-bit ARM four, as its registers have. Wider vectors GCC keeps in
 * memory there, at five instructions for one. */
#ifdef LEDPI_WIDTH /* given, as by a test that has no ARM */
#elif defined(__aarch64__)
#define LEDPI_WIDTH 4
#else
#define LEDPI_WIDTH 8 /* two registers, where there is no AVX */
#endif
typedef float Floats __attribute__((vector_size(4 * LEDPI_WIDTH), aligned(4)));

static LEDPI_INLINE float ledpi_total(Floats of) {
    for (int lane = 4; lane < LEDPI_WIDTH; lane++) of[lane - 4] += of[lane];
    return (of[0] + of[1]) + (of[2] + of[3]);
}

typedef int32_t Ints __attribute__((vector_size(4 * LEDPI_WIDTH)));

/* Rows become columns: in pairs, in fours, in halves. */
static LEDPI_INLINE void ledpi_transpose(Floats r[LEDPI_WIDTH]) {
    Floats t[LEDPI_WIDTH];
#if LEDPI_WIDTH == 4
    for (int i = 0; i < 4; i += 2) {
        t[i] = __builtin_shuffle(r[i], r[i + 1], (Ints){0, 4, 1, 5});
        t[i + 1] = __builtin_shuffle(r[i], r[i + 1], (Ints){2, 6, 3, 7});
    }
    for (int k = 0; k < 2; k++) {
        r[2 * k] = __builtin_shuffle(t[k], t[k + 2], (Ints){0, 1, 4, 5});
        r[2 * k + 1] = __builtin_shuffle(t[k], t[k + 2], (Ints){2, 3, 6, 7});
    }
#else
    Floats u[LEDPI_WIDTH];
    for (int i = 0; i < LEDPI_WIDTH; i += 2) {
        t[i] = __builtin_shuffle(r[i], r[i + 1], (Ints){0, 8, 1, 9, 4, 12, 5, 13});
        t[i + 1] = __builtin_shuffle(r[i], r[i + 1], (Ints){2, 10, 3, 11, 6, 14, 7, 15});
    }
    for (int i = 0; i < LEDPI_WIDTH; i += 4)
        for (int k = 0; k < 2; k++) {
            u[i + 2 * k] = __builtin_shuffle(t[i + k], t[i + k + 2], (Ints){0, 1, 8, 9, 4, 5, 12, 13});
            u[i + 2 * k + 1] = __builtin_shuffle(t[i + k], t[i + k + 2], (Ints){2, 3, 10, 11, 6, 7, 14, 15});
        }
    for (int i = 0; i < 4; i++) {
        r[i] = __builtin_shuffle(u[i], u[i + 4], (Ints){0, 1, 2, 3, 8, 9, 10, 11});
        r[i + 4] = __builtin_shuffle(u[i], u[i + 4], (Ints){4, 5, 6, 7, 12, 13, 14, 15});
    }
#endif
}

#endif
