/* The steps of finding: lit pixels (threshold.c), its outlines (outlines.c), the squares among them (four_sides.c), one of
 * each thing (suppression.c). And all of that, level by level (find.c). */
#ifndef LEDPI_FIND_H
#define LEDPI_FIND_H

#include "core.h"

/* ---- What is lit */

enum { REACH = 6, SPAN = 2 * REACH + 1, ROWS = 32, STRIP = ROWS + 2 * REACH };

/* Contrast of each pixel of a picture (height, width): how far it is `above` the darkest of the SPAN × SPAN around it, and their
 * `contrast`, the brightest less the darkest. `room` (3, STRIP, width + 2 REACH). */
void ledpi_contrast(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, uint8_t *room, uint8_t *above,
                    uint8_t *contrast);

/* A picture (height, width) closed: what is darker than what lies to either side of it by a pixel is as bright as that.
 * `room` (height, width) and (width + 2). */
void ledpi_close(const uint8_t *picture, ptrdiff_t height, ptrdiff_t width, uint8_t *room, uint8_t *closed);

/* Binarizes (`lit`, 0 or 255) `count` pixels that are closed: brighter than `level`. */
void ledpi_brighter(const uint8_t *closed, ptrdiff_t count, int level, uint8_t *lit);

/* Binarizes (`lit` (height, width), 0 or 255): more than `share` (in 256ths) of the contrast above the darkest; closed, and
 * `opened` after that. `room` (height, width) and (width + 2). */
void ledpi_lit(const uint8_t *above, const uint8_t *contrast, ptrdiff_t height, ptrdiff_t width, int share,
               const Limits *limits, bool opened, uint8_t *room, uint8_t *lit);

/* ---- Its outlines */

/* Pixels side by side that are lit, from … to − 1, and the thing that they belong to. */
typedef struct {
    int32_t from, to, thing;
} Run;

/* A connected component. `same_as` is the number of another thing that it turned out to be a part of, or its own. */
typedef struct {
    int32_t same_as, left, top, right, bottom, lit, first; /* the first pixel of its top row; how many are lit */
} Thing;

typedef struct {
    int32_t first, length, top, bottom, left, right; /* its points; its box */
    double area;
} Outline;

/* Counts; `at_border`: of outlines that are but for touching the picture's border. */
typedef struct {
    ptrdiff_t outlines, at_border;
} Outlined;

/* The outlines of what is lit in a picture of 0 and 255 (height, width), of things the way around whose box is not less than
 * `shortest`. `runs` (2, width), `things`, `outlines` (most) are room, `most` as many as there can be; `points` beyond
 * `room` are left out, and the outlines that they belong to. */
Outlined ledpi_outlines(const uint8_t *lit, ptrdiff_t height, ptrdiff_t width, int32_t shortest, const Limits *limits,
                        Run *runs, Thing *things, int32_t (*points)[2], ptrdiff_t room, Outline *outlines,
                        ptrdiff_t most);

/* ---- The squares among them */

/* Corners clockwise in the picture, first the one nearest the top left. */
typedef struct {
    double corners[4][2], side_px, misfit, tolerance_px;
} Square;

/* The square that an outline with `points` shows; false where it shows none. Pixels are `scale` of the frame's. `ends`
 * (height, 2) and `hull` (2 height + 2, 2) are room. */
bool ledpi_square_of(const int32_t (*points)[2], const Outline *outline, double scale, const Limits *limits,
                     int32_t (*ends)[2], double (*hull)[2], Square *square);

/* A square by its cost, the row of its middle, and the one that was kept before it in the same band of rows. */
typedef struct {
    double cost, middle;
    ptrdiff_t at, before;
} Ranked;

/* Suppression: squares (count), in `kept` (count), of no thing which another fits better; the best first. `ranked` (count) is
 * room. Returns how many. */
ptrdiff_t ledpi_distinct(const Square *squares, ptrdiff_t count, const Limits *limits, Ranked *ranked, int64_t *kept);

enum { MOST_COMPARED = 512 }; /* that are looked at for cells of each other */

/* Keeps of the `kept` (count) those that are no cells of another one of them, of `cells` × `cells`. Returns how many. */
ptrdiff_t ledpi_drop_cells(const Square *squares, ptrdiff_t count, ptrdiff_t cells, const Limits *limits,
                              int64_t *kept);

/* ---- Bright blobs, and the lattices that they form */

enum { LEDPI_BLOB = 6, LEDPI_LATTICE_SPAN = 17, LATTICE_REACH = (LEDPI_LATTICE_SPAN - 1) / 2 };

/* Pixels side by side, `from` … `to` − 1, and the piece of a blob that they are in. */
typedef struct {
    int32_t from, to, piece;
} BlobRun;

/* Runs that touch, and their moments: of 1, x, y, x², xy, y². A part of another piece, or of itself. */
typedef struct {
    double sums[LEDPI_BLOB];
    int32_t part_of;
} BlobPiece;

/* Its pixels' number, middle, and second moments about that. */
typedef struct {
    double area, x, y, xx, xy, yy;
} Blob;

/* Blobs (most) of 4-connected pixels of `lit` (height, width), 0 or 255, no larger than `most_area`; from the top down. `lit`,
 * `runs` (2, width) and `pieces` (most_pieces) are used up. What there is no room for is left out (blobs.c). */
ptrdiff_t ledpi_blobs(uint8_t *lit, ptrdiff_t height, ptrdiff_t width, double most_area, BlobRun *runs, ptrdiff_t most_pieces,
                      BlobPiece *pieces, ptrdiff_t most, Blob *blobs);

/* Lattices (most, span, span) of at least `least` of the blobs: the number of each, −1 where there is none. `used` (count)
 * is room (lattices.c). */
ptrdiff_t ledpi_lattices(const Blob *blobs, ptrdiff_t count, ptrdiff_t least, uint8_t *used, ptrdiff_t most, int32_t *lattices);

#endif
