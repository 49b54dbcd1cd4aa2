/* The ground: the bicubic B-spline of plant/terrain_grid.py, read from a file of doubles.
 *
 * terrain.bin, little endian: rows, columns, north0, east0, spacing_north, spacing_east, then
 * rows * columns coefficients, row by row. Outside the grid and where a post is missing: NAN. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define EDGE 1e-9 /* of a spacing: what rounding puts outside still counts as inside */

typedef struct {
    double head[6];
    double *coefficients;
} Terrain;

/* Return 0, or why the file cannot be used. */
static const char *terrain_read(Terrain *g, const char *path) {
    FILE *file = fopen(path, "rb");
    const char *problem = NULL;
    size_t n;
    if (!file) return "cannot be opened";
    if (fread(g->head, sizeof(double), 6, file) != 6 || !(g->head[0] >= 4 && g->head[0] < 1e6) ||
        !(g->head[1] >= 4 && g->head[1] < 1e6)) {
        problem = "not a grid of doubles, little endian";
    } else {
        n = (size_t)g->head[0] * (size_t)g->head[1];
        g->coefficients = malloc(n * sizeof(double));
        if (!g->coefficients) problem = "too large for the memory";
        else if (fread(g->coefficients, sizeof(double), n, file) != n) problem = "cut short";
    }
    fclose(file);
    return problem;
}

/* Return the elevation, m, and its slope to the north and east. */
static double terrain_height(const Terrain *g, double north, double east, double slope[2]) {
    const long columns = (long)g->head[1], ny = (long)g->head[0] - 3, nx = columns - 3;
    const double y = (north - g->head[2]) / g->head[4], x = (east - g->head[3]) / g->head[5];
    double a[4], b[4], da[4], db[4], h = 0.0;
    long i, j, k;
    slope[0] = slope[1] = NAN;
    if (!(y >= -EDGE && y <= ny + EDGE && x >= -EDGE && x <= nx + EDGE)) return NAN;
    i = (long)y < ny - 1 ? (long)y : ny - 1;
    j = (long)x < nx - 1 ? (long)x : nx - 1;
    for (k = 0; k < 2; k++) {
        const double t = k ? x - j : y - i, s = 1.0 - t;
        double *w = k ? b : a, *d = k ? db : da;
        w[0] = s * s * s / 6.0;
        w[1] = (4.0 - t * t * (6.0 - 3.0 * t)) / 6.0;
        w[2] = (4.0 - s * s * (6.0 - 3.0 * s)) / 6.0;
        w[3] = t * t * t / 6.0;
        d[0] = -0.5 * s * s;
        d[1] = 0.5 * t * (3.0 * t - 4.0);
        d[2] = -0.5 * s * (3.0 * s - 4.0);
        d[3] = 0.5 * t * t;
    }
    slope[0] = slope[1] = 0.0;
    for (k = 0; k < 4; k++) {
        const double *c = g->coefficients + (i + k) * columns + j;
        const double row = b[0] * c[0] + b[1] * c[1] + b[2] * c[2] + b[3] * c[3];
        h += a[k] * row;
        slope[0] += da[k] * row / g->head[4];
        slope[1] += a[k] * (db[0] * c[0] + db[1] * c[1] + db[2] * c[2] + db[3] * c[3]) / g->head[5];
    }
    return h;
}
