/* The smallest quadrilateral on four sides of a convex outline: `smallest_square_around` of decode/striped/around.py. */
#include <math.h>

#include "kernels.h"

enum { MOST_SIDES = 16 };
#define LEAST_TURN 0.05 /* as there */

static double cross(Point a, Point b) { return a.x * b.y - a.y * b.x; }

/* Of an outline (count) that runs clockwise in the picture. Into `square` (4), as its sides follow each other. False where
 * no four sides enclose it. */
int ledpi_smallest_square(const Point *outline, ptrdiff_t count, Point *square) {
    Point along[MOST_SIDES], meet[MOST_SIDES][MOST_SIDES];
    bool turns[MOST_SIDES][MOST_SIDES];
    double least = INFINITY;
    if (count > MOST_SIDES) return 0;
    for (ptrdiff_t i = 0; i < count; i++) {
        const Point next = outline[i + 1 < count ? i + 1 : 0];
        along[i] = (Point){next.x - outline[i].x, next.y - outline[i].y};
    }
    for (ptrdiff_t i = 0; i < count; i++)
        for (ptrdiff_t j = 0; j < count; j++) { /* where side i meets side j that follows it */
            const double turn = cross(along[i], along[j]);
            const Point gap = {outline[j].x - outline[i].x, outline[j].y - outline[i].y};
            const double share = cross(gap, along[j]) / turn;
            turns[i][j] = turn > LEAST_TURN * hypot(along[i].x, along[i].y) * hypot(along[j].x, along[j].y);
            meet[i][j] = (Point){outline[i].x + share * along[i].x, outline[i].y + share * along[i].y};
        }
    for (ptrdiff_t a = 0; a < count; a++)
        for (ptrdiff_t b = a + 1; b < count; b++)
            for (ptrdiff_t c = b + 1; turns[a][b] && c < count; c++)
                for (ptrdiff_t d = c + 1; turns[b][c] && d < count; d++) {
                    if (!turns[c][d] || !turns[d][a]) continue;
                    const Point found[4] = {meet[a][b], meet[b][c], meet[c][d], meet[d][a]};
                    const double area = ledpi_area(found);
                    if (!(area > 0.0 && area < least)) continue;
                    least = area;
                    for (int i = 0; i < 4; i++) square[i] = found[i];
                }
    return isfinite(least);
}
