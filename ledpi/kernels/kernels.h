/* What the loops share. Every function takes arrays as numpy lays them out (C order), allocates nothing that it does not
 * free, keeps nothing, and touches no element outside the sizes that it is told. Numbers that are not finite are legal
 * everywhere and come out as such. */
#ifndef LEDPI_KERNELS_H
#define LEDPI_KERNELS_H

#include <stddef.h>
#include <stdint.h>

/* A grey picture, and the table (256,) from its codes to linear light. */
typedef struct {
    const uint8_t *pixels;
    ptrdiff_t height, width, stride; /* stride: bytes from a row to the next; width and height at least 2 */
    const float *light;
} Picture;

/* Linear light between pixels, bilinear; beyond the picture as at its border (light.c). */
float ledpi_light_between(const Picture *picture, float x, float y);

#endif
