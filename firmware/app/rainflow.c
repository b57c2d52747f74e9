/* Rainflow counting of a coupling's deflection as it comes, as ASTM E1049 has it, by the four-point method.
 *
 * A turn of the deflection counts once it is a class wide; what is smaller is no cycle.  A range between two
 * that are no smaller is a whole cycle and is taken out.  What cannot close yet is kept as points; when a
 * reading is asked for they are half cycles, as the standard has it.  With that the counts are those of
 * its three-point method (McInnes and Meehan 2008, Int. J. Fatigue 30, 547-559).
 *
 * When there is no room for another point the oldest range is counted as half a cycle and left out, as the
 * standard does with one that holds the start; `full` counts how often.
 *
 * License: MIT. */
#include "rainflow.h"

#include <string.h>

#define STEPS ((int32_t)ESEA_LIFE_STEPS)

static int32_t range_of(int32_t a, int32_t b)
{
    return a > b ? a - b : b - a;
}

/* One or two half cycles; a counter stays at its maximum. */
static void count(uint32_t *halves, int32_t a, int32_t b, uint32_t more)
{
    uint32_t at = (uint32_t)(range_of(a, b) / STEPS);

    if (at >= ESEA_LIFE_CLASSES)
        at = ESEA_LIFE_CLASSES - 1u;
    halves[at] = halves[at] < UINT32_MAX - more ? halves[at] + more : UINT32_MAX;
}

static void append(esea_store_life_t *life, int32_t x)
{
    if (life->points == ESEA_LIFE_POINTS) {
        count(life->halves, life->point[0], life->point[1], 1u);
        memmove(life->point, life->point + 1, sizeof life->point - sizeof life->point[0]);
        --life->points;
        life->full += life->full != UINT32_MAX;
    }
    life->point[life->points++] = (int16_t)x;
}

/* Takes out inner ranges that are closed. */
static void close_ranges(esea_store_life_t *life)
{
    while (life->points >= 4u) {
        int16_t *const p = &life->point[life->points - 4u];
        const int32_t inner = range_of(p[1], p[2]);

        if (inner > range_of(p[0], p[1]) || inner > range_of(p[2], p[3]))
            break;
        count(life->halves, p[1], p[2], 2u);
        p[1] = p[3];
        life->points -= 2u;
    }
}

/* Before the first range is a class wide: the least and the most so far stand behind the first point. */
static bool begin(esea_store_life_t *life, int32_t x)
{
    int16_t *const p = life->point;

    if (life->points == 0u) {
        p[0] = p[1] = p[2] = (int16_t)x;
        life->points = 1u;
        return true;
    }
    if (x < p[1])
        p[1] = (int16_t)x;
    if (x > p[2])
        p[2] = (int16_t)x;
    if (p[2] - p[1] < STEPS)
        return false;
    p[0] = x == p[2] ? p[1] : p[2];
    p[1] = (int16_t)x;
    life->points = 2u;
    return true;
}

bool esea_rainflow_take(esea_store_life_t *life, int32_t x)
{
    int32_t last;
    bool rising;

    if (life->points < 2u)
        return begin(life, x);
    last = life->point[life->points - 1u];
    rising = last > life->point[life->points - 2u];
    if (x == last)
        return false;
    if (rising == (x > last))
        life->point[life->points - 1u] = (int16_t)x;
    else if (range_of(x, last) >= STEPS)
        append(life, x);
    else
        return false;
    close_ranges(life);
    return true;
}

void esea_rainflow_halves(const esea_store_life_t *life, uint32_t *halves)
{
    uint32_t i;

    memcpy(halves, life->halves, sizeof life->halves);
    for (i = 1u; i < life->points; ++i)
        count(halves, life->point[i - 1u], life->point[i], 1u);
}
