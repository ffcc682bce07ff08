/* Squares in the pictures of a pyramid, level by level. */
#include "find.h"

enum { MOST_LEVELS = 10, MOST_SHARES = 2 };

/* A picture, a pixel of which is `scale` of the frame's; which grey levels something that is lit there is brighter than, or
 * by which shares of the contrast it is, in 256ths; and the shortest way around what is. */
typedef struct {
    const uint8_t *picture;
    ptrdiff_t height, width, scale, levels, shares;
    int32_t brighter_than[MOST_LEVELS], lit_by[MOST_SHARES], shortest;
} Level;

/* Enough for the largest level. */
typedef struct {
    uint8_t *window, *above, *contrast, *melt, *lit;
    Run *runs;
    Thing *things;
    Outline *outlines;
    ptrdiff_t most; /* things, outlines */
    int32_t (*points)[2];
    ptrdiff_t points_room;
    int32_t (*ends)[2];
    double (*hull)[2];
} Room;

/* What is found; how often something was dropped, and for what. */
typedef struct {
    Square *squares;
    ptrdiff_t *distinct; /* (most_squares,) which of them are of different things, the best first */
    ptrdiff_t most_squares, square_count, distinct_count, at_border, not_four_sided, too_small;
} Found;

/* What is looked for: squares of at least `smallest_px`, of `cells` along a side. */
typedef struct {
    double smallest_px;
    ptrdiff_t cells;
    Limits limits;
} Wanted;

static void find_in(const Level *level, const uint8_t *lit, const Wanted *wanted, const Room *room,
                    ptrdiff_t *squares, Found *found) {
    const Limits *const limits = &wanted->limits;
    const Outlined outlined = ledpi_outlines(lit, level->height, level->width, level->shortest, limits, room->runs,
                                             room->things, room->points, room->points_room, room->outlines, room->most);
    found->at_border += outlined.at_border;
    for (ptrdiff_t i = 0; i < outlined.outlines && *squares < found->most_squares; i++) {
        const Outline *const own = room->outlines + i;
        Square *const square = found->squares + *squares;
        if (!ledpi_square_of(room->points + own->first, own, (double)level->scale, limits, room->ends, room->hull, square))
            found->not_four_sided++;
        else if (square->side_px < wanted->smallest_px)
            found->too_small++;
        else
            ++*squares;
    }
}

static void find_brighter(const Level *level, const Wanted *wanted, const Room *room, ptrdiff_t *squares, Found *found) {
    if (!level->levels) return;
    ledpi_close(level->picture, level->height, level->width, room->melt, room->above);
    for (ptrdiff_t k = 0; k < level->levels; k++) {
        ledpi_brighter(room->above, level->height * level->width, level->brighter_than[k], room->lit);
        find_in(level, room->lit, wanted, room, squares, found);
    }
}

static void find_lit(const Level *level, const Wanted *wanted, const Room *room, ptrdiff_t *squares, Found *found) {
    if (!level->shares) return;
    ledpi_contrast(level->picture, level->height, level->width, room->window, room->above, room->contrast);
    for (ptrdiff_t k = 0; k < level->shares; k++) {
        /* Opened where the closing makes thin bridges to the surroundings. */
        ledpi_lit(room->above, room->contrast, level->height, level->width, level->lit_by[k], &wanted->limits,
                  level->scale > 2, room->melt, room->lit);
        find_in(level, room->lit, wanted, room, squares, found);
    }
}

/* In `levels` (count) what is `wanted`. */
void ledpi_find(const Level *levels, ptrdiff_t count, const Wanted *wanted, const Room *room, Found *found) {
    ptrdiff_t squares = 0;
    found->at_border = found->not_four_sided = found->too_small = 0;
    for (const Level *level = levels; level < levels + count; level++) {
        find_brighter(level, wanted, room, &squares, found);
        find_lit(level, wanted, room, &squares, found);
    }
    found->square_count = squares;
    found->distinct_count = ledpi_distinct(found->squares, squares, &wanted->limits, found->distinct);
    found->distinct_count = ledpi_without_cells(found->squares, found->distinct_count, wanted->cells, &wanted->limits,
                                                found->distinct);
}
