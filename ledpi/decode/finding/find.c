/* Squares in the pictures of a pyramid, level by level. */
#include "find.h"

/* Enough for the largest level; all of it is the caller's. */
typedef struct {
    uint8_t *window, *above, *contrast, *melt, *lit;
    Run *runs;
    Thing *things;
    Outline *outlines;
    ptrdiff_t most; /* things, outlines: as many pixels as can stand apart */
    int32_t (*points)[2];
    ptrdiff_t points_room;
    int32_t (*ends)[2];
    double (*hull)[2];
    Ranked *ranked;
} Room;

/* The next bytes of what there is, counted in `used`; NULL where they are only counted. */
static void *take(uint8_t *room, ptrdiff_t *used, ptrdiff_t bytes) {
    uint8_t *const here = room ? room + *used : NULL;
    *used += (bytes + 15) / 16 * 16;
    return here;
}

static ptrdiff_t put_room(uint8_t *room, ptrdiff_t height, ptrdiff_t width, Room *into) {
    const ptrdiff_t pixels = height * width, most = (height + 1) * (width + 1) / 4 + 1;
    ptrdiff_t used = 0;
    into->window = take(room, &used, 3 * STRIP * (width + 2 * REACH));
    into->above = take(room, &used, pixels);
    into->contrast = take(room, &used, pixels);
    into->melt = take(room, &used, (height + 1) * (width + 2));
    into->lit = take(room, &used, pixels);
    into->runs = take(room, &used, 2 * width * (ptrdiff_t)sizeof(Run));
    into->things = take(room, &used, most * (ptrdiff_t)sizeof(Thing));
    into->outlines = take(room, &used, most * (ptrdiff_t)sizeof(Outline));
    into->points = take(room, &used, pixels * (ptrdiff_t)sizeof(int32_t[2]));
    into->ends = take(room, &used, height * (ptrdiff_t)sizeof(int32_t[2]));
    into->hull = take(room, &used, (2 * height + 2) * (ptrdiff_t)sizeof(double[2]));
    into->ranked = take(room, &used, LEDPI_MOST_SQUARES * (ptrdiff_t)sizeof(Ranked));
    into->most = most, into->points_room = pixels;
    return used;
}

ptrdiff_t ledpi_find_room(ptrdiff_t height, ptrdiff_t width) {
    Room room;
    return put_room(NULL, height, width, &room);
}

static void find_in(const FindLevel *level, const uint8_t *lit, const FindWanted *wanted, const Room *room,
                    ptrdiff_t *squares, FindResult *found) {
    const Limits *const limits = &wanted->limits;
    const Outlined outlined = ledpi_outlines(lit, level->height, level->width, level->shortest, limits, room->runs,
                                             room->things, room->points, room->points_room, room->outlines, room->most);
    found->at_border += outlined.at_border;
    for (ptrdiff_t i = 0; i < outlined.outlines && *squares < found->most; i++) {
        const Outline *const own = room->outlines + i;
        Square *const square = (Square *)found->squares + *squares;
        if (!ledpi_square_of(room->points + own->first, own, (double)level->scale, limits, room->ends, room->hull, square))
            found->not_four_sided++;
        else if (square->side_px < wanted->smallest_px)
            found->too_small++;
        else
            ++*squares;
    }
}

static void find_brighter(const FindLevel *level, const FindWanted *wanted, const Room *room, ptrdiff_t *squares, FindResult *found) {
    if (!level->levels) return;
    ledpi_close(level->picture, level->height, level->width, room->melt, room->above);
    for (ptrdiff_t k = 0; k < level->levels; k++) {
        ledpi_brighter(room->above, level->height * level->width, level->brighter_than[k], room->lit);
        find_in(level, room->lit, wanted, room, squares, found);
    }
}

static void find_lit(const FindLevel *level, const FindWanted *wanted, const Room *room, ptrdiff_t *squares, FindResult *found) {
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
void ledpi_find(const FindLevel *levels, ptrdiff_t count, const FindWanted *wanted, uint8_t *all_room, FindResult *found) {
    ptrdiff_t squares = 0;
    Room own;
    const Room *const room = &own;
    put_room(all_room, levels->height, levels->width, &own);
    found->at_border = found->not_four_sided = found->too_small = 0;
    for (const FindLevel *level = levels; level < levels + count; level++) {
        find_brighter(level, wanted, room, &squares, found);
        find_lit(level, wanted, room, &squares, found);
    }
    found->distinct_count = ledpi_distinct((const Square *)found->squares, squares, &wanted->limits, room->ranked,
                                           found->distinct);
    found->distinct_count = ledpi_drop_cells((const Square *)found->squares, found->distinct_count, wanted->cells, &wanted->limits,
                                                found->distinct);
}
